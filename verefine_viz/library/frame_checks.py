"""Checks of arrays that become a frame: their shapes and units, and whether they fit together."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from contextlib import suppress
from itertools import chain, zip_longest
from numbers import Real
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from verefine_viz.core.arguments import checked_name, checked_path, described
from verefine_viz.core.arrays import Float, Mask, finite, frozen
from verefine_viz.core.camera import Camera
from verefine_viz.core.errors import InputError, ShapeError
from verefine_viz.core.geometry import apply, as_rigid, rounding_note
from verefine_viz.core.label_images import labels_fault, labels_in
from verefine_viz.core.problem import Hypothesis
from verefine_viz.core.text_format import unusable
from verefine_viz.scenes.image_files import CameraEntry, intrinsics_of
from verefine_viz.scenes.meshes import AnyMesh, Mesh, mesh_of, read_mesh
from verefine_viz.scenes.recorded_frame import RecordedObject
from verefine_viz.trace import MESH

TOO_LARGE, TOO_SMALL = 30.0, 5.0
"""A mesh larger, or smaller, than the area under its mask by this factor must have a wrong unit. A mask may show a
small part of an object, but not much more than the object."""
LEAST_SEEN_M = 0.002
"""The least that a mask counts as covering, however few its pixels."""
UNITS_M = (0.001, 0.01, 0.0254, 1.0)
"""Units of mesh files: millimetres, centimetres, inches, metres."""
WHOLE = 0.9
"""Share of the image beyond which a mask is not that of one object."""
TOO_FAR = 30.0
"""A pose farther away than its mask by this factor must have a wrong unit."""
MOST_PIXELS = 25_000_000
"""No depth sensor has more pixels; computing takes hundreds of bytes for each."""
MOST_SKEW_PX = 0.5
LARGEST_UNIT_M = 1000.0
NEAREST_M, FARTHEST_M = 0.005, 60.0
"""Depth beyond the second counts as not measured; depth whose median is beyond either is not in metres."""
Poses = ArrayLike | Mapping[str, ArrayLike] | None


def checked_camera(K: ArrayLike, shape: tuple[int, ...]) -> Camera:
    """The camera of images of ``shape``; InputError or ShapeError where K is not a pinhole camera's matrix [px]."""
    matrix = finite(K, "K", (3, 3))
    if abs(matrix[0, 1]) > MOST_SKEW_PX:
        raise ShapeError(
            f"K has a skew of {matrix[0, 1]:g} px, expected 0: the camera has none here; rectify the images with a K "
            "without skew"
        )
    return Camera(intrinsics_of(CameraEntry(cam_K=matrix), "K"), shape[1], shape[0])


def _as_array(given: ArrayLike, name: str) -> NDArray[Any]:
    """An array of real numbers, of any shape; ShapeError where it is not one."""
    try:
        array = np.asarray(given)
    except (TypeError, ValueError, OverflowError):
        raise ShapeError(f"{name} is no array of numbers") from None
    if array.dtype.kind not in "biuf":
        raise ShapeError(f"{name} is {described(given)}, expected an array of numbers")
    return array


def direction(given: ArrayLike, name: str) -> Float:
    """A direction (3,) of any length; ShapeError where it is not one."""
    vector = finite(given, name, (3,))
    if not vector.any():
        raise ShapeError(f"{name} is 0, expected a direction")
    return vector


def checked_depth(depth_m: ArrayLike) -> NDArray[np.float32]:
    """Depth (H, W) [m], 0 where nothing was measured; ShapeError where it is no depth, or not in metres."""
    given = depth_m if isinstance(depth_m, np.ndarray) else np.asarray(depth_m, dtype=object)
    if given.size > MOST_PIXELS:
        raise ShapeError(f"depth_m is of {given.size / 1e6:.0f} megapixels, expected at most {MOST_PIXELS / 1e6:.0f}")
    if given.dtype.kind in "iu":
        raise ShapeError(f"depth_m is {given.dtype}, expected metres as floats; divide millimetres by 1000")
    depth = np.nan_to_num(frozen(depth_m, "depth_m", (None, None)), nan=0.0, posinf=0.0, neginf=0.0)
    if not depth.any():
        raise ShapeError("depth_m has no measured pixel")
    if depth.min() < 0:
        raise ShapeError(f"depth_m goes down to {depth.min():.3g}, expected metres, and 0 where nothing was measured")
    median_m = float(np.median(depth[depth > 0]))
    if not NEAREST_M < median_m <= FARTHEST_M:
        how = "divide millimetres by 1000" if median_m > 1 else "it looks divided by 1000 twice"
        raise ShapeError(f"depth_m has a median of {median_m:.4g}, expected metres; {how}")
    return np.where(depth > FARTHEST_M, 0.0, depth).astype(np.float32)


def checked_photo(rgb: ArrayLike, shape: tuple[int, int]) -> NDArray[np.uint8]:
    """A colour image (H, W, 3); ShapeError where it is not one of ``shape``."""
    photo = _as_array(rgb, "rgb")
    if photo.dtype != np.uint8:
        raise ShapeError(f"rgb is of {photo.dtype}, expected uint8, 0 to 255")
    return frozen(photo, "rgb", (*shape, 3), np.uint8)


def checked_object(
    camera: Camera,
    points_cam: Float,
    name: str,
    mesh: AnyMesh | Mesh,
    mask: ArrayLike | None,
    poses: Poses,
    scores: ArrayLike | None,
    unit_m: float,
    T_cam_obj_gt: ArrayLike | None,
    symmetry_axis: ArrayLike | None,
) -> tuple[RecordedObject, tuple[str, ...]]:
    """An object of a frame, checked against the measured points (H, W, 3) [m], 0 where nothing was measured.

    Returns:
        The object, with notes about invalid poses that are left out, and about rounded rotations.

    Raises:
        InputError: the mesh cannot be read, or the arguments do not fit together.
        ShapeError: an array has the wrong shape, or no pose is valid.
    """
    name = checked_name(name, "name of an object")
    is_file = isinstance(mesh, str | os.PathLike)
    path = checked_path(mesh, f"mesh of {name}", MESH) if is_file else None
    if not isinstance(unit_m, Real) or isinstance(unit_m, bool) or not 0 < unit_m <= LARGEST_UNIT_M:
        what = f"{described(unit_m)}, expected metres per unit of the mesh, as 0.001"
        raise InputError(f"unit_m of {name} is {what}")
    unit_m = float(unit_m)
    seen = covered = None
    if mask is not None:
        seen = _mask(mask, name, camera.shape)
        covered = points_cam[seen & (points_cam[..., 2] > 0)]
        if len(covered) == 0:
            raise ShapeError(f"mask of {name} has no measured depth")
    shape = _shape(mesh, unit_m, name) if path is None else read_mesh(path, unit_m)
    of = f"mesh of {name}" if path is None else str(path)
    by_estimator = _by_estimator(poses, name)
    if covered is not None:
        _check_size(shape.diameter_m, covered, of, unit_m, _first_distance_m(T_cam_obj_gt, *by_estimator.values()))
    faults: list[str] = []
    taken: list[Float] = []
    checked = {who: _poses(who, given, name, covered, faults, taken) for who, given in by_estimator.items()}
    if faults and not taken:
        raise ShapeError(faults[0])
    for who, some in checked.items():
        for T_cam_obj in (T for T in some if T is not None):
            _check_seen(T_cam_obj, shape, camera, f"pose of {name} by {who}")
    T_gt = None
    if T_cam_obj_gt is not None:
        T_gt = _near(T_cam_obj_gt, f"ground-truth pose of {name}", covered)
        _check_seen(T_gt, shape, camera, f"ground-truth pose of {name}")
        if covered is not None:
            _check_true(T_gt, shape, covered, f"ground-truth pose of {name}")
    if mask is None and not any(checked.values()):
        raise InputError(f"{name} has neither a mask nor a pose; give one of both")
    axis = None if symmetry_axis is None else direction(symmetry_axis, f"symmetry_axis of {name}")
    # Estimators take turns: the best pose of each, then the second best.
    turns = chain.from_iterable(zip_longest(*([(T, who) for T in some] for who, some in checked.items())))
    given = [one for one in turns if one is not None]
    theirs = [None] * len(given) if scores is None else finite(scores, f"scores of {name}", (len(given),)).tolist()
    used = [(T, who, score) for (T, who), score in zip(given, theirs, strict=True) if T is not None]
    hypotheses = tuple(Hypothesis(T, score or 0.0, who) for T, who, score in used)
    notes = (*unusable("pose", name, faults), *rounding_note(f"poses of {name}", taken))
    own = (shape, 1.0) if path is None else (path, unit_m)
    return RecordedObject(name, *own, seen, hypotheses, tuple(s for *_, s in used), (), T_gt, axis), notes


def _shape(mesh: Any, unit_m: float, name: str) -> Mesh:
    return mesh if isinstance(mesh, Mesh) else mesh_of(mesh, unit_m, name)


def _by_estimator(poses: Poses, name: str) -> Mapping[str, ArrayLike]:
    """Poses by the name of their estimator."""
    if poses is None:
        return {}
    by_estimator = poses if isinstance(poses, Mapping) else {"given": poses}
    for estimator in by_estimator:
        if not isinstance(estimator, str) or not re.fullmatch(r"\w[\w.+-]{0,80}", estimator):
            raise InputError(
                f"estimator {described(estimator)} of {name}: expected letters, digits, _ . + -, as it names a file"
            )
    return by_estimator


def _mask(given: ArrayLike, where: str, shape: tuple[int, int]) -> Mask:
    values = _as_array(given, f"mask of {where}")
    mask = frozen(values != 0, f"mask of {where}", shape, bool)
    if not mask.any():
        raise ShapeError(f"mask of {where} is empty")
    if np.issubdtype(values.dtype, np.floating) and np.ptp(values[mask]) > 0:
        raise ShapeError(f"mask of {where} holds shares, such as {values[mask][0]:.3g}; give it as mask > 0.5")
    if fault := labels_fault(values):
        raise ShapeError(f"mask of {where} {fault}; give it as mask == {labels_in(values)[0]}")
    if mask.mean() > WHOLE:
        raise ShapeError(f"mask of {where} covers {mask.mean():.0%} of the image; is it inverted?")
    return mask


def _check_size(diameter_m: float, covered: Float, mesh: str, unit_m: float, away_m: float) -> None:
    # Across the line of sight, and without the outermost tenths: the edge of a mask may lie on something far behind.
    across = covered[:, :2] / covered[:, 2:] * np.median(covered[:, 2])
    seen_m = float(np.linalg.norm(np.percentile(across, 90, axis=0) - np.percentile(across, 10, axis=0)))

    def fits(times: float, deeper: float = 1.0) -> bool:
        size_m = max(deeper * seen_m, LEAST_SEEN_M)
        return size_m / TOO_SMALL <= times * diameter_m <= size_m * TOO_LARGE

    if fits(1):
        return
    seen_m = max(seen_m, LEAST_SEEN_M)
    message = f"{mesh} is {diameter_m:.3g} m across, what its mask covers {seen_m:.3g} m; "
    mask_m = float(np.median(np.linalg.norm(covered, axis=1)))
    times = away_m / mask_m
    if away_m and not 0.5 < times < 2 and fits(1, deeper=times):
        raise InputError(
            f"{message}depth_m is {mask_m:.3g} m there, the pose {away_m:.3g} m away: about {times:.1g} times as much "
            "depth would fit, check its unit"
        )
    units = [unit for unit in UNITS_M if fits(unit / unit_m)]
    likely = min(units, key=lambda unit: abs(np.log(unit / unit_m * diameter_m / seen_m)), default=None)
    better = "no other unit of the mesh would fit: check depth_m and the mask"
    better = better if likely is None else f"{likely:g} would fit better"
    raise InputError(f"{message}unit_m = {unit_m:g} was given, {better}")


def _first_distance_m(*given: ArrayLike | None) -> float:
    """Distance of the first valid pose from the camera [m]; 0 where there is none."""
    for one in given:
        if one is None:
            continue
        with suppress(ValueError):
            T = _as_array(one, "pose").astype(np.float64).reshape(-1, 4, 4)
            if len(T):
                return float(np.linalg.norm(as_rigid(T[0], "pose")[:3, 3]))
    return 0.0


def _poses(
    estimator: str, given: ArrayLike, where: str, covered: Float | None, faults: list[str], taken: list[Float]
) -> list[Float | None]:
    """The poses of an estimator, None in place of an invalid one. Adds what is wrong with it to ``faults``, and the
    given rotations of the others to ``taken``.
    """
    name = f"pose of {where} by {estimator}"
    array = _as_array(given, name)
    if array.size == 0:
        return []
    poses: list[Float | None] = []
    for k, T_cam_obj in enumerate(array if array.ndim == 3 else [array]):
        try:
            as_rigid(T_cam_obj, name if array.ndim == 2 else f"{name}, number {k},")
        except ShapeError as error:
            if T_cam_obj.shape != (4, 4):
                raise
            faults.append(str(error))
            poses.append(None)
            continue
        poses.append(_near(T_cam_obj, name, covered))
        taken.append(T_cam_obj[:3, :3])
    return poses


def _near(T_cam_obj: ArrayLike, name: str, covered: Float | None) -> Float:
    """A rigid transform, near enough to be in metres."""
    T = as_rigid(T_cam_obj, name)
    away_m = float(np.linalg.norm(T[:3, 3]))
    if covered is None:
        if away_m > FARTHEST_M:
            raise InputError(f"{name} is {away_m:.3g} m away, expected T_cam_obj in metres")
        return T
    mask_m = float(np.median(np.linalg.norm(covered, axis=1)))
    if away_m > TOO_FAR * mask_m:
        raise InputError(f"{name} is {away_m:.3g} m away, its mask {mask_m:.3g} m; expected T_cam_obj in metres")
    return T


def _check_seen(T_cam_obj: Float, mesh: Mesh, camera: Camera, name: str) -> None:
    """Even a wrong estimate is about something in the image."""
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
    # To the nearest measured point, as some of the others may lie on another thing.
    middle = apply(T_cam_obj, mesh.vertices_m).mean(axis=0)
    nearest_m = float(np.linalg.norm(covered - middle, axis=1).min())
    if nearest_m <= mesh.diameter_m:
        return
    message = f"{name} is {nearest_m:.2g} m from what its mask covers; "
    measured_m, away_m = float(np.median(covered[:, 2])), float(middle[2])
    if np.linalg.norm(away_m / measured_m * np.median(covered, axis=0) - middle) < mesh.diameter_m:
        raise InputError(
            f"{message}depth_m is {measured_m:.3g} m there, the pose {away_m:.3g} m away: about "
            f"{away_m / measured_m:.2g} times as much depth would fit, check its unit"
        )
    raise InputError(f"{message}expected T_cam_obj of this object and frame: is it of another mask, or of another K?")
