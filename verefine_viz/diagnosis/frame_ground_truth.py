"""A frame according to its ground truth: depth that should have been seen, and the plane that supports the objects."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation
from scipy.spatial import ConvexHull, QhullError

from verefine_viz.calibration.depth_shift import Registration, registration_of
from verefine_viz.core.arrays import Float, Mask
from verefine_viz.core.geometry import apply, transform
from verefine_viz.core.observation import Support
from verefine_viz.core.problem import Placed, Problem
from verefine_viz.scenes.segments import draw_placed

# The plane that objects really stand on: a face of their common hull, at ground truth, on which they can rest.

TOUCHES_M = 0.003
"""Vertices closer to a face of the hull than this rest on its plane [m]."""
ON_M = 0.008
"""Background closer to a plane than this lies on it [m]."""
LEAST_SHARE = 0.02
"""Least share of the background near the objects that a visible plane holds (less what lies below it)."""
FIT_POINTS = 300
"""Least number of background points on a plane for a fit to them."""
POINTS = 4000
"""Most points of the background that are used."""
MOST_TURN_RAD = np.radians(6.0)
"""Largest turn of the plane by the fit; beyond, the fit follows something else."""


def supporting_plane(vertices_cam: Float, background_cam: Float) -> Support | None:
    """The support plane of objects at ground truth; the world has +z along its normal.

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
    planes = planes[planes[:, 3] > 0]  # The camera must be above the plane.
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


HIDDEN_M = 0.015
"""Something measured nearer than the true surface by more than this hides it [m]."""


@dataclass(frozen=True, eq=False)
class FrameGroundTruth:
    """All instances of a frame at ground truth."""

    problem: Problem

    @cached_property
    def placed(self) -> Mapping[int, Placed]:
        """The objects at ground truth, by instance_id, where it is known."""
        return {
            t.instance.instance_id: Placed(t.instance.instance_id, t.model, t.instance.T_cam_obj_gt)
            for t in self.problem.targets
            if t.instance.T_cam_obj_gt is not None
        }

    @cached_property
    def _rendered(self) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
        return draw_placed(self.placed.values(), self.problem.observation.camera)

    @property
    def depth_m(self) -> NDArray[np.float32]:
        """(H, W) what a perfect sensor would see of the instances [m]; 0 elsewhere."""
        return self._rendered[0]

    @cached_property
    def registration(self) -> Registration:
        """Shift and scale of the observed depth against the true one."""
        return registration_of(self.problem.observation.depth_m, self.depth_m)

    @cached_property
    def observed_m(self) -> NDArray[np.float32]:
        """(H, W) the observed depth, put right where it was shifted or scaled [m]."""
        depth_m = self.problem.observation.depth_m
        return self.registration.undone(depth_m) if self.registration.is_off else depth_m

    def outline(self, instance_id: int) -> Mask:
        """(H, W) where the instance is really visible: its rendering, without what something nearer hides."""
        nearer = (self.observed_m > 0) & (self.observed_m < self.depth_m - HIDDEN_M)
        return (self._rendered[1] == instance_id) & ~nearer

    @cached_property
    def support(self) -> Support | None:
        """The plane that the instances really stand on; None where it is not seen."""
        vertices = [apply(p.T_cam_obj, p.model.vertices) for p in self.placed.values()]
        if not vertices:
            return None
        observation = self.problem.observation
        is_object = binary_dilation(observation.object_mask | (self.depth_m > 0), iterations=3)
        depth_m = np.where(is_object, 0.0, self.observed_m)
        background: Float = observation.camera.back_project(depth_m)[depth_m > 0]
        return supporting_plane(np.concatenate(vertices), background)
