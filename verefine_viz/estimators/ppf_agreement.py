"""How well a pose agrees with the depth image at points, quickly: for ranking many poses before any is refined.

Votes say how much of the segment could belong to a pose. They do not say that the model would stick out into space that
the sensor saw through, nor that part of the segment stays unexplained.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import inverse
from verefine_viz.core.kernels import kernel
from verefine_viz.core.problem import Target
from verefine_viz.estimators.clouds import GRAZING_COSINE, Oriented

CELLS = 64
"""Cells of the distance field along a diameter."""
PADDING = 0.1
"""How far the field reaches beyond the surface, as a share of the diameter."""


class SurfaceField(NamedTuple):
    """Distance to a model's surface on a grid, object frame."""

    distance_m: NDArray[np.float32]
    """(X, Y, Z) [m], from the cell's centre to that of the nearest cell with surface in it."""
    low: Float
    """(3,) where the grid begins [m]."""
    side_m: float
    """Side of a cell [m]."""


def surface_field(points: Float, diameter_m: float) -> SurfaceField:
    """The field of a surface given by many points (N, 3) on it."""
    side_m = diameter_m / CELLS
    low = points.min(axis=0) - PADDING * diameter_m
    counts = np.ceil((points.max(axis=0) + PADDING * diameter_m - low) / side_m).astype(int) + 1
    is_empty = np.ones(counts, dtype=bool)
    is_empty[tuple(((points - low) / side_m).astype(int).T)] = False
    distance_m = np.asarray(distance_transform_edt(is_empty, sampling=side_m), dtype=np.float32)
    return SurfaceField(distance_m, low, side_m)


def agreement(
    target: Target, model_cloud: Oriented, field: SurfaceField, segment: Oriented, Ts_cam_obj: Float, tolerance_m: float
) -> Float:
    """(N,) in [0, 1]: how well each pose explains the segment × how well the measured depth confirms the model.

    Explained: a segment point counts 1 on the model's surface, 0 at ``tolerance_m`` from it and beyond.
    Confirmed: of the model points that face the camera and lie on measured depth of the instance's mask, or in space
    that the sensor saw through, how many are the former, each weighted by the cosine between both normals. What
    something nearer hides or what was not measured is left out.

    Args:
        target: the instance and the frame.
        model_cloud: (M, 3) thinned model points and outward normals, object frame.
        field: of the same model.
        segment: (S, 3) thinned points of the instance, camera frame.
        Ts_cam_obj: (N, 4, 4) poses.
        tolerance_m: depths that differ by less agree [m].
    """
    observation = target.observation
    camera = observation.camera
    return _agreement(
        observation.depth_m,
        observation.normals_cam,
        target.instance.mask,
        np.array([camera.fx, camera.fy, camera.cx, camera.cy]),
        model_cloud,
        field,
        segment.points,
        np.ascontiguousarray(Ts_cam_obj),
        np.ascontiguousarray(inverse(Ts_cam_obj)),
        tolerance_m,
    )


@kernel()
def _agreement(
    depth: np.ndarray,
    normals: np.ndarray,
    mask: np.ndarray,
    intrinsics: np.ndarray,
    model: Oriented,
    field: SurfaceField,
    segment: np.ndarray,
    poses: np.ndarray,
    inverses: np.ndarray,
    tolerance: float,
) -> np.ndarray:
    out = np.empty(len(poses))
    for k in range(len(poses)):
        confirmed = _confirmed(depth, normals, mask, intrinsics, model.points, model.normals, poses[k], tolerance)
        out[k] = confirmed * _explained(segment, field, inverses[k], tolerance)
    return out


@kernel()
def _moved(T: np.ndarray, p: np.ndarray, w: float) -> tuple[float, float, float]:
    """A point (w = 1) or a direction (w = 0) in the other frame."""
    return (
        T[0, 0] * p[0] + T[0, 1] * p[1] + T[0, 2] * p[2] + w * T[0, 3],
        T[1, 0] * p[0] + T[1, 1] * p[1] + T[1, 2] * p[2] + w * T[1, 3],
        T[2, 0] * p[0] + T[2, 1] * p[1] + T[2, 2] * p[2] + w * T[2, 3],
    )


@kernel()
def _confirmed(
    depth: np.ndarray,
    normals: np.ndarray,
    mask: np.ndarray,
    intrinsics: np.ndarray,
    points_obj: np.ndarray,
    normals_obj: np.ndarray,
    T: np.ndarray,
    tolerance: float,
) -> float:
    height, width = depth.shape
    agreeing, counted = 0.0, 0
    for i in range(len(points_obj)):
        x, y, z = _moved(T, points_obj[i], 1.0)
        nx, ny, nz = _moved(T, normals_obj[i], 0.0)
        if z <= 0.0 or -(nx * x + ny * y + nz * z) <= GRAZING_COSINE * np.sqrt(x * x + y * y + z * z):
            continue
        across, down = x / z * intrinsics[0] + intrinsics[2], y / z * intrinsics[1] + intrinsics[3]
        if not (-1.0 < across < width and -1.0 < down < height):  # No integer may hold it.
            continue
        u, v = round(across), round(down)
        if u < 0 or v < 0 or u >= width or v >= height or depth[v, u] <= 0.0:
            continue
        beyond = depth[v, u] - z
        if beyond > tolerance:
            counted += 1
        elif beyond >= -tolerance and mask[v, u]:
            counted += 1
            agreeing += max(0.0, nx * normals[v, u, 0] + ny * normals[v, u, 1] + nz * normals[v, u, 2])
    return agreeing / counted if counted > 0 else 0.0


@kernel()
def _explained(segment: np.ndarray, field: SurfaceField, T_obj_cam: np.ndarray, tolerance: float) -> float:
    nx, ny, nz = field.distance_m.shape
    total = 0.0
    for i in range(len(segment)):
        x, y, z = _moved(T_obj_cam, segment[i], 1.0)
        a, b, c = (
            (x - field.low[0]) / field.side_m,
            (y - field.low[1]) / field.side_m,
            (z - field.low[2]) / field.side_m,
        )
        if a >= 0.0 and b >= 0.0 and c >= 0.0 and a < nx and b < ny and c < nz:
            total += max(0.0, 1.0 - field.distance_m[int(a), int(b), int(c)] / tolerance)
    return total / len(segment)
