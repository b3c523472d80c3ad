"""The clouds that estimators compare: sampled on a model's surface, taken from a frame's segment, thinned evenly."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from verefine_viz.core.arrays import Float
from verefine_viz.core.kernels import kernel
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.problem import Target

SURFACE_SAMPLES = 20_000
"""Points drawn on a mesh before thinning: about 40 for each point that remains."""
SIDE_COSINE = 0.5
"""Points of one grid cell whose normals differ by more than 60° stay apart: both sides of a wall, both faces of an
edge."""
GRAZING_COSINE = 0.17
"""Pixels seen at less than 10° along the surface are left out: their depth and normal mean little."""
NEIGHBOUR = 2.0
"""Points of one part of the segment are linked by steps of at most this many sides of the grid."""


class Oriented(NamedTuple):
    """A cloud with normals."""

    points: Float
    """(N, 3) [m]."""
    normals: Float
    """(N, 3) unit vectors."""


def model_surface(model: ObjectModel, seed: int) -> Oriented:
    """Points drawn evenly over the mesh, with the outward normals of their faces."""
    a, b, c = (model.vertices[model.faces[:, k]] for k in range(3))
    cross = np.cross(b - a, c - a)
    double_area = np.linalg.norm(cross, axis=1)
    rng = np.random.default_rng(seed)
    i = rng.choice(len(cross), SURFACE_SAMPLES, p=double_area / double_area.sum())
    r, s = np.sqrt(rng.random((SURFACE_SAMPLES, 1))), rng.random((SURFACE_SAMPLES, 1))
    return Oriented((1 - r) * a[i] + r * (1 - s) * b[i] + r * s * c[i], cross[i] / double_area[i, None])


def segment_cloud(target: Target) -> Float:
    """Every measured pixel of the instance's mask, (N, 3) in the camera frame [m]."""
    observation = target.observation
    v, u = np.nonzero(target.instance.mask & (observation.depth_m > 0))
    z = observation.depth_m[v, u].astype(np.float64)
    camera = observation.camera
    return np.stack([(u - camera.cx) / camera.fx * z, (v - camera.cy) / camera.fy * z, z], axis=-1)


def segment_surface(target: Target) -> Oriented:
    """Every measured pixel of the instance's mask whose normal is known and not seen at a grazing angle."""
    points, observation = segment_cloud(target), target.observation
    normals = observation.normals_cam[target.instance.mask & (observation.depth_m > 0)].astype(np.float64)
    facing = -np.einsum("ij,ij->i", points, normals) > GRAZING_COSINE * np.linalg.norm(points, axis=1)
    return Oriented(points[facing], normals[facing])


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


def thinned_surface(cloud: Oriented, step_m: float) -> Oriented:
    """One point per cell of a grid and side of the surface there: mean places, mean normals.

    Args:
        cloud: any number of points.
        step_m: side of the cells [m]; the grid begins at the cloud's lowest coordinates.
    """
    if len(cloud.points) == 0:
        return cloud
    cell = np.floor((cloud.points - cloud.points.min(axis=0)) / step_m).astype(np.int64)
    counts = cell.max(axis=0) + 1
    key = (cell[:, 0] * counts[1] + cell[:, 1]) * counts[2] + cell[:, 2]
    order = np.argsort(key, kind="stable")
    return Oriented(*_means_by_side(cloud.points[order], cloud.normals[order], key[order]))


@kernel()
def _means_by_side(points: np.ndarray, normals: np.ndarray, key: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Means of points of the same key and side; a side begins with the first point that belongs to none so far."""
    n = len(points)
    place, direction = np.zeros((n, 3)), np.zeros((n, 3))
    size = np.zeros(n)
    used, first = 0, 0
    for i in range(n):
        if i == 0 or key[i] != key[i - 1]:
            first = used
        mine, best = -1, SIDE_COSINE
        for k in range(first, used):
            d = direction[k]
            length = np.sqrt(d @ d)
            cosine = (d @ normals[i]) / length if length > 0.0 else -1.0
            if cosine > best:
                mine, best = k, cosine
        if mine < 0:
            mine = used
            used += 1
        place[mine] += points[i]
        direction[mine] += normals[i]
        size[mine] += 1.0
    for k in range(used):
        place[k] /= size[k]
        direction[k] /= np.sqrt(direction[k] @ direction[k])
    return place[:used], direction[:used]


def large_parts(points: Float, side_m: float, share: float) -> Float:
    """The points without parts that stand alone and hold less than ``share`` of all points."""
    if share == 0 or len(points) == 0:
        return points
    i, j = KDTree(points).query_pairs(NEIGHBOUR * side_m, output_type="ndarray").T
    links = coo_array((np.ones(len(i), dtype=bool), (i, j)), shape=(len(points), len(points)))
    part = connected_components(links, directed=False)[1]
    return points[np.bincount(part)[part] >= share * len(points)]


def spread_out(points: Float, n: int) -> tuple[NDArray[np.int64], Float]:
    """Indices of at most ``n`` of the points, evenly spread, and how far each is from the nearest before it [m].

    The first is the cloud's first; each further one is the farthest from all before, so that any beginning of the list
    is evenly spread too, and the distances never grow.
    """
    points = np.array(points, dtype=np.float64, order="C")
    return _farthest(points, min(n, len(points)))


@kernel()
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
