"""The two clouds that are compared: the segment and the model, each thinned by a grid. docs/methods.md 3.1."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from verefine_viz.core.arrays import Float
from verefine_viz.core.problem import Target

NEIGHBOUR = 2.0
"""Points of one part of the segment are linked by steps of at most this many sides of the grid."""


def segment_cloud(target: Target) -> Float:
    """Every measured pixel of the instance's mask, (N, 3) in the camera frame [m]."""
    observation = target.observation
    v, u = np.nonzero(target.instance.mask & (observation.depth_m > 0))
    z = observation.depth_m[v, u].astype(np.float64)
    camera = observation.camera
    return np.stack([(u - camera.cx) / camera.fx * z, (v - camera.cy) / camera.fy * z, z], axis=-1)


def thinned(points: Float, side_m: float) -> Float:
    """One point per occupied cell of a grid: the mean of those inside. (N, 3) to (n, 3), ordered by cell."""
    if len(points) == 0:
        return points
    cell = np.floor(points / side_m).astype(np.int64)
    cell -= cell.min(axis=0)
    counts = cell.max(axis=0) + 1
    key = (cell[:, 0] * counts[1] + cell[:, 1]) * counts[2] + cell[:, 2]
    _, which, n = np.unique(key, return_inverse=True, return_counts=True)
    which = which.ravel()
    sums = np.stack([np.bincount(which, weights=points[:, k]) for k in range(3)], axis=1)
    return sums / n[:, None]


def large_parts(points: Float, side_m: float, share: float) -> Float:
    """The points without those parts, apart from the rest, that hold less than ``share`` of all."""
    if share == 0 or len(points) == 0:
        return points
    i, j = KDTree(points).query_pairs(NEIGHBOUR * side_m, output_type="ndarray").T
    links = coo_array((np.ones(len(i), dtype=bool), (i, j)), shape=(len(points), len(points)))
    part = connected_components(links, directed=False)[1]
    return points[np.bincount(part)[part] >= share * len(points)]


def spread_out(points: Float, n: int) -> tuple[Float, Float]:
    """At most ``n`` of the points, evenly spread, and how far each is from the nearest of those before it [m].

    The first is the cloud's first; each further one is the farthest from all before, so that any beginning of the list
    is evenly spread too, and the distances never grow.
    """
    points = np.array(points, dtype=np.float64, order="C")
    chosen, distances = _farthest(points, min(n, len(points)))
    return points[chosen], distances


@njit(cache=True)
def _farthest(points: np.ndarray, n: int) -> tuple[NDArray[np.int64], np.ndarray]:
    squared = np.full(len(points), np.inf)
    chosen, distances = np.empty(n, dtype=np.int64), np.empty(n)
    last = 0
    for m in range(n):
        chosen[m], distances[m] = last, np.sqrt(squared[last])
        farthest, next_one = -1.0, 0
        for i in range(len(points)):
            dx, dy, dz = points[i, 0] - points[last, 0], points[i, 1] - points[last, 1], points[i, 2] - points[last, 2]
            squared[i] = min(squared[i], dx * dx + dy * dy + dz * dz)
            if squared[i] > farthest:
                farthest, next_one = squared[i], i
        last = next_one
    return chosen, distances
