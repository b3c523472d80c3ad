"""A frame by its ground truth: what should have been seen, where depth is, and what supports the objects."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation
from scipy.spatial import ConvexHull, QhullError

from verefine_viz.core.arrays import Float, Mask
from verefine_viz.core.geometry import apply, transform
from verefine_viz.core.observation import Support
from verefine_viz.core.problem import Placed, Problem
from verefine_viz.scenes.segments import draw_placed

# The plane that objects really stand on: a face of the hull of all, at ground truth, that they can rest on.

TOUCHES_M = 0.003
"""Vertices closer to a face of the hull than this rest on its plane [m]."""
ON_M = 0.008
"""Background closer to a plane than this lies on it [m]."""
LEAST_SHARE = 0.02
"""A plane that holds less of the background near the objects (what lies below it taken off) is not seen."""
FIT_POINTS = 300
"""With so many points of background on it, the plane is fitted to them."""
POINTS = 4000
"""Points of the background that are used."""
MOST_TURN_RAD = np.radians(6.0)
"""A fit that turns the plane further than this follows something else."""


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


# Does the depth image lie on the colour image, and in the right unit? Objects with ground truth show it.

TAU_M = 0.020
"""Depths that differ by more than this do not agree at all [m]."""
REACH_PX = 40
"""Largest shift that is tried [px]."""
PIXELS = 3000
"""Pixels of the objects that are compared."""
MEASURED = 0.3
"""With less of the objects' pixels measured, nothing is off."""
GAIN = 0.06
"""Depth is off only if putting it right raises the agreement by more than this …"""
AGREES = 0.5
"""… to more than this."""
SURELY = 0.7
"""A change of scale has to lead to more agreement than this: something flat in front could pass for it."""
SHIFT_PX = 3
"""Less shift than this is noise of poses and edges [px]."""
SCALE = 0.015
"""Less change of scale than this is noise of the sensor."""


@dataclass(frozen=True)
class Registration:
    """How the observed depth has to be changed to lie on the true one."""

    shift_px: tuple[int, int]
    """(right, down): where the depth of a pixel is found, relative to it [px]."""
    scale: float
    """Observed z over true z."""
    agreement: float
    """Mean of max(0, 1 − |Δz| / 20 mm) over the measured pixels of the objects, as it is …"""
    best_agreement: float
    """… and after shift and scale are undone."""

    @property
    def is_off(self) -> bool:
        """Whether the depth is shifted or scaled."""
        changed = max(map(abs, self.shift_px)) >= SHIFT_PX or abs(self.scale - 1) >= SCALE
        return changed and self.best_agreement > AGREES and self.best_agreement - self.agreement > GAIN

    def undone(self, depth_m: NDArray[np.float32]) -> NDArray[np.float32]:
        """The depth image (H, W) [m] put right; 0 where that leaves a pixel without any."""
        h, w = depth_m.shape
        right, down = self.shift_px
        padded = np.pad(depth_m, max(abs(right), abs(down)))
        pad = (padded.shape[0] - h) // 2
        moved = padded[pad + down : pad + down + h, pad + right : pad + right + w]
        return (moved / np.float32(self.scale)).astype(np.float32)


def registration(observed_m: NDArray[np.floating], true_m: NDArray[np.floating]) -> Registration:
    """Shift and scale that bring an observed depth image (H, W) [m] onto the true depth of the objects in it.

    Args:
        observed_m: 0 where nothing was measured.
        true_m: 0 where there is no object whose pose is known.
    """
    v, u = np.nonzero(true_m > 0)
    if len(v) == 0:
        return Registration((0, 0), 1.0, 1.0, 1.0)
    step = 1 + len(v) // PIXELS
    v, u = v[::step], u[::step]
    padded = np.pad(np.asarray(observed_m, dtype=np.float64), REACH_PX)
    true = np.asarray(true_m, dtype=np.float64)[v, u]
    z = padded[v + REACH_PX, u + REACH_PX]
    as_it_is = _agreement(z, true)
    if np.count_nonzero(z) < MEASURED * len(v):
        return Registration((0, 0), 1.0, as_it_is, as_it_is)
    scale = float(np.median(z[z > 0] / true[z > 0]))
    scaled = _agreement(z / scale, true)
    if scaled > SURELY and abs(scale - 1) >= SCALE:
        return Registration((0, 0), scale, as_it_is, scaled)

    # Where something stands in front, a shift could only seem to help.
    free = ~((z > 0) & (z < true - TAU_M))
    if np.count_nonzero(free) < MEASURED * len(v):
        return Registration((0, 0), 1.0, as_it_is, as_it_is)
    v, u, true = v[free], u[free], true[free]

    def agreement(right: int, down: int) -> float:
        return _agreement(padded[v + down + REACH_PX, u + right + REACH_PX], true)

    before = agreement(0, 0)
    shift, best = (0, 0), before
    coarse = [(x, y) for x in range(-36, 37, 4) for y in range(-36, 37, 4)]
    for x, y in sorted(coarse, key=lambda s: s[0] ** 2 + s[1] ** 2):
        if (value := agreement(x, y)) > best + 1e-9:
            shift, best = (x, y), value
    x0, y0 = shift
    for x, y in ((x0 + i, y0 + j) for i in range(-3, 4) for j in range(-3, 4)):
        if (value := agreement(x, y)) > best + 1e-9:
            shift, best = (x, y), value
    return Registration(shift, 1.0, before, best)


def _agreement(z: NDArray[np.float64], true: NDArray[np.float64]) -> float:
    """Mean fit of observed to true depths (n,) [m] over those that were measured."""
    fit = np.clip(1 - np.abs(z - true) / TAU_M, 0, None)
    return float(fit[z > 0].sum() / max(np.count_nonzero(z), MEASURED * len(z), 1))


HIDDEN_M = 0.015
"""Something measured nearer than the true surface by more than this hides it [m]."""


@dataclass(frozen=True, eq=False)
class FrameGroundTruth:
    """All instances of a frame at ground truth."""

    problem: Problem

    @cached_property
    def placed(self) -> Mapping[int, Placed]:
        """By instance_id; those with ground truth."""
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
        """How the observed depth lies on the true one."""
        return registration(self.problem.observation.depth_m, self.depth_m)

    @cached_property
    def observed_m(self) -> NDArray[np.float32]:
        """(H, W) the observed depth, put right where it was shifted or scaled [m]."""
        depth_m = self.problem.observation.depth_m
        return self.registration.undone(depth_m) if self.registration.is_off else depth_m

    def outline(self, instance_id: int) -> Mask:
        """(H, W) where the instance really is seen: its rendering, less what something nearer hides."""
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
