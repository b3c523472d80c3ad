"""Finds where an object can be gripped: annotated grasps from files, or antipodal ones sampled on its mesh.

A grasp is T_obj_gripper (4, 4) [m], in the gripper's frame of ``gripper.py``.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import platformdirs
from numpy.typing import NDArray

from verefine_viz.core.algorithm_settings import GraspSettings
from verefine_viz.core.array_cache import NPZ_READING, Arrays, cached
from verefine_viz.core.arrays import Float, finite, plain_array
from verefine_viz.core.errors import ContentError, InputError, ShapeError
from verefine_viz.core.files import reading
from verefine_viz.core.geometry import as_rigid, axis_angle, rounding_note, transform
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.progress_token import NEVER_CANCELLED, ProgressToken
from verefine_viz.core.ray_scene import queries, ray_scene
from verefine_viz.core.text_format import unusable
from verefine_viz.grasping.gripper import APPROACH_M, FINGER_M, PALM_FRONT_M, PINCH_M, TIP_M, is_blocked

FORMAT = 1
"""Part of the cache's file names; raise it when grasps are sampled in another way."""
TRIED = 4000
"""Points of the surface at which antipodal pairs are searched."""
PAIRS = 400
"""Most antipodal pairs that are used."""
TURNS = 12
"""Approach directions about the line between the fingers."""
CONE_DEG = 14.0
"""Largest angle between the surfaces' normals and the line between the fingers [deg]: friction 0.25."""
SPARE_M = 0.010
"""Least clearance between the open fingers and the object [m]."""
MOST = 10_000
"""Most annotated grasps of an object."""
AGREES = 0.5
"""Least share of annotated grasps with the object between the fingers; else they belong to another object."""


@dataclass(frozen=True, eq=False)
class Grasps:
    """Grasps of one object."""

    T_obj_gripper: Float
    """(N, 4, 4) [m]."""
    source: Literal["annotated", "sampled"]
    notes: tuple[str, ...] = ()
    """Notes on annotated grasps that are left out, and on rounded rotations."""


def grasps_of(model: ObjectModel, settings: GraspSettings, progress: ProgressToken = NEVER_CANCELLED) -> Grasps:
    """The grasps of ``model``: annotated ones where ``settings.folder`` has them, else sampled and cached.

    Raises:
        InputError: the folder or the object's file cannot be used, or holds grasps of another object.
        Cancelled: through ``progress``.
    """
    if settings.folder:
        file = _annotated_file(Path(settings.folder), model)
        if file is not None:
            return read_annotated(file, model, settings)
    key = f"{model.mesh_hash} {settings.samples} {settings.seed} {settings.opening_m}"
    name = hashlib.sha256(key.encode()).hexdigest()[:32]
    path = platformdirs.user_cache_path("verefine-viz") / "grasps" / f"{name}-{FORMAT}.npz"
    poses = cached(
        path,
        lambda: sampled(model, settings),
        _unpacked,
        lambda poses: {"T_obj_gripper": poses},
        progress.checkpoint,
        preparing=f"Sampling grasps on {model.name}; cached once they are made.",
        waiting=f"Waiting for the grasps of {model.name}, which another process is sampling.",
    )
    return Grasps(poses, "sampled")


def _unpacked(arrays: Arrays) -> Float:
    return finite(arrays["T_obj_gripper"], "grasps", (None, 4, 4))


def grasp_files(folder: Path) -> list[Path]:
    """The files of annotated grasps.

    Raises:
        InputError: the folder is none, or holds no .npy file.
    """
    if not folder.is_dir():
        raise InputError(f"grasp.folder {folder} is no folder; expected one with a .npy file per object")
    files = sorted(folder.glob("*.npy"))
    if not files:
        raise InputError(f"grasp.folder {folder} holds no .npy files; expected one per object, as obj_000010.npy")
    return files


def _annotated_file(folder: Path, model: ObjectModel) -> Path | None:
    """The object's file: ``011_banana.npy``, or ``banana.npy``, of an object so named; or ``obj_000010.npy``.

    Raises:
        InputError: the folder is none, or holds no .npy file.
    """
    files = grasp_files(folder)
    names = (model.name, f"obj_{model.obj_id:06d}")
    for file in files:
        if file.stem in names or file.stem.split("_", 1)[-1] in names:
            return file
    return None


def read_annotated(file: Path, model: ObjectModel, settings: GraspSettings) -> Grasps:
    """The annotated grasps of a file, without entries that are no transform.

    Raises:
        InputError: the file is no array of transforms in metres, or its grasps have none of ``model`` between the
            fingers.
    """
    with reading(file, "grasps") as opened:
        with NPZ_READING:
            numbers = plain_array(np.load(opened, allow_pickle=False), np.float64)
        if numbers.size % 16:
            raise ContentError(f"an array of shape {numbers.shape}, expected (N, 4, 4) or (N, 16)")
        numbers = numbers.reshape(-1, 4, 4)
        if not 0 < len(numbers) <= MOST:
            raise ContentError(f"{len(numbers)} grasps, expected 1 to {MOST}")
        rigid: list[Float] = []
        faults: list[str] = []
        for k, T in enumerate(numbers):
            try:
                rigid.append(as_rigid(T, f"grasp {k + 1}, 4×4 in metres, row by row,"))
            except ShapeError as error:
                faults.append(str(error))
        if not rigid:
            raise ContentError(faults[0])
        poses = np.array(rigid)
    share = float(np.mean(_between(poses, model.points, settings.opening_m)))
    if share < AGREES:
        raise InputError(
            f"{file}: {1 - share:.0%} of the grasps have nothing of {model.name} ({model.obj_id}) between the fingers; "
            "they belong to another object, or are not in metres in its frame"
        )
    notes = (*unusable("grasp", file.name, faults), *rounding_note(file.name, numbers[:, :3, :3]))
    return Grasps(poses, "annotated", notes)


def _between(poses: Float, points: Float, opening_m: float) -> NDArray[np.bool_]:
    """Which grasps (N, 4, 4) have a point (M, 3) between the open fingers, and none in palm or fingers."""
    half = opening_m / 2
    inside = np.zeros(len(poses), dtype=bool)
    for k, T in enumerate(poses):
        x, y, z = ((points - T[:3, 3]) @ T[:3, :3]).T
        inside[k] = ((np.abs(x) < FINGER_M[0] / 2) & (np.abs(y) < half) & (z > PALM_FRONT_M) & (z < TIP_M)).any()
    return inside & ~is_blocked(poses, points, opening_m, 0.0)


def sampled(model: ObjectModel, settings: GraspSettings) -> Float:
    """At most ``settings.samples`` antipodal grasps (N, 4, 4) [m], spread over the object; a seed fixes them.

    A ray goes from a point of the surface straight into the object. Where it comes out, the surface must face the
    other way within ``CONE_DEG``. The gripper comes from ``TURNS`` directions about that line; those from which the
    open gripper meets the object are dropped. Source: Chen & Burdick, "Finding antipodal point grasps", 1993.
    """
    rng = np.random.default_rng((settings.seed, 30))
    chosen = rng.integers(len(model.points), size=TRIED)
    starts, normals = model.points[chosen], model.point_normals[chosen]
    rays = queries(np.concatenate([starts - 1e-4 * normals, -normals], axis=1))
    hits = ray_scene(model.vertices, model.faces).cast_rays(rays)
    width = hits["t_hit"].numpy().astype(np.float64) + 1e-4
    opposite = np.abs((hits["primitive_normals"].numpy().astype(np.float64) * normals).sum(axis=1))
    good = (width < settings.opening_m - SPARE_M) & (width > 0.005) & (opposite >= np.cos(np.radians(CONE_DEG)))
    middles = starts[good] - 0.5 * width[good, None] * normals[good]
    turns = rng.uniform(0, 2 * np.pi / TURNS, size=len(middles))
    poses = [
        _around(middle, along, turn + 2 * np.pi * k / TURNS)
        for middle, along, turn in zip(middles[:PAIRS], normals[good][:PAIRS], turns[:PAIRS], strict=True)
        for k in range(TURNS)
    ]
    if not poses:
        return np.zeros((0, 4, 4))
    free = np.array(poses)
    free = free[~is_blocked(free, model.points, settings.opening_m, APPROACH_M)]
    return free[_spread(free, settings.samples, model.diameter_m)]


def _around(middle: Float, along: Float, turn_rad: float) -> Float:
    """Pose of the gripper whose fingers close along a direction, with a point in the middle between its pads."""
    across = np.cross(along, np.eye(3)[np.argmin(np.abs(along))])
    across /= np.linalg.norm(across)
    z = axis_angle(along, turn_rad) @ across
    R = np.stack([np.cross(along, z), along, z], axis=1)
    return transform(R, middle - PINCH_M * z)


def _spread(poses: Float, n: int, diameter_m: float) -> NDArray[np.intp]:
    """Indices of ``n`` poses far from each other in place and approach, the first one given."""
    if len(poses) <= n:
        return np.arange(len(poses))
    where = np.concatenate([poses[:, :3, 3], 0.5 * diameter_m * poses[:, :3, 2]], axis=1)
    taken = [0]
    nearest = np.linalg.norm(where - where[0], axis=1)
    while len(taken) < n:
        taken.append(int(np.argmax(nearest)))
        nearest = np.minimum(nearest, np.linalg.norm(where - where[taken[-1]], axis=1))
    return np.array(taken, dtype=np.intp)
