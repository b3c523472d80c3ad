"""What scene_gt.json, scene_gt_info.json and targets files of a data set in BOP layout hold."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta

from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import InputError, ShapeError, quoted
from verefine_viz.core.files import Numbers3, Numbers3x3, array_of, first_line, read_entries
from verefine_viz.core.geometry import as_rigid, check_reach, transform
from verefine_viz.core.number_kinds import Id

Task = Literal["localization", "detection"]
"""localization: BOP'18 to '23, how many instances there are is known. detection: BOP'24, it is not."""
_YEARS: dict[Task | None, tuple[str, ...]] = {
    "localization": ("19", "18"),
    "detection": ("24", "19"),
    None: ("19", "24", "18"),
}
"""Names of targets files, the preferred one first."""


class TruthEntry(msgspec.Struct, frozen=True):
    """An instance's entry in scene_gt.json, checked by :func:`object_of` and :func:`pose_of`: one may be damaged."""

    obj_id: Any = None
    cam_R_m2c: Any = None
    cam_t_m2c: Any = None
    """[mm]."""

    @property
    def is_without_pose(self) -> bool:
        """Whether it says that the object is there, and not where."""
        return self.cam_R_m2c is None and self.cam_t_m2c is None


class InfoEntry(msgspec.Struct, frozen=True):
    """An instance's entry in scene_gt_info.json."""

    visib_fract: Any = None

    @property
    def share(self) -> float | None:
        """The visible share; None where it is no number."""
        is_number = isinstance(self.visib_fract, int | float) and abs(self.visib_fract) < 1e300
        return float(self.visib_fract) if is_number else None


class TargetEntry(msgspec.Struct, frozen=True):
    """An entry of a targets file; without an object where the task is detection (BOP'24)."""

    scene_id: Id
    im_id: Id
    obj_id: Id | None = None
    inst_count: Annotated[int, Meta(ge=0, le=100_000)] | None = None


@dataclass(frozen=True, eq=False)
class GroundTruth:
    """One entry of scene_gt."""

    gt_id: int
    """Its place in the image's list; second number of the mask files."""
    obj_id: int
    T_cam_obj: Float | None
    """(4, 4) [m]; None where the file gives none, or numbers that are no pose, for the reason ``fault``."""
    visib_fract: float | None
    fault: str = ""


def ground_truth_of(entry: TruthEntry, gt_id: int, visib_fract: float | None, where: str) -> GroundTruth:
    """The ground truth of an entry of scene_gt.json, at its place ``gt_id`` in the image's list.

    Raises:
        InputError: nothing says whose it is.
    """
    obj_id = object_of(entry, where)
    if entry.is_without_pose:
        return GroundTruth(gt_id, obj_id, None, visib_fract)
    try:
        R, t_mm = pose_of(entry, where)
        pose = as_rigid(transform(R, t_mm * 1e-3), f"{where}: the pose")
    except (InputError, ShapeError) as error:
        return GroundTruth(gt_id, obj_id, None, visib_fract, str(error))
    return GroundTruth(gt_id, obj_id, pose, visib_fract)


def object_of(entry: TruthEntry, where: str) -> int:
    """The object that an entry of scene_gt.json is of; InputError where it names none."""
    try:
        return msgspec.convert(entry.obj_id, Id, strict=False)
    except msgspec.ValidationError:
        raise InputError(f"{where}: 'obj_id' is {quoted(entry.obj_id, 40)}, expected the number of an object") from None


def pose_of(entry: TruthEntry, where: str) -> tuple[Float, Float]:
    """R (3, 3) and t (3,) [mm] of an entry of scene_gt.json, with the digits of the file.

    Raises:
        InputError: one of them is missing, has other numbers than it should, or t is out of reach.
    """
    if entry.cam_R_m2c is None or entry.cam_t_m2c is None:
        raise InputError(f"{where} has no 'cam_R_m2c' or no 'cam_t_m2c'")
    R_cam_obj = _numbers(entry.cam_R_m2c, Numbers3x3, f"{where}: 'cam_R_m2c'")
    t_cam_obj_mm = _numbers(entry.cam_t_m2c, Numbers3, f"{where}: 'cam_t_m2c'")
    try:
        check_reach(t_cam_obj_mm * 1e-3, f"{where}: 'cam_t_m2c'")
    except ShapeError as error:
        raise InputError(str(error)) from None
    return R_cam_obj, t_cam_obj_mm


def _numbers(value: Any, kind: Any, where: str) -> Float:
    try:
        return array_of(kind, value)
    except ValueError as error:
        raise InputError(f"{where}: {first_line(error)}") from None


def targets_path(dataset: Path, split: str, task: Task | None = None) -> Path | None:
    """The targets file of a split for a task, by default for localization where there is one; None without any."""
    return next((dataset / name for name in targets_names(split, task) if os.path.lexists(dataset / name)), None)


def targets_names(split: str, task: Task | None) -> list[str]:
    """The names that a split's targets file for a task may have, the preferred one first."""
    return [f"{split.split('_')[0]}_targets_bop{year}.json" for year in _YEARS[task]]


def target_counts(path: Path) -> dict[tuple[int, int], dict[int, int]]:
    """(scene, image) → object → instances of a targets file, in its order; an object listed twice counts as the last.

    Where the first entry names no object (BOP'24), none counts: all inner dictionaries are empty.

    Raises:
        InputError: the file is missing or damaged, or an entry lacks a number; the entry is named.
    """
    counts, faults = usable_targets(path)
    if faults:
        raise InputError(f"{path}: {faults[0]}")
    return counts


def usable_targets(path: Path) -> tuple[dict[tuple[int, int], dict[int, int]], list[str]]:
    """:func:`target_counts` of the entries that can be used, and what is wrong with the others.

    Raises:
        InputError: the file is missing or damaged.
    """
    counts: dict[tuple[int, int], dict[int, int]] = {}
    entries, faults = read_entries(path, TargetEntry)
    for k, entry in entries:
        of_image = counts.setdefault((entry.scene_id, entry.im_id), {})
        if entries[0][1].obj_id is None:
            continue
        if entry.obj_id is None or entry.inst_count is None:
            faults.append(f"entry {k} has no 'obj_id' or no 'inst_count', as the first one has")
        else:
            of_image[entry.obj_id] = entry.inst_count
    return counts, faults
