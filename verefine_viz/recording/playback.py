"""A recording as a run: every iteration as it was written, nothing computed again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import InputError
from verefine_viz.core.problem import Problem, Target
from verefine_viz.core.records import Best, Iteration
from verefine_viz.core.scores import Scores
from verefine_viz.methods.arms import Arm, Entry, ObjectState
from verefine_viz.recording.reader import Recorded
from verefine_viz.run.engine import Run


@dataclass(frozen=True, eq=False)
class PlayedState:
    """Where a recording is after some of its iterations."""

    problem: Problem
    objects: tuple[ObjectState | None, ...]
    """Per instance; None where it had no hypothesis."""
    n_done: int = 0

    @property
    def initial(self) -> tuple[Scores | None, ...]:
        return tuple(o.initial if o else None for o in self.objects)

    @property
    def best(self) -> tuple[Best | None, ...]:
        return tuple(o.best if o else None for o in self.objects)


class Playback:
    """Steps through the iterations of a recording as a method steps through a run."""

    refiner = None
    """A recording has what came out of the refiner, not the refiner."""

    def __init__(self, recorded: Recorded) -> None:
        self._recorded = recorded
        self._iterations = recorded.iterations

    def start(self, problem: Problem) -> PlayedState:
        return PlayedState(problem, tuple(self._start(target) for target in problem.targets))

    def step(self, state: PlayedState) -> tuple[PlayedState, Iteration]:
        if self.is_done(state):
            raise InputError(f"{self._recorded.path.name} ends here")
        iteration = self._iterations[state.n_done]
        ids = [i.instance_id for i in state.problem.instances]
        k = ids.index(iteration.instance_id)
        before = state.objects[k]
        assert before is not None
        objects = (*state.objects[:k], _after(before, iteration), *state.objects[k + 1 :])
        return replace(state, objects=objects, n_done=state.n_done + 1), iteration

    def is_done(self, state: PlayedState) -> bool:
        return state.n_done >= len(self._iterations)

    def n_iterations(self, state: PlayedState) -> int:
        return len(self._iterations)

    def edit(self, state: PlayedState, instance_id: int, arm: int, T_cam_obj: Float) -> PlayedState:
        raise InputError(
            f"{self._recorded.path.name} is a recording and stays as it is; open its session to go on from a pose"
        )

    def _start(self, target: Target) -> ObjectState | None:
        hypotheses, scores = target.instance.hypotheses, self._initial(target)
        if not hypotheses:
            return None
        entries = [Entry(h.T_cam_obj, scores[j], "initial", 0) for j, h in enumerate(hypotheses)]
        arms = tuple(Arm((entry,), 1.0, entry.score.score) for entry in entries)
        own = [i for i in self._iterations if i.instance_id == target.instance.instance_id]
        if not any(i.choice for i in own):  # A method without a choice uses the first only.
            arms = arms[:1]
        first = int(np.argmax([arm.mean for arm in arms]))
        entry = entries[first]
        return ObjectState(target, scores, arms, Best(entry.T_cam_obj, entry.score, first, 0, "initial"))

    def _initial(self, target: Target) -> Scores:
        branch = self._recorded.layout.branch(target.instance.instance_id)
        values = np.array(branch.initial, np.float64).reshape(-1, 10)
        pixels = values[:, 3:].astype(np.int64)
        return Scores(values[:, 0], values[:, 1], values[:, 2], pixels[:, 0], pixels[:, 1], pixels[:, 2:])


def played(recorded: Recorded, problem: Problem) -> Run:
    """The recorded run, complete, with the cursor before its first iteration.

    Args:
        recorded: what was read.
        problem: the recorded frame.

    Raises:
        InputError: the frame does not hold what was recorded.
    """
    problem = problem.only(_recorded_instances(recorded, problem))
    if not recorded.is_complete:
        problem = replace(problem, notes=(*problem.notes, _ended_early(recorded)))
    run = Run(cast(Any, Playback(recorded)), problem)
    run.finish()
    run.seek(0)
    return run


def _ended_early(recorded: Recorded) -> str:
    n = len(recorded.entries)
    left = "1 iteration is in it" if n == 1 else f"{n or 'no'} iterations are in it"
    return f"the recording ended early (it was stopped or cut off); {left}"


def _recorded_instances(recorded: Recorded, problem: Problem) -> Sequence[int]:
    """The instances that were recorded, all of them as the frame has them now."""
    name = recorded.path.name
    here = {i.instance_id: i for i in problem.instances}
    for branch in recorded.layout.branches:
        instance = here.get(branch.instance_id)
        if instance is None or instance.obj_id != branch.obj_id:
            raise InputError(f"{name} was made of {branch.name}, which frame {problem.frame} does not hold (any more)")
        if len(instance.hypotheses) != branch.n_arms:
            raise InputError(
                f"{name} was made from {branch.n_arms} initial poses of {branch.name}, its session now gives "
                f"{len(instance.hypotheses)}: the results files or the data set have changed since"
            )
    return [b.instance_id for b in recorded.layout.branches]


def _after(before: ObjectState, iteration: Iteration) -> ObjectState:
    """An object's state after one more of its iterations."""
    accepted, choice, j = iteration.accepted_stage, iteration.choice, iteration.arm
    arms = list(before.arms)
    if choice is not None and len(choice.plays) == len(arms):
        numbers = zip(arms, choice.plays.tolist(), choice.mean.tolist(), strict=True)
        arms = [replace(arm, plays=plays, mean=mean) for arm, plays, mean in numbers]
    if j < len(arms):
        score = accepted.score or arms[j].current.score
        arm = arms[j].advanced(Entry(accepted.T_cam_obj, score, accepted.name, iteration.index))
        scores = [s.score.score for s in iteration.stages[1:] if s.score is not None]
        arms[j] = arm.rewarded(max(scores)) if scores else arm
    return replace(
        before, arms=tuple(arms), best=iteration.best, n_done=before.n_done + 1, last_arm=min(j, len(arms) - 1)
    )
