"""Milliseconds per SIR and RIR frame: one object at 640×480, 5 hypotheses × 5 iterations of 10 ICP iterations."""

from __future__ import annotations

from time import perf_counter

import numpy as np

from verefine_viz.session.files import resolve
from verefine_viz.session.toolbox import Toolbox

REPEATS = 20


def run() -> list[dict[str, object]]:
    """One row per method with the share of each stage."""
    rows: list[dict[str, object]] = []
    for name in ("refine", "pir", "sir", "rir"):
        toolbox = Toolbox(resolve({"method": {"name": name}, "scene": {"demo": "mug"}}))
        problem = toolbox.problem(toolbox.frames[0])
        toolbox.run(problem).finish()  # compiles kernels, builds colliders and search structures
        totals, stages = [], {"simulated": [], "refined": [], "score": []}
        for _ in range(REPEATS):
            began = perf_counter()
            run = toolbox.run(problem)
            run.finish()
            totals.append((perf_counter() - began) * 1e3)
            stages["score"].append(sum(it.score_ms for it in run.iterations))
            for stage in ("simulated", "refined"):
                stages[stage].append(sum(s.ms for it in run.iterations for s in it.stages if s.name == stage))
        rows.append(
            {
                "what": f"{name} frame, {run.length} iterations",
                "ms": float(np.median(totals)),
                "ms, best": float(min(totals)),
                **{f"ms {stage}": float(np.median(values)) for stage, values in stages.items()},
            }
        )
    return rows
