"""Which pixels of a frame belong to an object that is thought to be at a pose, where nothing gives its mask."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from verefine_viz.core.arrays import Float, Mask
from verefine_viz.core.geometry import apply, inverse
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.observation import Observation
from verefine_viz.core.problem import Placed
from verefine_viz.refiners.nearest import model_index

FIT_SHARE, FIT_M = 0.05, 0.010
"""How far off a pose that fits may be, as a share of the diameter, and at least: what depth images measure beside."""


def fit_reach_m(model: ObjectModel) -> float:
    """How far from the model's surface a pixel of the object may be measured where the pose fits [m]."""
    return max(FIT_M, FIT_SHARE * model.diameter_m)


def own_pixels(
    observation: Observation, model: ObjectModel, T_cam_obj: Float, others: Sequence[Placed], within_m: float
) -> Mask:
    """The pixels (H, W) that are nearer to the model's surface than to the support plane and to other objects.

    Args:
        observation: the frame.
        model: of the object.
        T_cam_obj: (4, 4) where it is thought to be [m].
        others: objects around it, where they are.
        within_m: largest distance to the surface: how far off the pose may be [m].
    """
    mask = np.zeros(observation.camera.shape, np.bool_)
    rows, columns, nearest_m, farthest_m = _window(observation, model, T_cam_obj, within_m)
    depth_m = observation.depth_m[rows, columns]
    v, u = np.nonzero((depth_m > max(nearest_m, 0.0)) & (depth_m < farthest_m))
    v, u = v + rows.start, u + columns.start
    camera, z = observation.camera, np.asarray(observation.depth_m[v, u], np.float64)
    cloud = np.column_stack([(u - camera.cx) / camera.fx * z, (v - camera.cy) / camera.fy * z, z])
    low, high = model.vertices.min(axis=0) - within_m, model.vertices.max(axis=0) + within_m
    local = apply(inverse(T_cam_obj), cloud)
    near = ((local > low) & (local < high)).all(axis=1)
    v, u, cloud = v[near], u[near], cloud[near]
    normals = observation.normals_cam[v, u].astype(np.float64)
    own_m, faces = _distances(model, T_cam_obj, cloud, normals)
    is_own = (own_m < within_m) & faces
    if observation.support is not None:
        heights = apply(observation.support.T_world_cam, cloud) @ observation.support.normal_world
        is_own &= own_m <= np.abs(heights)
    for other in others:
        asked = np.flatnonzero(is_own)
        theirs_m, _ = _distances(other.model, other.T_cam_obj, cloud[asked], normals[asked])
        is_own[asked[theirs_m < own_m[asked]]] = False
    mask[v[is_own], u[is_own]] = True
    return mask


def _window(
    observation: Observation, model: ObjectModel, T_cam_obj: Float, within_m: float
) -> tuple[slice, slice, float, float]:
    """Rows and columns of the image that may show what lies so near to a model, and between which depths [m]."""
    camera = observation.camera
    low, high = model.vertices.min(axis=0), model.vertices.max(axis=0)
    x, y, z = apply(T_cam_obj, ((low + high) / 2)[None])[0]
    reach_m = float(np.linalg.norm(high - low)) / 2 + within_m
    nearest_m, farthest_m = z - reach_m, z + reach_m
    if nearest_m <= 0:
        return slice(0, camera.height), slice(0, camera.width), nearest_m, farthest_m
    edges = []
    for middle, focal, centre, size in (
        (y, camera.fy, camera.cy, camera.height),
        (x, camera.fx, camera.cx, camera.width),
    ):
        sides = (middle - reach_m, middle + reach_m)
        ends = [focal * side / depth + centre for side in sides for depth in (nearest_m, farthest_m)]
        edges.append(slice(int(np.clip(min(ends), 0, size)), int(np.clip(max(ends) + 2, 0, size))))
    return edges[0], edges[1], nearest_m, farthest_m


def _distances(model: ObjectModel, T_cam_obj: Float, cloud: Float, normals: Float) -> tuple[Float, Mask]:
    """Distances (N,) of points (N, 3) to the model's surface [m], and whether it faces as they do, as far as that is
    known.
    """
    distances, nearest = model_index(model).query(apply(inverse(T_cam_obj), cloud))
    facing = ((model.point_normals[nearest] @ T_cam_obj[:3, :3].T) * normals).sum(axis=1)
    return distances, (facing > 0) | ~normals.any(axis=1)
