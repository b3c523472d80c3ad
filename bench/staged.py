"""Milliseconds of whole frames and of their stages."""

from __future__ import annotations

from time import perf_counter

import numpy as np

from verefine_viz.run.toolbox import Toolbox


def staged(toolbox: Toolbox, repeats: int) -> tuple[int, dict[str, float]]:
    """How many iterations the first frame takes, and the medians over ``repeats`` runs of it, after one that is not
    measured: it compiles kernels, builds colliders and search structures.
    """
    problem = toolbox.problem(toolbox.frames[0])
    toolbox.run(problem).finish()
    totals: list[float] = []
    stages: dict[str, list[float]] = {"simulated": [], "refined": [], "score": []}
    n_iterations = 0
    for _ in range(repeats):
        began = perf_counter()
        run = toolbox.run(problem)
        run.finish()
        totals.append((perf_counter() - began) * 1e3)
        n_iterations = run.length
        stages["score"].append(sum(it.score_ms for it in run.iterations))
        for stage in ("simulated", "refined"):
            stages[stage].append(sum(s.ms for it in run.iterations for s in it.stages if s.name == stage))
    medians = {f"ms {stage}": float(np.median(values)) for stage, values in stages.items()}
    return n_iterations, {"ms": float(np.median(totals)), "ms, best": min(totals), **medians}
