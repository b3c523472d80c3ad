"""The observed cloud: which pixels become points, in which colours, and which pixel a click means."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float
from verefine_viz.core.camera import Camera
from verefine_viz.core.colormaps import Image, class_image, difference_scale
from verefine_viz.core.observation import Observation
from verefine_viz.core.problem import Problem
from verefine_viz.core.scores import ScoreMaps
from verefine_viz.viewer.commands import CloudColors

MAX_POINTS = 45_000
MAX_DEPTH_M = 4.0
_REACH_M = 5.0
_RAY_STEP_M = 0.002


@dataclass(frozen=True, eq=False)
class Cloud:
    """The pixels that are drawn."""

    rows: NDArray[np.intp]
    columns: NDArray[np.intp]
    points_cam: NDArray[np.float32]
    """(N, 3) [m]."""
    natural: Image
    """(N, 3) RGB: the photo, or without one shades of grey by how steeply the camera looks."""
    spacing_px: int
    """Distance of neighbours in the background [px]."""


def cloud_of(observation: Observation) -> Cloud:
    """All object pixels, and as many of the others as stay below ``MAX_POINTS``, on a regular grid."""
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
    if observation.rgb is not None:
        natural = observation.rgb[rows, columns]
    else:
        # As if lit from the camera: shapes can be told apart, wherever they are.
        shade = 40 + 150 * np.abs(observation.normals_cam[rows, columns, 2])
        natural = np.repeat(shade[:, None], 3, axis=1).astype(np.uint8)
    return Cloud(rows, columns, points, natural, step)


def cloud_colors(cloud: Cloud, by: CloudColors, maps: ScoreMaps | None, tau_m: float) -> Image:
    """(N, 3) RGB. Where the score says nothing about a pixel, its natural colour, faded."""
    if by == "colour" or maps is None:
        return cloud.natural
    rows, columns = cloud.rows, cloud.columns
    faded = (cloud.natural.astype(np.float32) * 0.35 + 75).astype(np.uint8)
    if by == "class":
        classes = maps.classes[rows, columns]
        return np.where((classes > 0)[:, None], class_image(classes), faded)
    difference = maps.depth_difference_m[rows, columns] * 1000
    known = np.isfinite(difference) & (maps.rendered_m[rows, columns] > 0)
    return np.where(known[:, None], difference_scale(tau_m).colors(difference), faded)


def clicked_pixel(
    observation: Observation, origin_cam: Float, direction_cam: Float, image_plane_m: float | None
) -> tuple[int, int] | None:
    """The pixel (u, v) that a ray of the person's view means.

    The ray meets the camera image before the sensor, at depth ``image_plane_m`` (None = not shown), or the observed
    surface; whichever comes first. None if it meets neither.
    """
    camera = observation.camera
    direction = direction_cam / np.linalg.norm(direction_cam)
    hits: list[tuple[float, tuple[int, int]]] = []
    if image_plane_m is not None and abs(direction[2]) > 1e-9:
        distance = float((image_plane_m - origin_cam[2]) / direction[2])
        pixel = _pixel(camera, origin_cam + distance * direction)
        if distance > 0 and pixel is not None:
            hits.append((distance, pixel))
    along = np.arange(0.0, _REACH_M, _RAY_STEP_M)
    points = origin_cam + along[:, None] * direction
    ahead = points[:, 2] > 0.01
    along, points = along[ahead], points[ahead]
    if len(points):
        uv = np.round(camera.project(points)).astype(np.int64)
        inside = (uv >= 0).all(axis=1) & (uv[:, 0] < camera.width) & (uv[:, 1] < camera.height)
        along, points, uv = along[inside], points[inside], uv[inside]
        depth = observation.depth_m[uv[:, 1], uv[:, 0]]
        # The ray is through the surface where it comes from before it to just behind it.
        behind = (depth > 0) & (points[:, 2] >= depth) & (points[:, 2] < depth + 0.03)
        if behind.any():
            first = int(np.argmax(behind))
            hits.append((float(along[first]), (int(uv[first, 0]), int(uv[first, 1]))))
    return min(hits)[1] if hits else None


def _pixel(camera: Camera, point_cam: Float) -> tuple[int, int] | None:
    u, v = np.round(camera.project(point_cam)).astype(int)
    return (int(u), int(v)) if 0 <= u < camera.width and 0 <= v < camera.height else None


def measured_points(problem: Problem) -> Float:
    """All objects' observed points (n, 3), in the camera frame; a point ahead where nothing was measured."""
    clouds = [i.points_cam for i in problem.instances if len(i.points_cam)]
    return np.concatenate(clouds) if clouds else np.array([[0.0, 0.0, 1.0]])
