"""The surface of a mesh put right: vertices at the same place joined, faces turned outwards."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from verefine_viz.core.arrays import Float


def merged(
    vertices: Float, faces: NDArray[np.integer], colors: NDArray[np.uint8] | None
) -> tuple[Float, NDArray[np.integer], NDArray[np.uint8] | None, NDArray[np.bool_]]:
    """The surface with vertices at exactly the same place joined, in order of first appearance.

    Faces that collapse are dropped; the last result (F,) is which remain.
    """
    _, first, inverse = np.unique(vertices, axis=0, return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    faces = rank[inverse.ravel()][faces]
    collapsed = (faces[:, 0] == faces[:, 1]) | (faces[:, 1] == faces[:, 2]) | (faces[:, 2] == faces[:, 0])
    chosen = first[order]
    return vertices[chosen], faces[~collapsed], None if colors is None else colors[chosen], ~collapsed


def edges(faces: NDArray[np.integer]) -> NDArray[np.int64]:
    """(3 F,) a number for the edge from each corner to the next, whichever way it goes."""
    start, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    return np.minimum(start, end).astype(np.int64) * (int(faces.max()) + 1) + np.maximum(start, end)


def _against_first(faces: NDArray[np.integer]) -> NDArray[np.bool_]:
    """(F,) which faces are wound against the first face they hang together with by edges.

    None of a surface with one side only, whose faces can not all be wound alike.
    """
    n, edge, start = len(faces), edges(faces), faces.ravel()
    order = np.argsort(edge, kind="stable")
    _, first, count = np.unique(edge[order], return_index=True, return_counts=True)
    one, other = order[first[count == 2]], order[first[count == 2] + 1]
    face, neighbour = one // 3, other // 3
    # Neighbours wound alike go along their common edge in opposite directions.
    is_against = start[one] == start[other]
    if not is_against.any():
        return np.zeros(n, np.bool_)
    # Each face stands for two nodes, as it is (k) and turned round (n + k); edges join what is wound alike.
    a = np.concatenate([face, n + face])
    b = np.concatenate([neighbour + n * is_against, neighbour + n * ~is_against])
    graph = coo_array((np.ones(len(a), np.bool_), (a, b)), shape=(2 * n, 2 * n))
    group = connected_components(graph, directed=False)[1]
    as_is, turned = group[:n], group[n:]
    # The group of the first face of each part is that of the lowest number: groups are numbered in order of faces.
    return turned < as_is


def turned_outward(vertices: Float, faces: NDArray[np.integer]) -> NDArray[np.bool_]:
    """(F,) which faces must be turned round so that neighbours are wound alike and the enclosed volume is positive."""
    is_turned = _against_first(faces)
    faces = np.where(is_turned[:, None], faces[:, ::-1], faces)
    # Volume seen from the middle of the box: right for closed meshes, and a fair guess for open ones.
    a, b, c = np.moveaxis((vertices - (vertices.min(axis=0) + vertices.max(axis=0)) / 2)[faces], 1, 0)
    volume = float(np.einsum("ij,ij->", a, np.cross(b, c)))
    return ~is_turned if volume < 0 else is_turned
