"""Exact nearest neighbours of points that lie far from the cloud, where :mod:`nearest` compares every point.

The cloud is halved again and again into leaves of a few points; a query looks only into leaves whose box is not too
far to hold the nearest. Trimmed ICP has no gate, so that any observed point may lie anywhere.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float

LEAF = 32
"""Most points of a leaf."""


class Leaves(NamedTuple):
    """What a query needs."""

    points: Float
    """(N, 3) the cloud."""
    bounds: Float
    """(L, 2, 3) lowest and highest coordinates of each leaf's points."""
    starts: NDArray[np.int64]
    """(L + 1,) where each leaf's members begin."""
    members: NDArray[np.int64]
    """(N,) indices into ``points``, leaf by leaf."""

    @staticmethod
    def build(points: Float) -> Leaves:
        """The leaves of a cloud (N, 3) of at least one point."""
        points = np.array(points, dtype=np.float64, order="C")
        leaves = [np.arange(len(points))]
        while max(map(len, leaves)) > LEAF:
            halves: list[NDArray[np.int64]] = []
            for leaf in leaves:
                axis = int(np.argmax(np.ptp(points[leaf], axis=0)))
                halves += np.array_split(leaf[np.argsort(points[leaf, axis], kind="stable")], 2)
            leaves = halves
        bounds = np.array([[points[leaf].min(axis=0), points[leaf].max(axis=0)] for leaf in leaves])
        return Leaves(points, bounds, np.cumsum([0, *map(len, leaves)]), np.concatenate(leaves))


@njit(cache=True)
def nearest_from_afar(x: float, y: float, z: float, leaves: Leaves) -> tuple[int, float]:
    """The nearest point's index and squared distance to (x, y, z); the first in the cloud on ties."""
    first, least = 0, np.inf
    for leaf in range(len(leaves.bounds)):
        bound = _to_box(x, y, z, leaves.bounds[leaf])
        if bound < least:
            first, least = leaf, bound
    best, best_squared = _better(x, y, z, leaves, first, 0, np.inf)
    for leaf in range(len(leaves.bounds)):
        if leaf != first and _to_box(x, y, z, leaves.bounds[leaf]) <= best_squared:
            best, best_squared = _better(x, y, z, leaves, leaf, best, best_squared)
    return best, best_squared


@njit(cache=True)
def _to_box(x: float, y: float, z: float, bounds: np.ndarray) -> float:
    """Squared distance of a point to a box (2, 3); 0 inside."""
    dx = max(bounds[0, 0] - x, x - bounds[1, 0], 0.0)
    dy = max(bounds[0, 1] - y, y - bounds[1, 1], 0.0)
    dz = max(bounds[0, 2] - z, z - bounds[1, 2], 0.0)
    return dx * dx + dy * dy + dz * dz


@njit(cache=True)
def _better(
    x: float, y: float, z: float, leaves: Leaves, leaf: int, best: int, best_squared: float
) -> tuple[int, float]:
    """The nearer of the best so far and the leaf's points."""
    points = leaves.points
    for k in range(leaves.starts[leaf], leaves.starts[leaf + 1]):
        i = leaves.members[k]
        dx, dy, dz = points[i, 0] - x, points[i, 1] - y, points[i, 2] - z
        squared = dx * dx + dy * dy + dz * dz
        if squared < best_squared or (squared == best_squared and i < best):
            best, best_squared = i, squared
    return best, best_squared
