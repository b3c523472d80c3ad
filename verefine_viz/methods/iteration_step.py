"""One iteration of one hypothesis: which poses it goes through, and which of them it keeps."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from time import perf_counter
from typing import Protocol

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import FARTHEST_M, distance_m
from verefine_viz.core.problem import Placed, Target
from verefine_viz.core.protocols import Refiner, Simulator, Verifier
from verefine_viz.core.records import SimulatedPath, Stage, StageName
from verefine_viz.core.scores import Scores


@dataclass(frozen=True, eq=False)
class Draft:
    """The poses of an iteration before they are judged."""

    stages: tuple[Stage, ...]
    """After "current", in order."""
    candidates: tuple[StageName, ...]
    """Those that may be kept; a name without a stage (no physics) does not matter."""
    path: SimulatedPath | None = None
    lacks_physics: bool = False
    """Whether a simulation belongs here but was not possible."""


Judge = Callable[[Stage], None]
"""Begins to score a pose of an iteration that is still going on."""


class Chain(Protocol):
    """How a hypothesis moves on."""

    def draft(self, target: Target, T_cam_obj: Float, k: int, fixed: Sequence[Placed], judge: Judge) -> Draft:
        """The poses of iteration ``k`` = 1, 2, … of a hypothesis that is at ``T_cam_obj``.

        A pose that others are computed from may be given to ``judge`` right away: it is then scored meanwhile.
        """
        ...


def simulate(
    simulator: Simulator | None, target: Target, T_cam_obj: Float, fixed: Sequence[Placed], n_steps: int
) -> tuple[Stage, SimulatedPath] | None:
    """SIM of docs/methods.md 1.0, timed; None where physics is off or the frame has no support plane."""
    support = target.observation.support
    if simulator is None or support is None:
        return None
    began = perf_counter()
    moving = Placed(target.instance.instance_id, target.model, T_cam_obj)
    path = simulator.settle(moving, fixed, support, n_steps)
    return Stage("simulated", path.T_cam_obj, ms=_since(began)), path


def refined(refiner: Refiner, target: Target, T_cam_obj: Float, fixed: Sequence[Placed]) -> Stage:
    """REF of docs/methods.md 1.0, timed; a step beyond ``FARTHEST_M`` is not taken: nothing could go on there."""
    began = perf_counter()
    T_refined = refiner.refine(target, T_cam_obj, fixed)
    if distance_m(T_refined) > FARTHEST_M:
        T_refined = T_cam_obj
    return Stage("refined", T_refined, ms=_since(began))


def mixed(simulated: Stage, T_cam_obj: Float) -> Stage:
    """The simulated rotation with the current translation: [R_sim | t_cur] (paper Sec. III-A)."""
    T = np.array(simulated.T_cam_obj)
    T[:3, 3] = T_cam_obj[:3, 3]
    return Stage("mixed", T)


def _since(began: float) -> float:
    return (perf_counter() - began) * 1e3


# The scores of one iteration's poses; what others are computed from is scored meanwhile.


@dataclass(frozen=True, eq=False)
class Judging:
    """Judges the poses of one iteration."""

    verifier: Verifier
    target: Target
    placed: Sequence[Placed]
    """Other objects, which may hide parts."""
    _begun: dict[StageName, Callable[[], Scores]] = field(default_factory=dict)

    def begin(self, stage: Stage) -> None:
        """Has a pose scored while the next one is computed, where the verifier can do that."""
        scores = self.verifier.begin(self.target, stage.T_cam_obj[None], self.placed)
        if scores is not None:
            self._begun[stage.name] = scores

    def judged(self, draft: Draft) -> tuple[Stage, ...]:
        """The stages with their scores: what was begun, and one call for all others.

        The mixed pose is judged only where it may be kept, since it only starts the refiner.
        """
        not_judged = () if "mixed" in draft.candidates else ("mixed",)
        left = [s for s in draft.stages if s.name not in (*self._begun, *not_judged)]
        scores = self.verifier.score(self.target, np.array([s.T_cam_obj for s in left]), self.placed)
        of_stage = {s.name: scores[i] for i, s in enumerate(left)}
        of_stage |= {name: begun()[0] for name, begun in self._begun.items()}
        return tuple(s.judged(of_stage.get(s.name)) for s in draft.stages)
