"""Lifts a method for one object to a frame: its instances are solved one after another, each alone or, as VF_b, among
those solved before (paper Sec. IV-B).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import InputError, unknown
from verefine_viz.core.problem import Placed, Problem
from verefine_viz.core.protocols import Refiner, Verifier
from verefine_viz.core.records import Best, Iteration
from verefine_viz.core.scores import Scores
from verefine_viz.methods.arms import ObjectState
from verefine_viz.methods.object_method import ObjectMethod


def clusters_of(problem: Problem) -> tuple[tuple[int, ...], ...]:
    """The clusters as indices into ``problem.instances``, each in dependency order."""
    index_of = {instance.instance_id: i for i, instance in enumerate(problem.instances)}
    return tuple(tuple(index_of[k] for k in cluster) for cluster in problem.clusters)


@dataclass(frozen=True, eq=False)
class FrameState:
    """State of a method in a frame."""

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
        """The state with one object replaced, and ``n_done`` iterations made where that is given."""
        objects = (*self.objects[:i], state, *self.objects[i + 1 :])
        return replace(self, objects=objects, n_done=self.n_done if n_done is None else n_done)

    def placed(self, i: int) -> Placed:
        """The i-th instance, placed at its answer so far."""
        target, best = self.problem.targets[i], self.best[i]
        assert best is not None, f"instance {target.instance.instance_id} has no pose"
        return Placed(target.instance.instance_id, target.model, best.T_cam_obj)

    def object_to_edit(self, instance_id: int) -> tuple[int, ObjectState]:
        """Index and state of an instance.

        Raises:
            InputError: there is no such instance, or it has no hypothesis.
        """
        ids = [t.instance.instance_id for t in self.problem.targets]
        if instance_id not in ids:
            raise InputError(unknown("instance", instance_id, ids))
        i = ids.index(instance_id)
        o = self.objects[i]
        if o is None:
            raise InputError(f"instance {instance_id} has no hypothesis whose pose could be changed")
        return i, o


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
            before = self.method.rescored(before, fixed)
        after, iteration = self.method.step(before, state.n_done + 1, fixed)
        if i != self._turns(state)[0]:  # Objects before it may still move; it is then scored among them again.
            after = replace(after, was_ahead=True)
        return state.with_object(i, after, state.n_done + 1), iteration

    def edit(self, state: FrameState, instance_id: int, arm: int, T_cam_obj: Float) -> FrameState:
        state = self._adopted(state)
        i, before = state.object_to_edit(instance_id)
        fixed = self._fixed(state, i)
        return state.with_object(i, self.method.edit(before, arm, T_cam_obj, state.n_done, fixed))

    @property
    def verifier(self) -> Verifier:
        return self.method.verifier

    @property
    def refiner(self) -> Refiner | None:
        return self.method.chain.refiner

    def rescored(self, state: FrameState) -> FrameState:
        state = self._adopted(state)
        for i in self._order(state.problem):
            o = state.objects[i]
            if o:
                # An object that was not begun yet is still scored alone.
                fixed = self._fixed(state, i) if o.n_done else ()
                state = state.with_object(i, self.method.rescored(o, fixed))
        return state

    def _adopted(self, state: FrameState) -> FrameState:
        """The state in this method's form; another method may have made it, since a fork may change the method."""
        return state if type(state) is FrameState else FrameState(state.problem, state.objects, state.n_done)

    def _order(self, problem: Problem) -> Sequence[int]:
        """The instances, as indices, in the order to solve them."""
        return range(len(problem.instances))

    def _fixed(self, state: FrameState, i: int) -> tuple[Placed, ...]:
        """Objects that stand in the scene while the i-th instance is worked on."""
        return ()

    def _turns(self, state: FrameState) -> list[int]:
        """The instances whose budget is not used, in the order to solve them."""
        return [i for i in self._order(state.problem) if (o := state.objects[i]) and not self.method.is_done(o)]

    def _next(self, state: FrameState) -> int | None:
        """The first in turn; one with an edited pose goes first for one iteration."""
        turns = self._turns(state)
        edited = [i for i in turns if (o := state.objects[i]) and o.edited_arms]
        return next(iter((*edited, *turns)), None)


@dataclass(frozen=True)
class VfBreadth(PerObject):
    """VF_b, VeREFINE breadth (paper Sec. IV-B): RIR per object in dependency order.

    What was solved before stands in the simulation, lets the refiner leave out the points it explains, and may hide
    parts of what comes after.
    """

    carry_clusters: bool = True
    """Whether objects of earlier clusters stay too, or only those of the same cluster (docs/methods.md 1.8.16)."""

    def _order(self, problem: Problem) -> Sequence[int]:
        # Sec. IV-B: one RIR bandit per object of the dependency list, one after the other.
        return [i for cluster in clusters_of(problem) for i in cluster]

    def _fixed(self, state: FrameState, i: int) -> tuple[Placed, ...]:
        # Sec. IV-B: the environment is what was computed so far, each object at its best pose.
        before: list[int] = []
        for cluster in clusters_of(state.problem):
            if i in cluster:
                before += cluster[: cluster.index(i)]
                break
            before += cluster if self.carry_clusters else ()
        return tuple(state.placed(k) for k in before if state.objects[k])
