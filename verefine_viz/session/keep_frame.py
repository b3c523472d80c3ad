"""Keeps frames of a running pipeline to debug them later; arrays are enough, no data set is needed.

    keep_frame("kept", K, depth_m, rgb, [Found("mug.stl", mask, {"my_net": T_cam_obj})])

and then ``verefine-viz view kept/session.toml``.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from verefine_viz.core.arrays import Float, finite, frozen
from verefine_viz.core.camera import Camera
from verefine_viz.core.errors import InputError, ShapeError
from verefine_viz.scenes.intrinsics import intrinsics_of
from verefine_viz.session.found import Found, checked_object
from verefine_viz.session.kept_entries import KeptFrame
from verefine_viz.session.kept_folder import KeptFolder

__all__ = ["Found", "keep_frame"]

FARTHEST_M = 60.0
"""Depth beyond is none; a median beyond is no depth in metres."""


def keep_frame(
    folder: Path | str,
    K: ArrayLike,
    depth_m: ArrayLike,
    rgb: ArrayLike | None,
    objects: Sequence[Found],
    gravity_cam: ArrayLike | None = None,
) -> str:
    """Adds a frame to a folder, which becomes a small data set in BOP layout with ``session.toml`` over all its frames.

    All is checked before anything is written, and the frame exists once it is whole.

    Args:
        folder: is made if it does not exist; else one that this function made.
        K: (3, 3) intrinsics [px].
        depth_m: (H, W) z [m]; 0, NaN or infinity where nothing was measured.
        rgb: (H, W, 3) uint8, or None.
        objects: what was found, each with its mask and its poses: a list of :class:`Found`.
        gravity_cam: (3,) direction in which things fall, in the camera's frame, of any length, as an IMU or the robot's
            kinematics have it (an accelerometer at rest reads the opposite); None = along the normal of the table that
            is seen.

    Returns:
        The frame's name, as "1/17"; ``--scene.frames 1/17`` opens it alone.

    Raises:
        InputError: an array has another shape or unit, a mask is empty, a mesh cannot be read or is another one than
            the name had before, the folder holds something else or cannot be written.
    """
    try:
        frame = _checked(K, depth_m, rgb, objects, gravity_cam)
    except ShapeError as error:
        raise InputError(str(error)) from None
    return KeptFolder(Path(folder)).add(frame)


def _checked(
    K: ArrayLike, depth_m: ArrayLike, rgb: ArrayLike | None, objects: Sequence[Found], gravity_cam: ArrayLike | None
) -> KeptFrame:
    depth = _depth(depth_m)
    entry = {"cam_K": finite(K, "K", (3, 3)).tolist()}
    camera = Camera(intrinsics_of(entry, "K"), depth.shape[1], depth.shape[0])
    photo = None if rgb is None else _photo(rgb, camera.shape)
    down = None if gravity_cam is None else finite(gravity_cam, "gravity_cam", (3,))
    if down is not None and not down.any():
        raise ShapeError("gravity_cam is 0, expected a direction")
    if not objects:
        raise InputError("no object is given, expected at least one")
    if isinstance(objects, Found) or not all(isinstance(found, Found) for found in objects):
        raise InputError("objects is no list of Found, expected [Found(mesh, mask, …), …]")
    n_true = sum(found.T_cam_obj_gt is not None for found in objects)
    if n_true not in (0, len(objects)):
        raise InputError(f"{n_true} of {len(objects)} objects have a true pose; give all of them one, or none")
    points = camera.back_project(depth)
    checked = [checked_object(found, k, camera, points) for k, found in enumerate(objects)]
    return KeptFrame(camera.K, depth, photo, checked, down)


def _depth(depth_m: ArrayLike) -> Float:
    depth = np.nan_to_num(frozen(depth_m, "depth_m", (None, None)), nan=0.0, posinf=0.0, neginf=0.0)
    if not depth.any():
        raise ShapeError("depth_m has no measured pixel")
    if depth.min() < 0:
        raise ShapeError(f"depth_m goes down to {depth.min():.3g}, expected metres, and 0 where nothing was measured")
    median_m = float(np.median(depth[depth > 0]))
    if median_m > FARTHEST_M:
        raise ShapeError(f"depth_m has a median of {median_m:.4g}, expected metres; divide millimetres by 1000")
    return np.where(depth > FARTHEST_M, 0.0, depth)


def _photo(rgb: ArrayLike, shape: tuple[int, int]) -> NDArray[np.uint8]:
    photo = np.asarray(rgb)
    if photo.dtype != np.uint8:
        raise ShapeError(f"rgb is of {photo.dtype}, expected uint8, 0 to 255")
    return frozen(photo, "rgb", (*shape, 3), np.uint8)
