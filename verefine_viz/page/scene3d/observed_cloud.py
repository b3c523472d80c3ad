"""The observed cloud: which pixels become points, in which colours, and which pixel a click in 3D means."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float
from verefine_viz.core.observation import Observation
from verefine_viz.core.palette import Image, Scale, class_image, difference_scale
from verefine_viz.core.problem import Problem, Target
from verefine_viz.core.scores import ScoreMaps
from verefine_viz.pictures.surface_distances import REACH, signed_distances

MAX_POINTS = 45_000
MAX_DEPTH_M = 4.0
_CLICK_REACH_M = 5.0
_RAY_STEP_M = 0.002
_SURFACE_M = 0.03
_COARSE_PX = 8


@dataclass(frozen=True, eq=False)
class Cloud:
    """The pixels that are drawn."""

    rows: NDArray[np.intp]
    columns: NDArray[np.intp]
    points_cam: NDArray[np.float32]
    """(N, 3) [m]."""
    normals_cam: NDArray[np.float32]
    """(N, 3) unit."""
    natural: Image
    """(N, 3) RGB: the photo, or without one shades of grey by how steeply the camera looks."""
    is_object: NDArray[np.bool_]
    """(N,) whether a pixel belongs to one of the objects."""
    spacing_px: int
    """Distance of neighbours in the background [px]."""

    @property
    def faded(self) -> Image:
        """The natural colours of points that another colouring leaves out."""
        return (self.natural.astype(np.float32) * 0.35 + 75).astype(np.uint8)


def cloud_of(observation: Observation) -> Cloud:
    """Take all object pixels, and as many of the others as stay below ``MAX_POINTS``, on a regular grid."""
    depth = observation.depth_m
    valid = (depth > 0) & (depth < MAX_DEPTH_M)
    n_object = int((valid & observation.object_mask).sum())
    n_other = int((valid & ~observation.object_mask).sum())
    step = max(1, int(np.ceil(np.sqrt(n_other / max(MAX_POINTS - n_object, 10_000)))))
    grid = np.zeros_like(valid)
    grid[::step, ::step] = True
    inner = max(1, int(np.ceil(np.sqrt(n_object / MAX_POINTS))))
    object_grid = np.zeros_like(valid)
    object_grid[::inner, ::inner] = True
    rows, columns = np.nonzero(valid & np.where(observation.object_mask, object_grid, grid))
    points = observation.camera.back_project(depth)[rows, columns].astype(np.float32)
    normals = observation.normals_cam[rows, columns].astype(np.float32)
    if observation.rgb is not None:
        natural = observation.rgb[rows, columns]
    else:
        # As if lit from the camera: shapes can be distinguished, wherever they are.
        natural = np.repeat((40 + 150 * np.abs(normals[:, 2:])), 3, axis=1).astype(np.uint8)
    return Cloud(rows, columns, points, normals, natural, observation.object_mask[rows, columns], step)


def normal_colors(cloud: Cloud) -> Image:
    """Colour points by their normals, (N, 3): red to the right, green down, blue towards the camera."""
    known = np.linalg.norm(cloud.normals_cam, axis=1) > 0.5
    colors = np.rint(127.5 * (cloud.normals_cam * [1, 1, -1] + 1)).astype(np.uint8)
    return np.where(known[:, None], colors, cloud.faded)


def class_colors(cloud: Cloud, maps: ScoreMaps) -> Image:
    """Colour points by the class of their pixels, (N, 3)."""
    classes = maps.classes[cloud.rows, cloud.columns]
    return np.where((classes > 0)[:, None], class_image(classes), cloud.faded)


def _surface_scale(tau_m: float) -> Scale:
    """Return the colours of a signed distance to a surface [mm], over half the depth tolerance to either side.

    Blue = outside, red = inside, as maps colour a point before or behind the rendered surface.
    """
    anchors = difference_scale(tau_m).anchors[::-1]
    return Scale(-500.0 * tau_m, 500.0 * tau_m, "mm", anchors)


def distance_colors(cloud: Cloud, posed: Sequence[tuple[Target, Float]], tau_m: float) -> Image:
    """Colour the objects' points by their signed distance to the nearest posed model, (N, 3)."""
    distances_m = np.full(len(cloud.points_cam), np.nan)
    distances_m[cloud.is_object] = signed_distances(cloud.points_cam[cloud.is_object], posed, REACH * tau_m)
    near = np.isfinite(distances_m)
    return np.where(near[:, None], _surface_scale(tau_m).colors(1000 * distances_m), cloud.faded)


def measured_points(problem: Problem) -> Float:
    """Return all objects' observed points (n, 3) in the camera frame; of a frame without objects those in the middle of
    the image, and where nothing was measured a point ahead.
    """
    clouds = [i.points_cam for i in problem.instances if len(i.points_cam)] or [_middle_points(problem.observation)]
    points = np.concatenate(clouds)
    return points if len(points) else np.array([[0.0, 0.0, 1.0]])


def _middle_points(observation: Observation) -> Float:
    """Return what was measured in the middle of the image, half as wide and high, on a coarse grid (n, 3)."""
    height, width = observation.depth_m.shape
    middle = np.s_[height // 4 : -(height // 4) : _COARSE_PX, width // 4 : -(width // 4) : _COARSE_PX]
    depth = observation.depth_m[middle]
    return observation.camera.back_project(observation.depth_m)[middle][(depth > 0) & (depth < MAX_DEPTH_M)]


def clicked_pixel(
    observation: Observation, origin_cam: Float, direction_cam: Float, image_plane_m: float | None
) -> tuple[int, int] | None:
    """Return the pixel (u, v) that a ray of the 3D view hits; None if it hits nothing.

    The ray meets the camera image before the sensor, at depth ``image_plane_m`` (None = not shown), or the observed
    surface; whichever comes first.
    """
    camera = observation.camera
    direction = direction_cam / np.linalg.norm(direction_cam)
    along = np.arange(0.0, _CLICK_REACH_M, _RAY_STEP_M)
    if image_plane_m is not None and abs(direction[2]) > 1e-9:
        along = np.sort(np.append(along, (image_plane_m - origin_cam[2]) / direction[2]))
    points = origin_cam + along[:, None] * direction
    points = points[(along > 0) & (points[:, 2] > 0.01)]
    uv = np.round(camera.project(points)).astype(np.int64)
    inside = (uv >= 0).all(axis=1) & (uv[:, 0] < camera.width) & (uv[:, 1] < camera.height)
    z, uv = points[inside, 2], uv[inside]
    depth = observation.depth_m[uv[:, 1], uv[:, 0]]
    # The ray crosses the surface where it goes from before it to just behind it.
    hits = (depth > 0) & (z >= depth) & (z < depth + _SURFACE_M)
    if image_plane_m is not None:
        hits |= np.abs(z - image_plane_m) < 1e-9
    first = np.flatnonzero(hits)[:1]
    return (int(uv[first[0], 0]), int(uv[first[0], 1])) if len(first) else None
