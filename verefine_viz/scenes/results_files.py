"""Estimated poses in files of other formats than BOP's CSV: arrays (.npz), and YAML as FoundationPose writes it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.array_cache import NPZ_READING
from verefine_viz.core.arrays import Float, plain_array
from verefine_viz.core.errors import ContentError, InputError
from verefine_viz.core.files import Numbers4x4, array_of, id_of, read_yaml, reading
from verefine_viz.core.geometry import as_rigid, rounding_note, transform
from verefine_viz.core.text_format import unusable
from verefine_viz.scenes.results_csv import HEADER, Estimates, ResultRow, read_poses

PICKLED = (".pkl", ".pickle", ".pth", ".pt", ".tar")
YAML = (".yml", ".yaml")
IDS = (("scene_id",), ("im_id", "image_id", "view_id"), ("obj_id", "object_id", "category_id"))
FARTHEST_IN_METRES = 20.0
"""Poses whose median distance is larger are in millimetres."""
MOST_ROWS, MOST_BYTES = 500_000, 1_000_000_000


def read_estimates(path: Path | str) -> Estimates:
    """The estimates of a results file: BOP's CSV, .npz or .yml.

    Raises:
        InputError: it is missing, pickled or damaged, or holds no pose that can be used; what was expected is named.
    """
    path = Path(path)
    if path.suffix in PICKLED:
        raise InputError(f"{path} is pickled, and reading it could run code; write its poses as a CSV: {HEADER}")
    if path.suffix in YAML:
        return _rows_of_yaml(path)
    return _rows_of_arrays(path) if path.suffix == ".npz" else read_poses(path)


def _rows_of_yaml(path: Path) -> Estimates:
    """Scene, image and object above each other, with poses (4, 4) in metres and no scores."""
    with reading(path):
        scenes = read_yaml(path, dict[str | int, dict[str | int, dict[str | int, Any]]])
        given = (
            (f"{scene}, {image}, {name}", [id_of(str(key)) for key in (scene, image, name)], 1.0, T)
            for scene, images in scenes.items()
            for image, objects in images.items()
            for name, T in objects.items()
        )
        return _usable(path, given, "no poses, expected {scene: {image: {object: 4×4 [m]}}}")


def _rows_of_arrays(path: Path) -> Estimates:
    """A row for each entry of ``scene_id``, ``im_id``, ``obj_id``, ``poses`` or ``R`` and ``t`` [mm], and ``score``."""
    with reading(path) as file, NPZ_READING, np.load(file, allow_pickle=False) as archive:
        if sum(entry.file_size for entry in archive.zip.infolist()) > MOST_BYTES:
            raise ContentError(f"its arrays are larger than {MOST_BYTES / 1e6:g} MB")
        arrays: Mapping[str, NDArray[Any]] = {name: archive[name] for name in archive.files}
        ids = [_column(arrays, names) for names in IDS]
        poses = _poses(arrays)
        scores = _column(arrays, ("score", "scores")) if {"score", "scores"} & {*arrays} else np.ones(len(poses))
        lengths = {len(column) for column in (*ids, poses, scores)}
        if len(poses) > MOST_ROWS:
            raise ContentError(f"it has {len(poses)} poses, expected at most {MOST_ROWS}; write those of fewer images")
        if len(lengths) != 1 or not len(poses):
            raise ContentError(f"its arrays have {', '.join(map(str, sorted(lengths)))} entries, expected one number")
        own = np.stack(ids, axis=1)
        numbers = [[int(n) if n % 1 == 0 and abs(n) < 2**53 else None for n in row] for row in own.tolist()]
        given = (
            (f"entry {k}", row, score, T)
            for k, (row, score, T) in enumerate(zip(numbers, scores.tolist(), poses, strict=True))
        )
        return _usable(path, given, "no poses")


def _usable(path: Path, given: Iterable[tuple[str, Sequence[int | None], float, Any]], without: str) -> Estimates:
    """The estimates of (place in the file, ids, score, pose) that can be used.

    Raises:
        ContentError: there is none; ``without`` is what to say where nothing is given.
    """
    rows: list[ResultRow] = []
    taken: list[Float] = []
    faults: list[str] = []
    for where, ids, score, T in given:
        try:
            rows.append(_row(where, ids, score, T))
            taken.append(np.reshape(T, (4, 4))[:3, :3])
        except ValueError as error:
            faults.append(str(error))
    if not rows:
        raise ContentError(next(iter(faults), without))
    return Estimates(tuple(rows), unusable("pose", path.name, faults), rounding_note(path.name, taken))


def _row(where: str, ids: Sequence[int | None], score: float, T: Any) -> ResultRow:
    scene_id, im_id, obj_id = ids
    if scene_id is None or im_id is None or obj_id is None:
        raise ContentError(f"{where}: expected the numbers of scene, image and object")
    if not math.isfinite(score):
        raise ContentError(f"{where}: its score is NaN or infinite")
    try:
        pose = array_of(Numbers4x4, T)
    except ValueError as error:
        raise ContentError(f"{where}: {error}") from None
    return ResultRow(scene_id, im_id, obj_id, score, as_rigid(pose, f"{where}: the pose"))


def _column(arrays: Mapping[str, NDArray[Any]], names: tuple[str, ...]) -> Float:
    name = next((name for name in names if name in arrays), None)
    if name is None:
        raise ContentError(f"it has no array {names[0]!r}, only {', '.join(sorted(arrays)[:20])}")
    return plain_array(arrays[name], np.float64).ravel()


def _poses(arrays: Mapping[str, NDArray[Any]]) -> Float:
    """The poses (N, 4, 4) [m]."""
    if "poses" in arrays:
        given = plain_array(arrays["poses"], np.float64)
        if given.ndim != 3 or given.shape[1:] not in ((4, 4), (3, 4)):
            raise ContentError(f"'poses' is {given.shape}, expected (N, 4, 4) or (N, 3, 4)")
        poses = np.tile(np.eye(4), (len(given), 1, 1))
        poses[:, : given.shape[1]] = given
        away = np.linalg.norm(poses[:, :3, 3], axis=1)
        away = away[np.isfinite(away)]
        median = float(np.median(away)) if len(away) else 0.0
        poses[:, :3, 3] *= 1e-3 if median > FARTHEST_IN_METRES else 1.0
        return poses
    if not {"R", "t"} <= {*arrays}:
        raise ContentError(f"it has neither 'poses' nor 'R' and 't', only {', '.join(sorted(arrays)[:20])}")
    R, t_mm = (plain_array(arrays[name], np.float64) for name in ("R", "t"))
    if R.shape != (len(R), 3, 3) or t_mm.size != 3 * len(R):
        raise ContentError(f"'R' is {R.shape} and 't' {t_mm.shape}, expected (N, 3, 3) and (N, 3) [mm]")
    pairs = zip(R, t_mm.reshape(-1, 3), strict=True)
    return np.stack([transform(one, position * 1e-3) for one, position in pairs]) if len(R) else np.zeros((0, 4, 4))
