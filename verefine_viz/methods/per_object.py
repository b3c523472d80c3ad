"""Lifts a method for one object to a frame: its instances are solved one after another, each alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import InputError, unknown
from verefine_viz.core.problem import Placed, Problem
from verefine_viz.core.protocols import Verifier
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

    def with_object(self, i: int, state: ObjectState, n_done: int | None = None) -> Self:
        """The same with one object replaced, and ``n_done`` iterations made where that is given."""
        objects = (*self.objects[:i], state, *self.objects[i + 1 :])
        return replace(self, objects=objects, n_done=self.n_done if n_done is None else n_done)

    def placed(self, i: int) -> Placed:
        """The i-th instance where its answer so far puts it."""
        target, best = self.problem.targets[i], self.best[i]
        assert best is not None, f"instance {target.instance.instance_id} has no pose"
        return Placed(target.instance.instance_id, target.model, best.T_cam_obj)


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
        state = self._adopted(state)
        i = self._next(state)
        if i is None:
            raise InputError("the run is over: every object has used its budget")
        fixed, before = self._fixed(state, i), state.objects[i]
        assert before is not None
        if fixed and (before.n_done == 0 or before.was_ahead):
            before = self.method.judged_anew(before, fixed)
        after, iteration = self.method.step(before, state.n_done + 1, fixed)
        if i != self._turns(state)[0]:  # The objects before it may move yet: then it is judged among them again.
            after = replace(after, was_ahead=True)
        return state.with_object(i, after, state.n_done + 1), iteration

    def edit(self, state: FrameState, instance_id: int, arm: int, T_cam_obj: Float) -> FrameState:
        state = self._adopted(state)
        ids = [t.instance.instance_id for t in state.problem.targets]
        if instance_id not in ids:
            raise InputError(unknown("instance", instance_id, ids))
        i = ids.index(instance_id)
        before = state.objects[i]
        if before is None:
            raise InputError(f"instance {instance_id} has no hypothesis whose pose could be changed")
        fixed = self._fixed(state, i)
        return state.with_object(i, self.method.edit(before, arm, T_cam_obj, state.n_done, fixed))

    @property
    def verifier(self) -> Verifier:
        return self.method.verifier

    def judged_anew(self, state: FrameState) -> FrameState:
        state = self._adopted(state)
        for i in self._order(state.problem):
            o = state.objects[i]
            if o:
                # What was not begun yet is still judged alone.
                fixed = self._fixed(state, i) if o.n_done else ()
                state = state.with_object(i, self.method.judged_anew(o, fixed))
        return state

    def _adopted(self, state: FrameState) -> FrameState:
        """The state as this method keeps it, where another method made it: a fork may change the method."""
        return state if type(state) is FrameState else FrameState(state.problem, state.objects, state.n_done)

    def _order(self, problem: Problem) -> Sequence[int]:
        """The instances, as indices, in the order to solve them."""
        return range(len(problem.instances))

    def _fixed(self, state: FrameState, i: int) -> tuple[Placed, ...]:
        """What stands in the scene while the i-th instance is worked on."""
        return ()

    def _turns(self, state: FrameState) -> list[int]:
        """The instances whose budget is not used, in the order to solve them."""
        return [i for i in self._order(state.problem) if (o := state.objects[i]) and not self.method.is_done(o)]

    def _next(self, state: FrameState) -> int | None:
        """The first in turn; one with a pose that was moved by hand goes ahead for an iteration."""
        turns = self._turns(state)
        moved = [i for i in turns if (o := state.objects[i]) and o.by_hand]
        return next(iter((*moved, *turns)), None)
