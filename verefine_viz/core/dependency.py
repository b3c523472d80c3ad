"""Which objects of a frame depend on which, and the order in which they are therefore solved. docs/methods.md 2."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from typing import Literal

EdgeKind = Literal["contact", "occlusion", "support"]
EdgeState = Literal["used", "ambiguous", "cut"]


@dataclass(frozen=True)
class Edge:
    """Two instances that have to do with each other, and how one can tell."""

    kind: EdgeKind
    """contact: they may touch. occlusion: ``first`` hides part of ``second``. support: ``first`` carries ``second``."""
    first: int
    """instance_id; the lower of the two for contact."""
    second: int
    strength: float
    """What decides which edge of a cycle is weakest, in [0, 1]."""
    evidence: str
    """With numbers and units: "5 mm apart", "64 % of its footprint, 2 mm above"."""
    state: EdgeState = "used"
    """ambiguous: part of a cycle and its weakest edge, so left out of the order. cut: left out by a person."""


@dataclass(frozen=True)
class DependencyGraph:
    """The edges and what follows from them."""

    edges: tuple[Edge, ...]
    clusters: tuple[tuple[int, ...], ...]
    """Groups of instances that may interact, front to back; each in the order to solve it: a supporter comes before
    what it carries. Every instance of the problem appears once."""
    support_lists: tuple[tuple[int, ...], ...]
    """Each a base object and what it carries, in the order of ``clusters``."""
    source: Literal["recommended", "published", "given"]
    notes: tuple[str, ...] = ()
    """What a person should know: cycles, ids in a given order that are not in the frame, …"""

    @property
    def order(self) -> tuple[int, ...]:
        """All instances in the order to solve them."""
        return tuple(i for cluster in self.clusters for i in cluster)

    def cluster_of(self, instance_id: int) -> int:
        """Index of the instance's cluster."""
        return next(k for k, cluster in enumerate(self.clusters) if instance_id in cluster)

    def only(self, instance_ids: Collection[int]) -> DependencyGraph:
        """The same without the other instances; a cluster may fall to fewer, but is not split."""
        clusters = tuple(tuple(i for i in cluster if i in instance_ids) for cluster in self.clusters)
        lists = tuple(tuple(i for i in carried if i in instance_ids) for carried in self.support_lists)
        edges = tuple(e for e in self.edges if e.first in instance_ids and e.second in instance_ids)
        return replace(
            self, edges=edges, clusters=tuple(filter(None, clusters)), support_lists=tuple(filter(None, lists))
        )
