"""Laws of clusters and order, on random edges."""

from __future__ import annotations

import networkx
import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.sparse.csgraph import csgraph_from_dense, reverse_cuthill_mckee

from verefine_viz.core.problem import Edge
from verefine_viz.observation.dependency_order import connected, cut_between, cut_by_cuthill_mckee, ordered

Case = tuple[dict[int, float], tuple[Edge, ...]]


@st.composite
def cases(draw: st.DrawFn) -> Case:
    ids = draw(st.lists(st.integers(0, 40), min_size=1, max_size=8, unique=True))
    depths_m = {i: draw(st.sampled_from((0.5, 0.7, 0.9, 1.2))) for i in ids}
    if len(ids) < 2:
        return depths_m, ()
    edges = []
    for _ in range(draw(st.integers(0, 14))):
        kind = draw(st.sampled_from(("contact", "occlusion", "support", "support")))
        a, b = draw(st.permutations(ids))[:2]
        first, second = (min(a, b), max(a, b)) if kind == "contact" else (a, b)
        if not any((e.kind, e.first, e.second) == (kind, first, second) for e in edges):
            edges.append(Edge(kind, first, second, draw(st.sampled_from((0.2, 0.5, 0.5, 0.9))), "seen"))
    return depths_m, tuple(edges)


def brute_force_components(ids: set[int], pairs: set[frozenset[int]]) -> set[frozenset[int]]:
    """Merges whatever shares a pair until nothing changes."""
    groups = {frozenset((i,)) for i in ids}
    while True:
        joined = next(((a, b) for a in groups for b in groups if a != b and any(p & a and p & b for p in pairs)), None)
        if joined is None:
            return groups
        groups = groups - set(joined) | {joined[0] | joined[1]}


@given(cases())
def test_each_instance_comes_once_what_carries_first_in_the_cluster_it_is_connected_with(case: Case) -> None:
    found = ordered(*case)
    in_order = [i for cluster in found.clusters for i in cluster]
    assert sorted(in_order) == sorted(case[0])
    assert [i for chain in found.support_lists for i in chain] == in_order
    at = {i: k for k, i in enumerate(in_order)}
    used = [e for e in found.edges if e.kind == "support" and e.state == "used"]
    assert all(at[edge.first] < at[edge.second] for edge in used)
    pairs = {frozenset((e.first, e.second)) for e in case[1]}
    assert {frozenset(c) for c in found.clusters} == brute_force_components(set(case[0]), pairs)


@given(cases(), st.randoms(use_true_random=False))
def test_the_order_of_the_input_does_not_matter(case: Case, random: object) -> None:
    depths_m, edges = case
    ids, shuffled = list(depths_m), list(edges)
    random.shuffle(ids)  # type: ignore[attr-defined]
    random.shuffle(shuffled)  # type: ignore[attr-defined]
    assert ordered({i: depths_m[i] for i in ids}, shuffled) == ordered(depths_m, edges)


@given(cases(), st.data())
def test_cutting_only_ever_splits(case: Case, data: st.DataObject) -> None:
    depths_m, edges = case
    pairs = sorted({(e.first, e.second) for e in edges})
    few = data.draw(st.lists(st.sampled_from(pairs), unique=True)) if pairs else []
    more = few + (data.draw(st.lists(st.sampled_from(pairs))) if pairs else [])
    whole = ordered(depths_m, cut_between(edges, few))
    split = ordered(depths_m, cut_between(edges, [(b, a) for a, b in more]))
    assert all(any(set(part) <= set(group) for group in whole.clusters) for part in split.clusters)
    assert {(e.first, e.second) for e in whole.edges if e.state == "cut"} >= set(few)


@given(cases())
def test_a_circle_loses_its_weakest_edges_and_nothing_else_is_left_out(case: Case) -> None:
    found = ordered(*case)
    used = [(e.first, e.second) for e in found.edges if e.kind == "support" and e.state == "used"]
    assert networkx.is_directed_acyclic_graph(networkx.DiGraph(used))
    support = networkx.DiGraph([(e.first, e.second) for e in found.edges if e.kind == "support"])
    for edge in found.edges:
        if edge.state == "ambiguous":
            assert edge.kind == "support"
            circle = next(c for c in networkx.strongly_connected_components(support) if edge.first in c)
            assert edge.second in circle
    if networkx.is_directed_acyclic_graph(support):
        assert all(e.state == "used" for e in found.edges)


def test_the_weakest_of_a_circle_goes() -> None:
    edges = [Edge("support", 1, 2, 0.9, ""), Edge("support", 2, 3, 0.3, ""), Edge("support", 3, 1, 0.6, "")]
    found = ordered({1: 0.5, 2: 0.6, 3: 0.7}, edges)
    assert [e.state for e in found.edges] == ["used", "ambiguous", "used"]
    assert found.clusters == ((3, 1, 2),)


def test_what_carries_comes_first_front_to_back() -> None:
    edges = [Edge("support", 1, 2, 1, ""), Edge("support", 2, 3, 1, ""), Edge("support", 1, 4, 1, ""),
             Edge("contact", 1, 5, 1, ""), Edge("occlusion", 5, 6, 1, "")]  # fmt: skip
    found = ordered({1: 0.8, 2: 0.7, 3: 0.9, 4: 0.6, 5: 0.5, 6: 1.0, 7: 0.4}, edges)
    assert found.clusters == ((7,), (5, 1, 4, 2, 3, 6))
    assert found.support_lists == ((7,), (5,), (1, 4, 2, 3), (6,))
    edges = [Edge("support", 1, 3, 1, ""), Edge("support", 2, 3, 1, "")]
    assert ordered({1: 0.5, 2: 0.6, 3: 0.4}, edges).clusters == ((1, 2, 3),)
    assert ordered({}, ()).clusters == ()


def as_the_authors_code(depths_m: dict[int, float], edges: tuple[Edge, ...]) -> list[list[int]]:
    """Clusters on the dense matrix of touching objects, which has a diagonal there, by scipy's own order."""
    ids = sorted(depths_m)
    matrix = np.eye(len(ids), dtype=bool)
    for edge in edges:
        a, b = ids.index(edge.first), ids.index(edge.second)
        matrix[a, b] = matrix[b, a] = True
    order = reverse_cuthill_mckee(csgraph_from_dense(matrix), symmetric_mode=True).tolist()
    clusters = [[order[0]]]
    for k in order[1:]:
        if matrix[clusters[-1]].any(axis=0)[k]:
            clusters[-1].append(k)
        else:
            clusters.append([k])
    return [sorted(ids[k] for k in cluster) for cluster in clusters]


@given(cases())
def test_clusters_by_cuthill_mckee_are_those_of_the_authors_code(case: Case) -> None:
    depths_m, edges = case
    marked = cut_by_cuthill_mckee(depths_m, edges)
    expected = as_the_authors_code(depths_m, edges)
    assert sorted(connected(depths_m, [e for e in marked if e.state != "cut"])) == sorted(expected)
    found = ordered(depths_m, marked)
    assert sorted(sorted(cluster) for cluster in found.clusters) == sorted(expected)
    at = {i: k for k, i in enumerate(i for cluster in found.clusters for i in cluster)}
    assert all(at[e.first] < at[e.second] for e in found.edges if e.kind == "support" and e.state == "used")


def test_cuthill_mckee_takes_a_star_apart_and_leaves_a_chain_whole() -> None:
    star = [Edge("contact", 0, leaf, 1.0, "") for leaf in (1, 2, 3)]
    assert ordered(dict.fromkeys(range(4), 1.0), cut_by_cuthill_mckee(range(4), star)).clusters == ((0, 1, 2), (3,))
    chain = [Edge("contact", i, i + 1, 1.0, "") for i in range(5)]
    assert cut_by_cuthill_mckee(range(6), chain) == tuple(chain)
    assert cut_by_cuthill_mckee((), ()) == ()


def test_a_star_is_one_group() -> None:
    edges = [Edge("contact", 0, leaf, 1.0, "") for leaf in (1, 2, 3)]
    assert connected(range(4), edges) == [[0, 1, 2, 3]]
    assert len(ordered(dict.fromkeys(range(4), 1.0), edges).clusters) == 1
