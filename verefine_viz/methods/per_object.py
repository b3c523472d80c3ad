"""Lifts a method for one object to a frame: its instances are solved one after another, each alone."""

from __future__ import annotations

from dataclasses import dataclass, replace

from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import InputError, unknown
from verefine_viz.core.problem import Problem
from verefine_viz.core.records import Best, Iteration
from verefine_viz.core.scores import Scores
from verefine_viz.methods.arms import ObjectState
from verefine_viz.methods.object_method import ObjectMethod


@dataclass(frozen=True, eq=False)
class FrameState:
    """Where a method stands with a frame."""

    problem: Problem
    objects: tuple[ObjectState | None, ...]
    """Per instance; None where it has no hypothesis."""
    n_done: int = 0

    @property
    def initial(self) -> tuple[Scores | None, ...]:
        return tuple(o.initial if o else None for o in self.objects)

    @property
    def best(self) -> tuple[Best | None, ...]:
        return tuple(o.best if o else None for o in self.objects)

    def with_object(self, i: int, state: ObjectState) -> FrameState:
        """The same with one object replaced."""
        return replace(self, objects=(*self.objects[:i], state, *self.objects[i + 1 :]))


@dataclass(frozen=True)
class PerObject:
    """Solves each instance with ``method``, in the problem's order."""

    method: ObjectMethod

    def start(self, problem: Problem) -> FrameState:
        return FrameState(problem, tuple(self.method.start(target) for target in problem.targets))

    def is_done(self, state: FrameState) -> bool:
        return self._next(state) is None

    def n_iterations(self, state: FrameState) -> int:
        return sum(self.method.n_iterations(o) for o in state.objects if o)

    def step(self, state: FrameState) -> tuple[FrameState, Iteration]:
        i = self._next(state)
        if i is None:
            raise InputError("the run is over: every object has used its budget")
        before = state.objects[i]
        assert before is not None
        after, iteration = self.method.step(before, state.n_done + 1)
        return replace(state.with_object(i, after), n_done=state.n_done + 1), iteration

    def edit(self, state: FrameState, instance_id: int, arm: int, T_cam_obj: Float) -> FrameState:
        ids = [t.instance.instance_id for t in state.problem.targets]
        if instance_id not in ids:
            raise InputError(unknown("instance", instance_id, ids))
        i = ids.index(instance_id)
        before = state.objects[i]
        if before is None:
            raise InputError(f"instance {instance_id} has no hypothesis whose pose could be changed")
        return state.with_object(i, self.method.edit(before, arm, T_cam_obj, state.n_done))

    def _next(self, state: FrameState) -> int | None:
        return next((i for i, o in enumerate(state.objects) if o and not self.method.is_done(o)), None)
