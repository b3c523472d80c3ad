"""Method ``trace``: the steps that another program recorded, each scored by our verifier (docs/methods.md 1.12)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from verefine_viz.core.arrays import Float
from verefine_viz.core.problem import ANSWER, Placed, RecordedStep, Target
from verefine_viz.core.protocols import Verifier
from verefine_viz.core.records import Choice, Stage
from verefine_viz.methods.arms import ObjectState
from verefine_viz.methods.bandit import fixed_choice
from verefine_viz.methods.object_method import ObjectMethod
from verefine_viz.methods.single_object import BeginScore, Draft


def next_step(state: ObjectState) -> RecordedStep | None:
    """The first recorded step that its hypothesis has not taken yet; None after the last."""
    taken = Counter[int]()
    for step in state.target.instance.recorded:
        taken[step.hypothesis] += 1
        if taken[step.hypothesis] > state.arms[step.hypothesis].n_iterations:
            return step
    return None


class AsRecorded:
    """Chooses the hypothesis that the next recorded step worked on."""

    def choose(self, state: ObjectState) -> Choice:
        step = next_step(state)
        if step is None:
            return fixed_choice(state, 0, "no step is left")
        return fixed_choice(state, step.hypothesis, f"the recorded step “{step.name}”")


class NoSteps:
    """The chain of a hypothesis whose recorded steps are all taken: it stays where it is."""

    refiner = None

    def draft(self, target: Target, T_cam_obj: Float, k: int, fixed: Sequence[Placed], begin: BeginScore) -> Draft:
        return Draft((Stage("refined", T_cam_obj),), ("refined",), why_stuck="nothing was recorded for it")


@dataclass(frozen=True)
class TraceMethod(ObjectMethod):
    """Takes the recorded poses one after the other; the answer is the last one, as the program answered."""

    def n_iterations(self, state: ObjectState) -> int:
        return len(state.target.instance.recorded)

    def is_done(self, state: ObjectState) -> bool:
        return next_step(state) is None

    def _draft(self, state: ObjectState, j: int, fixed: Sequence[Placed], begin: BeginScore) -> Draft:
        own = [step for step in state.target.instance.recorded if step.hypothesis == j]
        k = state.arms[j].n_iterations
        if k >= len(own):  # An edited pose is played, for which nothing was recorded.
            return super()._draft(state, j, fixed, begin)
        why_stuck = "" if own[k].name == ANSWER else "the recorded step leaves the pose"
        return Draft((Stage("refined", own[k].T_cam_obj, ms=own[k].ms),), ("refined",), why_stuck=why_stuck)


def recorded_steps(verifier: Verifier) -> TraceMethod:
    """The method for one object. Its budget is what was recorded."""
    return TraceMethod(NoSteps(), verifier, 1, AsRecorded(), answer_is_best_scored=False)
