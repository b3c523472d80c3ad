"""Corrections of depth, cameras and poses by settings, and how further corrections are combined with them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from msgspec import structs
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float
from verefine_viz.core.camera import Camera
from verefine_viz.core.geometry import axis_angle, inverse, transform
from verefine_viz.core.settings import DataSettings, PoseConvention

TO_OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])


def _about_x(deg: float) -> Float:
    return transform(axis_angle(np.array([1.0, 0.0, 0.0]), np.radians(deg)), np.zeros(3))


IN_CONVENTION: Mapping[PoseConvention, Callable[[Float], Float]] = {
    "given": lambda T: T,
    "inverse": inverse,
    "opengl": lambda T: TO_OPENGL @ T,
    "transposed": lambda T: transform(T[:3, :3].T, T[:3, 3]),
    "x90": lambda T: T @ _about_x(90),
    "x-90": lambda T: T @ _about_x(-90),
}
"""Functions that make T_cam_obj (4, 4) of a pose written in another convention."""


AS_READ = DataSettings()


MADE_FROM_TRUTH = "perturbed"
"""Beginning of the source of initial poses that are made from ground truth, which is never corrected."""


def corrected_pose(T_cam_obj: Float, data: DataSettings) -> Float:
    """The corrected pose (4, 4) of an initial pose as read."""
    T = transform(T_cam_obj[:3, :3], data.pose_times * T_cam_obj[:3, 3])
    return IN_CONVENTION[data.poses](T)


def corrected_depth(depth_m: NDArray[np.float32], camera: Camera, data: DataSettings) -> NDArray[np.float32]:
    """The corrected depth image (H, W) [m], for a camera that is already corrected."""
    depth_m = displaced(depth_m, data.depth_shift_px) * np.float32(data.depth_times)
    if data.depth_along == "z":
        return depth_m
    rays = np.linalg.norm(camera.back_project(np.ones(camera.shape)), axis=2)
    return (depth_m / rays).astype(np.float32)


def displaced(depth_m: NDArray[np.float32], shift_px: tuple[int, int]) -> NDArray[np.float32]:
    """A depth image (H, W) [m] whose pixels take the depth this far to the right and down; 0 where that is outside."""
    right, down = shift_px
    if right == down == 0:
        return depth_m
    h, w = depth_m.shape
    pad = max(abs(right), abs(down))
    padded = np.pad(depth_m, pad)
    return padded[pad + down : pad + down + h, pad + right : pad + right + w].astype(np.float32)


def corrected_camera(camera: Camera, data: DataSettings) -> Camera:
    """The corrected camera of a frame.

    Raises:
        ShapeError: no camera has such a matrix.
    """
    fx, fy, cx, cy = data.camera_times
    K = camera.K * np.array([[fx, 1, cx], [1, fy, cy], [1, 1, 1]])
    return Camera(K, camera.width, camera.height)


def on_top(data: DataSettings, more: DataSettings) -> DataSettings | None:
    """Settings that correct first by ``data``, then by ``more``; None where no settings do both."""
    if data.poses != "given" and (more.poses != "given" or more.pose_times != 1):
        return None
    if data.depth_along == more.depth_along == "ray":
        return None
    times = dict(data.model_times)
    times |= {obj_id: times.get(obj_id, 1.0) * factor for obj_id, factor in more.model_times}
    right, down = (one + other for one, other in zip(data.depth_shift_px, more.depth_shift_px, strict=True))
    fx, fy, cx, cy = (one * other for one, other in zip(data.camera_times, more.camera_times, strict=True))
    return DataSettings(
        depth_times=data.depth_times * more.depth_times,
        depth_along=data.depth_along if more.depth_along == "z" else more.depth_along,
        depth_shift_px=(right, down),
        camera_times=(fx, fy, cx, cy),
        model_times=tuple((obj_id, factor) for obj_id, factor in sorted(times.items()) if factor != 1),
        pose_times=data.pose_times * more.pose_times,
        poses=data.poses if more.poses == "given" else more.poses,
        inverted_masks=tuple(sorted({*data.inverted_masks} ^ {*more.inverted_masks})),
    )


def changes_between(before: DataSettings, after: DataSettings) -> dict[str, Any]:
    """Settings by dotted name that differ between two corrections, with their new values."""
    return {
        f"data.{name}": getattr(after, name)
        for name in DataSettings.__struct_fields__
        if getattr(after, name) != getattr(before, name)
    }


def of_models(obj_ids: Sequence[int], times: float) -> DataSettings:
    """The setting that enlarges some models by a factor."""
    return structs.replace(AS_READ, model_times=tuple((obj_id, times) for obj_id in sorted({*obj_ids})))
