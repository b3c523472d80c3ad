"""The dependency graph as a record: what is left of it with fewer instances."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from verefine_viz.core.problem import DependencyGraph, Edge

GRAPH = DependencyGraph(
    (Edge("support", 3, 1, 0.8, "64 % of its footprint"), Edge("occlusion", 2, 3, 0.4, "22 mm nearer")),
    ((3, 1, 2), (4,)),
    ((3, 1), (2,), (4,)),
    "recommended",
)


def test_the_order_runs_through_the_clusters() -> None:
    assert GRAPH.order == (3, 1, 2, 4)
    assert [GRAPH.cluster_of(i) for i in (1, 2, 3, 4)] == [0, 0, 0, 1]


@given(st.sets(st.integers(1, 4)))
def test_fewer_instances_keep_their_order_and_the_edges_among_them(kept: set[int]) -> None:
    graph = GRAPH.only(kept)
    assert graph.order == tuple(i for i in GRAPH.order if i in kept)
    assert all(graph.clusters)
    assert all(graph.support_lists)
    assert set(graph.edges) == {e for e in GRAPH.edges if {e.first, e.second} <= kept}
