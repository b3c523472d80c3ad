"""Points with normals: sampled on a model's surface, taken from a frame's segment, and thinned evenly."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from verefine_viz.core.arrays import Float
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.problem import Target

SURFACE_SAMPLES = 20_000
"""Points drawn on a mesh before thinning: about 40 for each one that stays."""
SIDE_COSINE = 0.5
"""Points of one grid cell whose normals differ by more than 60° stay apart: both sides of a wall, both faces of an
edge."""
GRAZING_COSINE = 0.17
"""Pixels seen at less than 10° along the surface are left out: their depth and normal mean little."""


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


def segment_surface(target: Target) -> Oriented:
    """Every measured pixel of the instance's mask whose normal is known and not seen at a grazing angle."""
    observation = target.observation
    v, u = np.nonzero(target.instance.mask & (observation.depth_m > 0))
    z = observation.depth_m[v, u].astype(np.float64)
    camera = observation.camera
    points = np.stack([(u - camera.cx) / camera.fx * z, (v - camera.cy) / camera.fy * z, z], axis=-1)
    normals = observation.normals_cam[v, u].astype(np.float64)
    facing = -np.einsum("ij,ij->i", points, normals) > GRAZING_COSINE * np.linalg.norm(points, axis=1)
    return Oriented(points[facing], normals[facing])


def thinned(cloud: Oriented, step_m: float) -> Oriented:
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
    return Oriented(*_thinned(cloud.points[order], cloud.normals[order], key[order]))


@njit(cache=True)
def _thinned(points: np.ndarray, normals: np.ndarray, key: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
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
