"""PIR: physics-guided iterative refinement (paper Sec. III-A).

Each iteration lets the object settle for a few simulation steps and starts the refiner from the rotation that physics
suggests, at the translation that the refiner had found.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from verefine_viz.core.arrays import Float
from verefine_viz.core.problem import Placed, Target
from verefine_viz.core.protocols import Refiner, Simulator
from verefine_viz.methods.chain import Draft, Judge, mixed, refined, simulate


@dataclass(frozen=True)
class Pir:
    """T_sim = SIM(T); T ← REF([R_sim | t])."""

    simulator: Simulator | None
    refiner: Refiner
    n_steps: int

    def draft(self, target: Target, T_cam_obj: Float, k: int, fixed: Sequence[Placed], judge: Judge) -> Draft:
        settled = simulate(self.simulator, target, T_cam_obj, fixed, self.n_steps)
        if settled is None:
            return Draft((refined(self.refiner, target, T_cam_obj, fixed),), ("refined",), lacks_physics=True)
        simulated, path = settled
        judge(simulated)
        # Only the rotation is taken over: a large simulated shift would lose the corresponding parts (Sec. III-A).
        start = mixed(simulated, T_cam_obj)
        after = refined(self.refiner, target, start.T_cam_obj, fixed)
        return Draft((simulated, start, after), ("refined",), path)
