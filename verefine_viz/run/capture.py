"""Saves frames of a running pipeline to debug them later; arrays are enough, no data set is needed.

    keep_frame("kept", K, depth_m, rgb, [DetectedObject("mug.stl", mask, {"my_net": T_cam_obj})])

and then ``verefine-viz view kept/session.toml``.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from verefine_viz.core.arrays import Float, Mask, finite, frozen
from verefine_viz.core.camera import Camera
from verefine_viz.core.errors import InputError, ShapeError
from verefine_viz.core.geometry import apply, as_rigid
from verefine_viz.run.capture_folder import CapturedFrame, CapturedObject, CaptureFolder
from verefine_viz.scenes.image_files import CameraEntry, intrinsics_of
from verefine_viz.scenes.meshes import Mesh, read_mesh

TOO_LARGE, TOO_SMALL = 30.0, 5.0
"""So many times as large, or as small, as what its mask covers a mesh must have a wrong unit. A mask may show a small
part of an object, but not much more than the object."""
LEAST_SEEN_M = 0.002
"""What a mask of a few pixels counts as covering."""
UNITS_M = (0.001, 0.01, 0.0254, 1.0)
"""Of mesh files: millimetres, centimetres, inches, metres."""
WHOLE = 0.9
"""Share of the image that no mask of one object covers."""
TOO_FAR = 30.0
"""So many times as far away as its mask a pose must have a wrong unit."""
NEAREST_M, FARTHEST_M = 0.005, 60.0
"""Depth beyond the second counts as not measured; a median beyond either is no depth in metres."""


@dataclass(frozen=True, eq=False)
class DetectedObject:
    """An object that a pipeline detected in a frame."""

    mesh: Path | str
    """PLY, OBJ, GLB or STL; the folder gets a copy."""
    mask: ArrayLike
    """(H, W) its visible pixels: all that is not 0."""
    poses: Mapping[str, ArrayLike] = field(default_factory=dict)
    """T_cam_obj [m] by estimator, (4, 4), or (N, 4, 4) with the best first. Of several objects of one mesh, a pose goes
    to the one whose mask it covers most. Without any, point pair features make hypotheses when the frame is opened."""
    name: str = ""
    """The object's name; empty = that of the mesh file. The same name in a later frame means the same mesh."""
    unit_m: float = 1.0
    """Metres per unit of the mesh file: 0.001 for millimetres."""
    T_cam_obj_gt: ArrayLike | None = None
    """(4, 4) ground truth [m] where it is known: of all objects of a frame, or of none."""
    symmetry_axis: ArrayLike | None = None
    """(3,) axis through the middle of the mesh's box about which every turn looks the same, as (0, 0, 1) of a bowl.
    Other symmetries: ``models/models_info.json`` of the folder, which is only added to."""


def keep_frame(
    folder: Path | str,
    K: ArrayLike,
    depth_m: ArrayLike,
    rgb: ArrayLike | None,
    objects: Sequence[DetectedObject],
    gravity_cam: ArrayLike | None = None,
) -> str:
    """Adds a frame to a folder, which becomes a small data set in BOP layout with ``session.toml`` over all its frames.

    All is checked before anything is written, and the frame exists once it is whole.

    Args:
        folder: is made if it does not exist; else one that this function made.
        K: (3, 3) intrinsics [px].
        depth_m: (H, W) z [m]; 0, NaN or infinity where nothing was measured.
        rgb: (H, W, 3) uint8, or None.
        objects: what was detected, each with its mask and its poses.
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
    return CaptureFolder(Path(folder)).add(frame)


def _checked(
    K: ArrayLike,
    depth_m: ArrayLike,
    rgb: ArrayLike | None,
    objects: Sequence[DetectedObject],
    gravity_cam: ArrayLike | None,
) -> CapturedFrame:
    depth = _depth(depth_m)
    entry = CameraEntry(cam_K=finite(K, "K", (3, 3)))
    camera = Camera(intrinsics_of(entry, "K"), depth.shape[1], depth.shape[0])
    photo = None if rgb is None else _photo(rgb, camera.shape)
    down = None if gravity_cam is None else finite(gravity_cam, "gravity_cam", (3,))
    if down is not None and not down.any():
        raise ShapeError("gravity_cam is 0, expected a direction")
    if not objects:
        raise InputError("no object is given, expected at least one")
    if isinstance(objects, DetectedObject) or not all(isinstance(one, DetectedObject) for one in objects):
        raise InputError("objects is no list of DetectedObject, expected [DetectedObject(mesh, mask, …), …]")
    n_true = sum(one.T_cam_obj_gt is not None for one in objects)
    if n_true not in (0, len(objects)):
        raise InputError(f"{n_true} of {len(objects)} objects have a ground-truth pose; give all of them one, or none")
    points = camera.back_project(depth)
    checked = [_checked_object(one, k, camera, points) for k, one in enumerate(objects)]
    return CapturedFrame(camera.K, depth, photo, checked, down)


def _depth(depth_m: ArrayLike) -> Float:
    depth = np.nan_to_num(frozen(depth_m, "depth_m", (None, None)), nan=0.0, posinf=0.0, neginf=0.0)
    if not depth.any():
        raise ShapeError("depth_m has no measured pixel")
    if depth.min() < 0:
        raise ShapeError(f"depth_m goes down to {depth.min():.3g}, expected metres, and 0 where nothing was measured")
    median_m = float(np.median(depth[depth > 0]))
    if not NEAREST_M < median_m <= FARTHEST_M:
        how = "divide millimetres by 1000" if median_m > 1 else "it looks divided by 1000 twice"
        raise ShapeError(f"depth_m has a median of {median_m:.4g}, expected metres; {how}")
    return np.where(depth > FARTHEST_M, 0.0, depth)


def _photo(rgb: ArrayLike, shape: tuple[int, int]) -> NDArray[np.uint8]:
    photo = np.asarray(rgb)
    if photo.dtype != np.uint8:
        raise ShapeError(f"rgb is of {photo.dtype}, expected uint8, 0 to 255")
    return frozen(photo, "rgb", (*shape, 3), np.uint8)


def _checked_object(detected: DetectedObject, k: int, camera: Camera, points_cam: Float) -> CapturedObject:
    """Object ``k`` of the frame, checked against the measured points (H, W, 3) [m], 0 where nothing was measured."""
    path = _path(detected.mesh, k)
    name = detected.name or path.stem
    where = f"object {k} ({name})"
    mask = _mask(detected.mask, where, camera.shape)
    covered = points_cam[mask & (points_cam[..., 2] > 0)]
    if len(covered) == 0:
        raise ShapeError(f"mask of {where} has no measured depth")
    if not isinstance(detected.unit_m, int | float) or not 0 < detected.unit_m < np.inf:
        raise InputError(f"unit_m of {where} is {detected.unit_m!r}, expected metres per unit of the mesh, as 0.001")
    mesh = read_mesh(path, detected.unit_m)
    if not isinstance(detected.poses, Mapping):
        raise InputError(f"poses of {where} is no dict, expected {{'my_net': T_cam_obj}}")
    _check_size(mesh.diameter_m, covered, detected, path)
    poses = {estimator: _poses(estimator, given, where, covered) for estimator, given in detected.poses.items()}
    for estimator, some in poses.items():
        for T_cam_obj in some:
            _check_seen(T_cam_obj, mesh, camera, f"pose of {where} by {estimator}")
    T_gt = None
    if detected.T_cam_obj_gt is not None:
        T_gt = _near(detected.T_cam_obj_gt, f"ground-truth pose of {where}", covered)
        _check_seen(T_gt, mesh, camera, f"ground-truth pose of {where}")
        _check_true(T_gt, mesh, covered, f"ground-truth pose of {where}")
    axis = None if detected.symmetry_axis is None else finite(detected.symmetry_axis, f"symmetry_axis of {where}", (3,))
    if axis is not None and not axis.any():
        raise ShapeError(f"symmetry_axis of {where} is 0, expected a direction")
    return CapturedObject(name, mesh, mask, poses, T_gt, axis)


def _path(mesh: object, k: int) -> Path:
    if not isinstance(mesh, str | Path):
        raise InputError(
            f"mesh of object {k} is a {type(mesh).__name__}, expected the path of a PLY, OBJ, GLB or STL file"
        )
    return Path(mesh)


def _mask(given: ArrayLike, where: str, shape: tuple[int, int]) -> Mask:
    values = np.asarray(given)
    mask = frozen(values != 0, f"mask of {where}", shape, bool)
    if not mask.any():
        raise ShapeError(f"mask of {where} is empty")
    if np.issubdtype(values.dtype, np.floating) and np.ptp(values[mask]) > 0:
        raise ShapeError(f"mask of {where} holds shares, such as {values[mask][0]:.3g}; give it as mask > 0.5")
    if mask.mean() > WHOLE:
        raise ShapeError(f"mask of {where} covers {mask.mean():.0%} of the image; is it inverted?")
    return mask


def _check_size(diameter_m: float, covered: Float, detected: DetectedObject, path: Path) -> None:
    # Across the line of sight, and without the outermost tenths: the edge of a mask may lie on something far behind.
    across = covered[:, :2] / covered[:, 2:] * np.median(covered[:, 2])
    seen_m = float(np.linalg.norm(np.percentile(across, 90, axis=0) - np.percentile(across, 10, axis=0)))

    def fits(times: float, deeper: float = 1.0) -> bool:
        size_m = max(deeper * seen_m, LEAST_SEEN_M)
        return size_m / TOO_SMALL <= times * diameter_m <= size_m * TOO_LARGE

    if fits(1):
        return
    seen_m = max(seen_m, LEAST_SEEN_M)
    message = f"{path} is {diameter_m:.3g} m across, what its mask covers {seen_m:.3g} m; "
    mask_m, away_m = float(np.median(np.linalg.norm(covered, axis=1))), _first_distance_m(detected)
    times = away_m / mask_m
    if away_m and not 0.5 < times < 2 and fits(1, deeper=times):
        raise InputError(
            f"{message}depth_m is {mask_m:.3g} m there, the pose {away_m:.3g} m away: about {times:.1g} times as much "
            "depth would fit, check its unit"
        )
    units = [unit for unit in UNITS_M if fits(unit / detected.unit_m)]
    likely = min(units, key=lambda unit: abs(np.log(unit / detected.unit_m * diameter_m / seen_m)), default=None)
    better = "no other unit of the mesh would fit: check depth_m and the mask"
    better = better if likely is None else f"{likely:g} would fit better"
    raise InputError(f"{message}unit_m = {detected.unit_m:g} was given, {better}")


def _first_distance_m(detected: DetectedObject) -> float:
    """How far away the first pose of an object is that can be read [m]; 0 where there is none."""
    for given in (detected.T_cam_obj_gt, *detected.poses.values()):
        with suppress(TypeError, ValueError, ShapeError):
            T = np.asarray(given, dtype=np.float64).reshape(-1, 4, 4)
            if len(T):
                return float(np.linalg.norm(as_rigid(T[0], "pose")[:3, 3]))
    return 0.0


def _poses(estimator: str, given: ArrayLike, where: str, covered: Float) -> list[Float]:
    if not re.fullmatch(r"\w[\w.+-]{0,80}", estimator):
        raise InputError(f"estimator {estimator!r} of {where}: expected letters, digits, _ . + -, as it names a file")
    name = f"pose of {where} by {estimator}"
    try:
        array = np.asarray(given, dtype=np.float64)
    except (TypeError, ValueError):
        raise ShapeError(f"{name} is no array, expected (4, 4) or (N, 4, 4)") from None
    if array.size == 0:
        return []
    return [_near(T_cam_obj, name, covered) for T_cam_obj in (array if array.ndim == 3 else [array])]


def _near(T_cam_obj: ArrayLike, name: str, covered: Float) -> Float:
    """A rigid transform, not as far away as one in millimetres would be."""
    T = as_rigid(T_cam_obj, name)
    away_m, mask_m = float(np.linalg.norm(T[:3, 3])), float(np.median(np.linalg.norm(covered, axis=1)))
    if away_m > TOO_FAR * mask_m:
        raise InputError(f"{name} is {away_m:.3g} m away, its mask {mask_m:.3g} m; expected T_cam_obj in metres")
    return T


def _check_seen(T_cam_obj: Float, mesh: Mesh, camera: Camera, name: str) -> None:
    """An estimate may be wrong, but is of something in the image."""
    points = apply(T_cam_obj, mesh.vertices_m)
    ahead = points[points[:, 2] > 0]
    if len(ahead) == 0:
        raise InputError(
            f"{name} lies behind the camera (z = {points[:, 2].mean():.2g} m); expected OpenCV's axes, z forward"
        )
    u, v = camera.project(ahead).T
    if not (u.max() >= 0 and v.max() >= 0 and u.min() < camera.width and v.min() < camera.height):
        raise InputError(
            f"{name} lies outside of the image; expected T_cam_obj, which maps the object's points into the camera's "
            "frame: is it the inverse, or of another K?"
        )


def _check_true(T_cam_obj: Float, mesh: Mesh, covered: Float, name: str) -> None:
    # To the nearest measured point: of the others some may lie on something else.
    nearest_m = float(np.linalg.norm(covered - apply(T_cam_obj, mesh.vertices_m).mean(axis=0), axis=1).min())
    if nearest_m > mesh.diameter_m:
        raise InputError(
            f"{name} is {nearest_m:.2g} m from what its mask covers; expected T_cam_obj of this object and frame"
        )
