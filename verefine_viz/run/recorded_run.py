"""Replays a record in the form of a method: every iteration as it was written, nothing computed again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import InputError
from verefine_viz.core.problem import Problem, Target
from verefine_viz.core.records import Iteration
from verefine_viz.core.scores import PoseScore, Scores
from verefine_viz.methods.arms import AcceptedPose, Arm, ObjectState
from verefine_viz.methods.per_object import FrameState
from verefine_viz.run.record import RunRecord


class ReplayedMethod:
    """A method whose steps were recorded before."""

    refiner = None
    """A record holds the results of the refiner, not the refiner."""

    def __init__(self, record: RunRecord) -> None:
        self._record = record
        self._iterations = record.iterations

    def start(self, problem: Problem) -> FrameState:
        """The state before the first iteration.

        Raises:
            InputError: the frame lacks a recorded object.
        """
        problem = problem.only(self._instances(problem))
        if self._record.missing:
            problem = replace(problem, notes=(*problem.notes, self._record.missing))
        return FrameState(problem, tuple(map(self._start, problem.targets)))

    def step(self, state: FrameState) -> tuple[FrameState, Iteration]:
        iteration = self._iterations[state.n_done]
        ids = [i.instance_id for i in state.problem.instances]
        k = ids.index(iteration.instance_id)
        before = state.objects[k]
        assert before is not None
        return state.with_object(k, _after(before, iteration), state.n_done + 1), iteration

    def is_done(self, state: FrameState) -> bool:
        return state.n_done >= len(self._iterations)

    def n_iterations(self, state: FrameState) -> int:
        return len(self._iterations)

    def _instances(self, problem: Problem) -> Sequence[int]:
        """The recorded instances, as they are in the frame now."""
        here = {i.instance_id: i for i in problem.instances}
        for one in self._record.header.objects:
            instance = here.get(one.instance_id)
            if instance is None or instance.obj_id != one.obj_id:
                raise InputError(
                    f"the run was made of {one.name} (#{one.instance_id}), which frame {problem.frame} does not hold "
                    "(any more)"
                )
            if len(one.initial) != len(one.hypotheses):
                raise InputError(f"the run holds initial poses of {one.name} alone, without scores; open its session")
            if len(instance.hypotheses) != len(one.hypotheses):
                raise InputError(
                    f"the run was made from {len(one.hypotheses)} initial poses of {one.name}, its session now gives "
                    f"{len(instance.hypotheses)}: the results files or the data set have changed since"
                )
        return [one.instance_id for one in self._record.header.objects]

    def _start(self, target: Target) -> ObjectState | None:
        own = target.instance.instance_id
        recorded = next(one for one in self._record.header.objects if one.instance_id == own)
        if not recorded.hypotheses:
            return None
        pairs = zip(recorded.hypotheses, recorded.initial, strict=True)
        entries = [AcceptedPose(h.T_cam_obj, score, "initial", 0) for h, score in pairs]
        arms = tuple(Arm((entry,), 1.0, entry.score.score) for entry in entries)
        if not any(i.choice for i in self._iterations if i.instance_id == own):
            arms = arms[:1]  # A method without a choice uses only the first hypothesis.
        first = int(np.argmax([arm.mean for arm in arms]))
        return ObjectState(target, _columns(recorded.initial), arms, entries[first].as_best(first))


def _columns(scores: Sequence[PoseScore]) -> Scores:
    def column(name: str, kind: type) -> np.ndarray:
        return np.array([getattr(score, name) for score in scores], kind)

    def term(name: str) -> Float | None:
        return column(name, float) if any(getattr(score, name) is not None for score in scores) else None

    fits = [column(name, float) for name in ("score", "depth_fit", "normal_fit")]
    pixels = [column(name, int) for name in ("n_pixels", "n_rendered", "counts")]
    return Scores(
        *fits,
        *pixels,
        colour_fit=term("colour_fit"),
        colour_weight=scores[0].colour_weight,
        plausibility=term("plausibility"),
        plausibility_weight=scores[0].plausibility_weight,
    )


def _after(before: ObjectState, iteration: Iteration) -> ObjectState:
    """An object's state after one more of its iterations."""
    accepted, choice, j = iteration.accepted_stage, iteration.choice, iteration.arm
    arms = list(before.arms)
    if choice is not None and len(choice.plays) == len(arms):
        numbers = zip(arms, choice.plays.tolist(), choice.mean.tolist(), strict=True)
        arms = [replace(arm, plays=plays, mean=mean) for arm, plays, mean in numbers]
    if j < len(arms):
        score = accepted.score or arms[j].current.score
        arm = arms[j].advanced(AcceptedPose(accepted.T_cam_obj, score, accepted.name, iteration.index))
        scores = [s.score.score for s in iteration.stages[1:] if s.score is not None]
        arms[j] = arm.rewarded(max(scores)) if scores else arm
    return replace(
        before, arms=tuple(arms), best=iteration.best, n_done=before.n_done + 1, last_arm=min(j, len(arms) - 1)
    )
