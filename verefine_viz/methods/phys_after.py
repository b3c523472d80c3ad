"""PhysAfter: the refiner alone, then one simulation (paper Sec. V-A, ablation)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from verefine_viz.core.arrays import Float
from verefine_viz.core.problem import Placed, Target
from verefine_viz.core.protocols import Refiner, Simulator
from verefine_viz.methods.chain import Draft, Judge, refined, simulate


@dataclass(frozen=True)
class PhysAfter:
    """T ← REF(T), and after the last of the ``iterations`` T ← SIM(T), whole pose."""

    simulator: Simulator | None
    refiner: Refiner
    n_steps: int
    iterations: int

    def draft(self, target: Target, T_cam_obj: Float, k: int, fixed: Sequence[Placed], judge: Judge) -> Draft:
        after = refined(self.refiner, target, T_cam_obj, fixed)
        is_last = k == self.iterations
        settled = simulate(self.simulator, target, after.T_cam_obj, fixed, self.n_steps) if is_last else None
        if settled is None:
            return Draft((after,), ("refined",), lacks_physics=is_last)
        simulated, path = settled
        return Draft((after, simulated), ("simulated",), path)
