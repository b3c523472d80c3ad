"""PhysBefore: one simulation, then the refiner alone (paper Sec. V-A, ablation)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from verefine_viz.core.arrays import Float
from verefine_viz.core.problem import Placed, Target
from verefine_viz.core.protocols import Refiner, Simulator
from verefine_viz.methods.chain import Draft, Judge, refined, simulate


@dataclass(frozen=True)
class PhysBefore:
    """T ← SIM(T) once, whole pose; then T ← REF(T)."""

    simulator: Simulator | None
    refiner: Refiner
    n_steps: int

    def draft(self, target: Target, T_cam_obj: Float, k: int, fixed: Sequence[Placed], judge: Judge) -> Draft:
        settled = simulate(self.simulator, target, T_cam_obj, fixed, self.n_steps) if k == 1 else None
        if settled is None:
            return Draft((refined(self.refiner, target, T_cam_obj, fixed),), ("refined",), lacks_physics=k == 1)
        simulated, path = settled
        judge(simulated)
        after = refined(self.refiner, target, simulated.T_cam_obj, fixed)
        return Draft((simulated, after), ("refined",), path)
