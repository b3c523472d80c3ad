"""Estimated poses in files of other formats than BOP's CSV: arrays (.npz), and YAML as FoundationPose writes it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.array_cache import NPZ_READING
from verefine_viz.core.arrays import Float, plain_array
from verefine_viz.core.errors import ContentError, InputError
from verefine_viz.core.files import Numbers4x4, id_of, read_yaml, reading
from verefine_viz.core.geometry import as_rigid, transform
from verefine_viz.scenes.results_csv import HEADER, ResultRow, read_results

PICKLED = (".pkl", ".pickle", ".pth", ".pt", ".tar")
IDS = (("scene_id",), ("im_id", "image_id", "view_id"), ("obj_id", "object_id", "category_id"))
FARTHEST_IN_METRES = 20.0
"""Poses whose median distance is larger are in millimetres."""
MOST_ROWS, MOST_BYTES = 500_000, 1_000_000_000


def read_estimates(path: Path | str) -> tuple[ResultRow, ...]:
    """All estimates of a results file: BOP's CSV, .npz or .yml.

    Raises:
        InputError: it is missing, pickled or damaged, or holds no poses; what was expected is named.
    """
    path = Path(path)
    if path.suffix in PICKLED:
        raise InputError(f"{path} is pickled, and reading it could run code; write its poses as a CSV: {HEADER}")
    if path.suffix in (".yml", ".yaml"):
        return _rows_of_yaml(path)
    return _rows_of_arrays(path) if path.suffix == ".npz" else read_results(path)


def _rows_of_yaml(path: Path) -> tuple[ResultRow, ...]:
    """Scene, image and object above each other, with poses (4, 4) in metres and no scores."""
    rows: list[ResultRow] = []
    with reading(path):
        for scene, images in read_yaml(path, dict[str | int, dict[str | int, dict[str | int, Numbers4x4]]]).items():
            for image, objects in images.items():
                for name, T in objects.items():
                    ids = [id_of(str(key)) for key in (scene, image, name)]
                    if None in ids:
                        raise ContentError(f"{scene}, {image}, {name}: expected the numbers of scene, image and object")
                    scene_id, im_id, obj_id = (number or 0 for number in ids)
                    pose = as_rigid(T, f"the pose of {scene}, {image}, {name}")
                    rows.append(ResultRow(scene_id, im_id, obj_id, 1.0, pose))
        if not rows:
            raise ContentError("no poses, expected {scene: {image: {object: 4×4 [m]}}}")
    return tuple(rows)


def _rows_of_arrays(path: Path) -> tuple[ResultRow, ...]:
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
        if not np.isfinite(scores).all() or not all(np.isfinite(column).all() for column in ids):
            raise ContentError("a score or an id is NaN or infinite")
        for names, column in zip(IDS, ids, strict=True):
            broken = np.flatnonzero(column != np.round(column))
            if len(broken):
                raise ContentError(
                    f"{names[0]} of entry {broken[0]} is {column[broken[0]]:g}, expected the numbers of scene, image "
                    "and object"
                )
        checked = [as_rigid(T, f"entry {k}: the pose") for k, T in enumerate(poses)]
        columns = (*(column.astype(np.int64).tolist() for column in ids), scores.tolist(), checked)
        return tuple(ResultRow(*row) for row in zip(*columns, strict=True))


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
        median = float(np.median(np.linalg.norm(poses[:, :3, 3], axis=1))) if len(poses) else 0.0
        poses[:, :3, 3] *= 1e-3 if median > FARTHEST_IN_METRES else 1.0
        return poses
    if not {"R", "t"} <= {*arrays}:
        raise ContentError(f"it has neither 'poses' nor 'R' and 't', only {', '.join(sorted(arrays)[:20])}")
    R, t_mm = (plain_array(arrays[name], np.float64) for name in ("R", "t"))
    if R.shape != (len(R), 3, 3) or t_mm.size != 3 * len(R):
        raise ContentError(f"'R' is {R.shape} and 't' {t_mm.shape}, expected (N, 3, 3) and (N, 3) [mm]")
    pairs = zip(R, t_mm.reshape(-1, 3), strict=True)
    return np.stack([transform(one, position * 1e-3) for one, position in pairs]) if len(R) else np.zeros((0, 4, 4))
