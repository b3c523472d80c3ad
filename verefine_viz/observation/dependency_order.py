"""From edges to clusters and an order, whatever the order of the edges (paper Sec. IV-A; docs/methods.md 2.3); and as
the authors' code has them, with connected components done right (docs/methods.md 2.2).
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import connected_components, reverse_cuthill_mckee

from verefine_viz.core.arrays import Mask
from verefine_viz.core.problem import Edge, Problem
from verefine_viz.observation.visible_parts import VisiblePart

Groups = tuple[tuple[int, ...], ...]


@dataclass(frozen=True)
class Ordering:
    """What follows from edges."""

    edges: tuple[Edge, ...]
    """The edges, with what does not count marked as such."""
    clusters: Groups
    """Front to back, each in the order to solve it."""
    support_lists: Groups
    """Each a base object and what it carries, in the order of ``clusters``."""


def ordered(depths_m: Mapping[int, float], edges: Iterable[Edge]) -> Ordering:
    """Clusters are connected by edges that are not cut; in each, what carries comes before what it carries.

    Base objects (those that nothing carries) are taken front to back, each followed by all that it carries, depth
    first; what rests on several things comes after the last of them. Where support edges run in a circle, the weakest
    of them is left out, again and again.

    Args:
        depths_m: of every instance; the nearer, the earlier.
        edges: between these instances.
    """
    marked = _without_cycles(edges)
    carried: dict[int, list[int]] = {i: [] for i in depths_m}
    carriers: dict[int, set[int]] = {i: set() for i in depths_m}
    for edge in marked:
        if edge.kind == "support" and edge.state == "used":
            carriers[edge.second].add(edge.first)
            carried[edge.first].append(edge.second)

    def nearness(instance_id: int) -> tuple[float, int]:
        return depths_m[instance_id], instance_id

    placed: set[int] = set()

    def follow(base: int) -> list[int]:
        placed.add(base)
        chain = [base]
        for upper in sorted(set(carried[base]), key=nearness):
            if upper not in placed and carriers[upper] <= placed:
                chain += follow(upper)
        return chain

    # Sec. IV-A: clusters fall into support lists, a base object and what it carries, ordered front to back by base.
    by_cluster = []
    for group in connected(depths_m, [e for e in marked if e.state != "cut"]):
        bases = sorted((i for i in group if not carriers[i]), key=nearness)
        by_cluster.append([tuple(follow(base)) for base in bases])
    by_cluster.sort(key=lambda lists: min(nearness(i) for chain in lists for i in chain))
    clusters = tuple(tuple(i for chain in lists for i in chain) for lists in by_cluster)
    return Ordering(marked, clusters, tuple(chain for lists in by_cluster for chain in lists))


def connected(instance_ids: Iterable[int], edges: Iterable[Edge]) -> list[list[int]]:
    """Connected components over edges of any kind; each sorted."""
    ids = sorted(instance_ids)
    place = {i: k for k, i in enumerate(ids)}
    pairs = np.array([(place[e.first], place[e.second]) for e in edges], dtype=np.intp).reshape(-1, 2)
    n_groups, labels = _components(len(ids), pairs, "weak")
    return [[i for i, of in zip(ids, labels, strict=True) if of == k] for k in range(n_groups)]


def cut_between(edges: Iterable[Edge], cut: Collection[tuple[int, int]]) -> tuple[Edge, ...]:
    """The edges, those between the pairs of ``cut`` (either way round) marked as cut."""
    pairs = {frozenset(pair) for pair in cut}
    return tuple(replace(e, state="cut") if frozenset((e.first, e.second)) in pairs else e for e in edges)


def cut_by_cuthill_mckee(instance_ids: Iterable[int], edges: Iterable[Edge]) -> tuple[Edge, ...]:
    """The edges, those between clusters of the authors' code marked as cut.

    It takes the objects in reverse Cuthill-McKee order; one that touches none of the latest cluster begins the next, so
    that objects which edges connect may come apart (docs/methods.md 2.2).
    """
    ids, marked = sorted(instance_ids), tuple(edges)
    place = {i: k for k, i in enumerate(ids)}
    touch = np.zeros((len(ids), len(ids)), dtype=bool)
    for edge in marked:
        if edge.state != "cut":
            a, b = place[edge.first], place[edge.second]
            touch[a, b] = touch[b, a] = True
    clusters: list[list[int]] = []
    for k in reverse_cuthill_mckee(csr_array(touch), symmetric_mode=True) if ids else ():
        if clusters and touch[clusters[-1], k].any():
            clusters[-1].append(int(k))
        else:
            clusters.append([int(k)])
    number = {ids[k]: n for n, cluster in enumerate(clusters) for k in cluster}
    return tuple(replace(e, state="cut") if number[e.first] != number[e.second] else e for e in marked)


def _without_cycles(edges: Iterable[Edge]) -> tuple[Edge, ...]:
    """The edges in a fixed order, just so many support edges marked as ambiguous that the rest runs in no circle."""
    out = sorted(edges, key=lambda e: (e.kind, e.first, e.second))
    ids = sorted({i for e in edges for i in (e.first, e.second)})
    place = {i: k for k, i in enumerate(ids)}
    while True:
        used = [k for k, e in enumerate(out) if e.kind == "support" and e.state == "used"]
        pairs = np.array([(place[out[k].first], place[out[k].second]) for k in used], dtype=np.intp).reshape(-1, 2)
        _, labels = _components(len(ids), pairs, "strong")
        circular = [k for k, (a, b) in zip(used, pairs, strict=True) if labels[a] == labels[b]]
        if not circular:
            return tuple(out)
        weakest = min(circular, key=lambda k: (out[k].strength, out[k].first, out[k].second))
        out[weakest] = replace(out[weakest], state="ambiguous")


def _components(n: int, pairs: np.ndarray, connection: str) -> tuple[int, np.ndarray]:
    if n == 0:
        return 0, np.zeros(0, dtype=np.int32)
    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(n, n))
    return connected_components(graph, directed=True, connection=connection)


def touching_masks(problem: Problem) -> tuple[Edge, ...]:
    """An edge between instances whose measured pixels share one when each is dilated by one 4-neighbour step."""
    depth_m = problem.observation.depth_m
    grown = {i.instance_id: _grown(i.mask, depth_m) for i in problem.instances}
    edges = []
    for a, b in combinations(sorted(grown), 2):
        shared = int(np.count_nonzero(grown[a] & grown[b]))
        if shared:
            smaller = min(np.count_nonzero(grown[a]), np.count_nonzero(grown[b]))
            edges.append(Edge("contact", a, b, float(shared / smaller), f"masks share {shared} px when grown by one"))
    return tuple(edges)


def published_clusters(parts: Sequence[VisiblePart], edges: Sequence[Edge]) -> Groups:
    """In each cluster the lower tops come first; the cluster whose first object is nearest comes first.

    Without a plane heights are unknown; the nearer comes first then.
    """
    by_id = {p.instance_id: p for p in parts}
    nearest_m = {i: float(p.points_cam[:, 2].min()) for i, p in by_id.items()}

    def top(instance_id: int) -> tuple[float, float, int]:
        part = by_id[instance_id]
        top_m = float(part.heights_m.max()) if part.points_plane is not None else 0.0
        return top_m, nearest_m[instance_id], instance_id

    clusters = [tuple(sorted(group, key=top)) for group in connected(by_id, [e for e in edges if e.state != "cut"])]
    return tuple(sorted(clusters, key=lambda cluster: (nearest_m[cluster[0]], cluster[0])))


def _grown(mask: Mask, depth_m: NDArray[np.floating]) -> Mask:
    return np.asarray(binary_dilation(mask & (depth_m > 0)), dtype=bool)
