"""VF_d on a scene of three objects, as the paper's Extended APC experiment has it, stage by stage.

25 hypotheses per object, 2 iterations each: 150 iterations of one trimmed-ICP call and 60 simulation steps, and 50
scene scores. The authors' code takes 6.6 s for it on a machine of this kind. Beside it RIR, VF_b, and PHYSIM-MCTS with
150 expansions, whose roll-outs count as "score".
"""

from __future__ import annotations

from bench.staged import staged
from verefine_viz.run.session_file import resolve
from verefine_viz.run.toolbox import Toolbox

REPEATS = 5
SESSION = {
    "scene": {"demo": "stack", "frames": ["0/0"]},
    "hypotheses": {"source": "perturb", "rotation_deg": 20.0, "translation_mm": 20.0, "max_per_object": 25},
    "physics": {"steps": 60},
}


def run() -> list[dict[str, object]]:
    """One row per method: milliseconds of the whole frame and of each stage."""
    rows: list[dict[str, object]] = []
    for name in ("rir", "vf_breadth", "vf_depth", "physim_mcts"):
        method = {"name": name, "refiner": "trimmed_icp", "iterations": 2, "exploration": 0.2}
        n_iterations, ms = staged(Toolbox(resolve({**SESSION, "method": method})), REPEATS)
        per_iteration = {"ms/iteration": ms["ms"] / n_iterations}
        rows.append({"what": f"{name}, 3 objects, {n_iterations} iterations", **ms, **per_iteration})
    return rows
