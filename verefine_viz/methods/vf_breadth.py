"""VF_b: verification over the scene, breadth first (paper Sec. IV-B).

Objects are solved in dependency order, each by RIR with its whole budget. What was solved before stands in the
simulation, lets the refiner leave out the points it explains, and may hide parts of what comes after.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from verefine_viz.core.problem import Placed, Problem
from verefine_viz.methods.per_object import FrameState, PerObject


def clusters_of(problem: Problem) -> tuple[tuple[int, ...], ...]:
    """The clusters as indices into ``problem.instances``, each in dependency order."""
    index_of = {instance.instance_id: i for i, instance in enumerate(problem.instances)}
    return tuple(tuple(index_of[k] for k in cluster) for cluster in problem.clusters)


@dataclass(frozen=True)
class VfBreadth(PerObject):
    """RIR per object in dependency order, among the objects solved before."""

    carry_clusters: bool = True
    """Whether earlier clusters stay as well, or only what belongs to the same cluster (docs/methods.md 1.8.16)."""

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
