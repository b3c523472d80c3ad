"""The plane that objects really stand on, told by their true poses: a face of their hull that they can rest on."""

from __future__ import annotations

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import transform
from verefine_viz.core.observation import Support

TOUCHES_M = 0.003
"""Vertices closer to a face of the hull than this rest on its plane [m]."""
ON_M = 0.008
"""Background closer to a plane than this lies on it [m]."""
LEAST_SHARE = 0.02
"""A plane that holds less of the background near the objects (what lies below it taken off) is not seen."""
FIT_POINTS = 300
"""With so many points of background on it, the plane is fitted to them."""
POINTS = 4000
"""Points of the background that are looked at."""
MOST_TURN_RAD = np.radians(6.0)
"""A fit that turns the plane further than this follows something else."""


def carrying_plane(vertices_cam: Float, background_cam: Float) -> Support | None:
    """The support plane of objects at their true poses; the world has +z along its normal.

    Args:
        vertices_cam: (N, 3) of all objects [m].
        background_cam: (M, 3) measured points of no object [m].

    Returns:
        None where no plane on which they can rest is seen.
    """
    try:
        hull = ConvexHull(vertices_cam)
    except QhullError:
        return None
    corners = vertices_cam[hull.vertices]
    middle = corners.mean(axis=0)
    reach_m = 2.5 * float(np.linalg.norm(corners - middle, axis=1).max())
    near = background_cam[np.linalg.norm(background_cam - middle, axis=1) < reach_m]
    near = near[:: 1 + len(near) // POINTS]
    if len(near) < 20:
        return None
    planes = -np.unique(np.round(hull.equations, 5), axis=0)
    planes = planes[planes[:, 3] > 0]  # Of the others the camera is below.
    heights = near @ planes[:, :3].T + planes[:, 3]
    shares = np.mean(np.abs(heights) < ON_M, axis=0) - np.mean(heights < -2 * ON_M, axis=0)
    for k in np.argsort(-shares):
        if shares[k] < LEAST_SHARE:
            return None
        normal, offset_m = planes[k, :3], float(planes[k, 3])
        if _rests(corners, normal, offset_m, middle):
            return _support(*_fitted(normal, offset_m, near), middle, float(shares[k]))
    return None


def _rests(corners: Float, normal: Float, offset_m: float, middle: Float) -> bool:
    """Whether the objects' middle lies above the corners that touch a plane."""
    touching = corners[corners @ normal + offset_m < TOUCHES_M]
    x, y = _across(normal)
    flat = np.stack([touching @ x, touching @ y], axis=1)
    try:
        polygon = ConvexHull(flat)
    except (QhullError, ValueError):
        return False
    at = np.array([middle @ x, middle @ y])
    return bool((polygon.equations[:, :2] @ at + polygon.equations[:, 2] < 0).all())


def _fitted(normal: Float, offset_m: float, near: Float) -> tuple[Float, float]:
    """The least-squares plane of the background on it; the hull is only as exact as poses and meshes are."""
    on = near[np.abs(near @ normal + offset_m) < ON_M]
    if len(on) < FIT_POINTS:
        return normal, offset_m
    centre = on.mean(axis=0)
    fitted = np.linalg.eigh(np.cov((on - centre).T))[1][:, 0]
    fitted = fitted if fitted @ normal > 0 else -fitted
    if float(fitted @ normal) < np.cos(MOST_TURN_RAD):
        return normal, offset_m
    return fitted, float(-fitted @ centre)


def _support(normal: Float, offset_m: float, middle: Float, share: float) -> Support:
    x, y = _across(normal)
    R_world_cam = np.stack([x, y, normal])
    origin = middle - (middle @ normal + offset_m) * normal
    return Support(transform(R_world_cam, -R_world_cam @ origin), np.array([0.0, 0.0, 1.0]), "given", share)


def _across(normal: Float) -> tuple[Float, Float]:
    """Two directions that span the plane, right-handed with its normal."""
    right = np.array([1.0, 0.0, 0.0]) if abs(normal[0]) < 0.9 else np.array([0.0, 1.0, 0.0])
    x = right - (right @ normal) * normal
    x = x / np.linalg.norm(x)
    return x, np.cross(normal, x)
