"""Milliseconds per SIR and RIR frame: one object at 640×480, 5 hypotheses × 5 iterations of 10 ICP iterations."""

from __future__ import annotations

from bench.staged import staged
from verefine_viz.run.session_file import resolve
from verefine_viz.run.toolbox import Toolbox

REPEATS = 100


def run() -> list[dict[str, object]]:
    """One row per method with the share of each stage."""
    rows: list[dict[str, object]] = []
    for name in ("refine", "pir", "sir", "rir"):
        toolbox = Toolbox(resolve({"method": {"name": name, "refiner": "icp"}, "scene": {"demo": "mug"}}))
        n_iterations, ms = staged(toolbox, REPEATS)
        rows.append({"what": f"{name} frame, {n_iterations} iterations", **ms})
    return rows
