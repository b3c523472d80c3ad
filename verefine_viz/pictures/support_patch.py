"""What was seen of the support plane: which pixels lie on it and what they span; drawn alike in photo and 3D."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.ndimage import label
from scipy.spatial import ConvexHull, QhullError

from verefine_viz.core.arrays import Float, Mask
from verefine_viz.core.geometry import apply, inverse
from verefine_viz.core.observation import ON_PLANE_M, Observation

_LEAST_SHARE = 0.05
"""Smaller regions than this share of the largest one do not widen the outline: far surfaces that the plane cuts."""


@dataclass(frozen=True, eq=False)
class SupportPatch:
    """What was seen of a support plane."""

    inliers: Mask
    """(H, W) pixels of the background that lie on it."""
    outline_cam: Float
    """(n, 3) corners of their convex hull on the plane, in order [m]; none where they span nothing."""


@lru_cache(maxsize=4)
def support_patch(observation: Observation) -> SupportPatch | None:
    """Return what was seen of the frame's support plane; None where it has none."""
    support, depth_m = observation.support, observation.depth_m
    if support is None:
        return None
    points_world = apply(support.T_world_cam, observation.camera.back_project(depth_m).reshape(-1, 3))
    heights_m = (points_world @ support.normal_world).reshape(depth_m.shape)
    inliers = (np.abs(heights_m) < ON_PLANE_M) & (depth_m > 0) & ~observation.object_mask
    regions = np.zeros(inliers.shape, np.int32)
    label(inliers, output=regions)
    if not inliers.any():
        return SupportPatch(inliers, np.zeros((0, 3)))
    sizes = np.bincount(regions.ravel())[1:]
    large = np.append(False, sizes >= _LEAST_SHARE * sizes.max())[regions]
    # What is convex in the plane is so in the image: the ends of rows have the corners.
    rows = np.flatnonzero(large.any(axis=1))
    ends = [large[rows].argmax(axis=1), large.shape[1] - 1 - large[rows, ::-1].argmax(axis=1)]
    at = np.concatenate([rows * large.shape[1] + columns for columns in ends])
    return SupportPatch(inliers, _outline(points_world[at], support.normal_world, support.T_world_cam))


def _outline(points_world: Float, normal_world: Float, T_world_cam: Float) -> Float:
    """Return the corners (n, 3) of what points (m, 3) span on a plane through the origin, in the camera frame."""
    across = np.cross(normal_world, [0.0, 1.0, 0.0] if abs(normal_world[1]) < 0.9 else [1.0, 0.0, 0.0])
    axes = np.stack([across / np.linalg.norm(across), np.cross(normal_world, across / np.linalg.norm(across))])
    xy = points_world @ axes.T
    try:
        corners = xy[ConvexHull(xy).vertices]
    except QhullError:  # All on a line.
        return np.zeros((0, 3))
    return apply(inverse(T_world_cam), corners @ axes)
