"""How one hypothesis moves on in an iteration: PIR and SIR (paper Sec. III-A, III-B), and the ablation's (Sec. V-A).

Each is a :class:`Chain`: the poses that an iteration goes through, and which of them may be accepted. What follows
(scoring, the choice between them, the answer) is the same for all chains: :mod:`verefine_viz.methods.object_method`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal, Protocol

from verefine_viz.core.arrays import Float
from verefine_viz.core.clock import clock
from verefine_viz.core.geometry import FARTHEST_M, as_rigid, distance_m, transform
from verefine_viz.core.problem import Placed, Target
from verefine_viz.core.protocols import Refiner, Simulator
from verefine_viz.core.records import SimulatedPath, Stage, StageName


@dataclass(frozen=True, eq=False)
class Draft:
    """The poses of an iteration before they are scored."""

    stages: tuple[Stage, ...]
    """After "current", in order."""
    candidates: tuple[StageName, ...]
    """Stages that may be accepted; a name without a stage (no physics) does not matter."""
    path: SimulatedPath | None = None
    lacks_physics: bool = False
    """Whether the chain includes a simulation that was not possible."""
    why_stuck: str = "no correspondence within its gate"
    """Why the refiner may have left its start pose unchanged; empty where there is no such reason."""


BeginScore = Callable[[Stage], None]
"""Begins to score a pose while its iteration is still running."""


class Chain(Protocol):
    """How a hypothesis moves on."""

    @property
    def refiner(self) -> Refiner | None: ...

    def draft(self, target: Target, T_cam_obj: Float, k: int, fixed: Sequence[Placed], begin: BeginScore) -> Draft:
        """The poses of iteration ``k`` = 1, 2, … of a hypothesis at ``T_cam_obj``.

        A pose from which others are computed may be handed to ``begin`` at once: it is scored in the meantime.
        """
        ...


def simulate(
    simulator: Simulator | None, target: Target, T_cam_obj: Float, fixed: Sequence[Placed], n_steps: int
) -> tuple[Stage, SimulatedPath] | None:
    """SIM of docs/methods.md 1.0, timed; None where physics is off or the frame has no support plane."""
    support = target.observation.support
    if simulator is None or support is None:
        return None
    started = clock()
    moving = Placed(target.instance.instance_id, target.model, T_cam_obj)
    path = simulator.settle(moving, fixed, support, n_steps)
    return Stage("simulated", as_rigid(path.T_cam_obj, "simulated pose"), ms=_ms_since(started)), path


def refined(refiner: Refiner, target: Target, T_cam_obj: Float, fixed: Sequence[Placed]) -> Stage:
    """REF of docs/methods.md 1.0, timed; a step beyond ``FARTHEST_M`` is not taken: no stage could go on from there."""
    started = clock()
    T_refined = refiner.refine(target, T_cam_obj, fixed)
    if distance_m(T_refined) > FARTHEST_M:
        T_refined = T_cam_obj
    return Stage("refined", as_rigid(T_refined, "refined pose"), ms=_ms_since(started))


def _ms_since(started: float) -> float:
    return (clock() - started) * 1e3


@dataclass(frozen=True)
class Pir:
    """Physics-guided iterative refinement (paper Sec. III-A): T_sim = SIM(T_cur); T_ref = REF([R_sim | t_cur])."""

    simulator: Simulator | None
    refiner: Refiner
    n_steps: int

    def draft(self, target: Target, T_cam_obj: Float, k: int, fixed: Sequence[Placed], begin: BeginScore) -> Draft:
        # Sec. III-A: T_cur initializes the object in the simulation, which is progressed and returns T_sim.
        settled = simulate(self.simulator, target, T_cam_obj, fixed, self.n_steps)
        if settled is None:
            return Draft((refined(self.refiner, target, T_cam_obj, fixed),), ("refined",), lacks_physics=True)
        simulated, path = settled
        begin(simulated)
        # Sec. III-A: only R_sim updates the estimate; a large displacement would lose the corresponding object parts.
        mixed = Stage("mixed", as_rigid(transform(simulated.T_cam_obj[:3, :3], T_cam_obj[:3, 3]), "mixed pose"))
        # Sec. III-A: [R_sim | t_cur] initializes one iteration of the refiner, which returns T_ref.
        after = refined(self.refiner, target, mixed.T_cam_obj, fixed)
        return Draft((simulated, mixed, after), ("refined",), path)


@dataclass(frozen=True)
class Sir:
    """Supervised iterative refinement (paper Sec. III-B): PIR that goes on with the better of T_sim and T_ref.

    The choice between the candidates is ``ObjectMethod._accepted``.
    """

    pir: Pir
    sim_candidate: Literal["full", "rotation_only"] = "full"
    """Whether the simulator's whole pose may be accepted (authors' code) or its rotation only."""

    @property
    def refiner(self) -> Refiner:
        return self.pir.refiner

    def draft(self, target: Target, T_cam_obj: Float, k: int, fixed: Sequence[Placed], begin: BeginScore) -> Draft:
        draft = self.pir.draft(target, T_cam_obj, k, fixed, begin)
        simulated: StageName = "simulated" if self.sim_candidate == "full" else "mixed"
        return replace(draft, candidates=(simulated, "refined"))


@dataclass(frozen=True)
class Refine:
    """The refiner alone: T ← REF(T)."""

    refiner: Refiner

    def draft(self, target: Target, T_cam_obj: Float, k: int, fixed: Sequence[Placed], begin: BeginScore) -> Draft:
        return Draft((refined(self.refiner, target, T_cam_obj, fixed),), ("refined",))


@dataclass(frozen=True)
class PhysBefore:
    """Ablation of Sec. V-A: T ← SIM(T) once, whole pose; then T ← REF(T)."""

    simulator: Simulator | None
    refiner: Refiner
    n_steps: int

    def draft(self, target: Target, T_cam_obj: Float, k: int, fixed: Sequence[Placed], begin: BeginScore) -> Draft:
        settled = simulate(self.simulator, target, T_cam_obj, fixed, self.n_steps) if k == 1 else None
        if settled is None:
            return Draft((refined(self.refiner, target, T_cam_obj, fixed),), ("refined",), lacks_physics=k == 1)
        simulated, path = settled
        begin(simulated)
        after = refined(self.refiner, target, simulated.T_cam_obj, fixed)
        return Draft((simulated, after), ("refined",), path)


@dataclass(frozen=True)
class PhysAfter:
    """Ablation of Sec. V-A: T ← REF(T), and after the last of the ``iterations`` T ← SIM(T), whole pose."""

    simulator: Simulator | None
    refiner: Refiner
    n_steps: int
    iterations: int

    def draft(self, target: Target, T_cam_obj: Float, k: int, fixed: Sequence[Placed], begin: BeginScore) -> Draft:
        after = refined(self.refiner, target, T_cam_obj, fixed)
        is_last = k == self.iterations
        settled = simulate(self.simulator, target, after.T_cam_obj, fixed, self.n_steps) if is_last else None
        if settled is None:
            return Draft((after,), ("refined",), lacks_physics=is_last)
        simulated, path = settled
        return Draft((after, simulated), ("simulated",), path)
