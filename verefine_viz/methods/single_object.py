"""The methods of one object: refiner alone, PhysBefore, PhysAfter, PIR and SIR (paper Sec. III-A, III-B, V-A)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

from verefine_viz.core.arrays import Float
from verefine_viz.core.problem import Placed, Target
from verefine_viz.core.protocols import Refiner, Simulator
from verefine_viz.core.records import StageName
from verefine_viz.methods.iteration_step import Draft, Judge, mixed, refined, simulate


@dataclass(frozen=True)
class Refine:
    """T ← REF(T)."""

    refiner: Refiner

    def draft(self, target: Target, T_cam_obj: Float, k: int, fixed: Sequence[Placed], judge: Judge) -> Draft:
        return Draft((refined(self.refiner, target, T_cam_obj, fixed),), ("refined",))


# PhysBefore: one simulation, then the refiner alone (paper Sec. V-A, ablation).


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


# PhysAfter: the refiner alone, then one simulation (paper Sec. V-A, ablation).


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


# PIR: physics-guided iterative refinement (paper Sec. III-A).
#
# Each iteration lets the object settle for a few simulation steps and starts the refiner from the rotation that
# physics
# suggests, at the translation that the refiner had found.


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


# SIR: supervised iterative refinement (paper Sec. III-B).
#
# The iteration of PIR, supervised by the verification score: the better of the simulated and the refined pose is kept,
# and the answer is the best of all poses on the way, the initial one included.


@dataclass(frozen=True)
class Sir:
    """Keeps T_ref if f(T_ref) ≥ f(T_sim), else T_sim."""

    pir: Pir
    sim_candidate: Literal["full", "rotation_only"] = "full"
    """Whether the simulator's whole pose may be kept (authors' code) or its rotation only."""

    def draft(self, target: Target, T_cam_obj: Float, k: int, fixed: Sequence[Placed], judge: Judge) -> Draft:
        # T_sim, [R_sim | t_cur] and T_ref of Sec. III-A; which one is kept: ObjectMethod._keep.
        draft = self.pir.draft(target, T_cam_obj, k, fixed, judge)
        simulated: StageName = "simulated" if self.sim_candidate == "full" else "mixed"
        return replace(draft, candidates=(simulated, "refined"))
