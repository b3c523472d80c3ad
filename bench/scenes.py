"""VF_d on a scene of three objects, as the paper's Extended APC experiment has it, stage by stage.

25 hypotheses per object, 2 iterations each: 150 iterations of one trimmed-ICP call and 60 simulation steps, and 50
scene scores. The authors' code takes 6.6 s for it on a machine of this kind.
"""

from __future__ import annotations

from time import perf_counter

import numpy as np

from verefine_viz.session.files import resolve
from verefine_viz.session.toolbox import Toolbox

REPEATS = 5
SESSION = {
    "scene": {"demo": "stack", "frames": ["0/0"]},
    "hypotheses": {"source": "perturb", "rotation_deg": 20.0, "translation_mm": 20.0, "max_per_object": 25},
    "physics": {"steps": 60},
}


def run() -> list[dict[str, object]]:
    """One row per method: milliseconds of the whole frame and of each stage."""
    rows: list[dict[str, object]] = []
    for name in ("rir", "vf_breadth", "vf_depth"):
        method = {"name": name, "refiner": "trimmed_icp", "iterations": 2, "exploration": 0.2}
        toolbox = Toolbox(resolve({**SESSION, "method": method}))
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
                "what": f"{name}, {len(problem.instances)} objects, {run.length} iterations",
                "ms": float(np.median(totals)),
                **{f"ms {stage}": float(np.median(values)) for stage, values in stages.items()},
                "ms/iteration": float(np.median(totals)) / run.length,
            }
        )
    return rows
