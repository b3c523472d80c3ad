"""The estimates of one method as columns, and which part of the targets they are about."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Literal

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import RIGID_TOLERANCE, ROUNDED, rotation_faults
from verefine_viz.core.text_format import unusable
from verefine_viz.evaluation.ground_truth import Targets
from verefine_viz.scenes.results_csv import ResultRow, method_of, read_lines

Image = tuple[int, int]
"""(scene_id, im_id)."""


@dataclass(frozen=True, eq=False)
class PoseTable:
    """N estimates in the order of their file; poses are used as they are written, also where R is no exact rotation."""

    name: str
    """The method's."""
    ids: tuple[tuple[int, int, int], ...]
    """(scene_id, im_id, obj_id) of each."""
    scores: Float
    """(N,)."""
    R: Float
    """(N, 3, 3)."""
    t_mm: Float
    """(N, 3) [mm]."""
    time_s: Float
    """(N,) seconds for the whole image; negative = unknown."""
    notes: tuple[str, ...] = ()
    """Notes on lines of its file that are left out."""

    def __len__(self) -> int:
        return len(self.ids)

    @cached_property
    def by_image(self) -> Mapping[Image, Mapping[int, Sequence[int]]]:
        """Rows of each image and object, in the order of the file."""
        rows: dict[Image, dict[int, list[int]]] = {}
        for row, (scene_id, im_id, obj_id) in enumerate(self.ids):
            rows.setdefault((scene_id, im_id), {}).setdefault(obj_id, []).append(row)
        return rows

    @property
    def mean_time_s(self) -> float:
        """Mean time of the images that occur [s]; -1 as soon as one time is negative, as the toolkit has it."""
        if not len(self) or (self.time_s < 0).any():
            return -1.0
        first: dict[Image, float] = {}
        for (scene_id, im_id, _), seconds in zip(self.ids, self.time_s, strict=True):
            first.setdefault((scene_id, im_id), float(seconds))
        return float(np.mean(list(first.values())))

    def best_first(self, rows: Iterable[int]) -> list[int]:
        """Rows by descending score; equal ones keep their order."""
        return sorted(rows, key=lambda row: self.scores[row], reverse=True)


def read_pose_table(path: Path | str) -> PoseTable:
    """A results file as the official toolkit reads it; lines for which its format check refuses the file are noted and
    left out.

    Raises:
        InputError: no line can be used; the first line and the reason are named.
    """
    path = Path(path)
    read = read_lines(path)
    lines, faults = read.lines, [read.faults[number] for number in sorted(read.faults)]
    notes = (*unusable("row", path.name, faults), *read.time_notes(path))
    return PoseTable(
        method_of(path),
        tuple((line.scene_id, line.im_id, line.obj_id) for line in lines),
        np.array([line.score for line in lines]),
        np.stack([line.R for line in lines]),
        np.stack([line.t_mm for line in lines]),
        np.array([line.time_s for line in lines]),
        tuple(f"{note}; the official toolkit refuses such a file" for note in notes),
    )


def pose_table(name: str, rows: Sequence[ResultRow]) -> PoseTable:
    """Estimates that are in memory, such as a batch's own answers; there may be none."""
    Ts_cam_obj = np.array([row.T_cam_obj for row in rows]).reshape(-1, 4, 4)
    return PoseTable(
        name,
        tuple((row.scene_id, row.im_id, row.obj_id) for row in rows),
        np.array([row.score for row in rows], dtype=np.float64),
        np.ascontiguousarray(Ts_cam_obj[:, :3, :3]),
        Ts_cam_obj[:, :3, 3] * 1e3,
        np.array([row.time_s for row in rows], dtype=np.float64),
    )


@dataclass(frozen=True)
class Coverage:
    """Targets that a results file names at all, however wrong its poses."""

    images: int
    """Images of the targets with at least one estimate (localization: of an object that is asked for there)."""
    images_asked: int
    objects: int
    """Objects of the targets with at least one estimate in an image where they are asked for; detection: 0."""
    objects_asked: int
    not_finite: int
    """Rows with NaN or infinity in the pose: accepted by the official check, never right."""
    not_ranked: int
    """Rows whose score is NaN: accepted by the official check, but which of several rows comes first is unknown."""
    rounded: int
    """Rows whose R is a rounded rotation: errors are measured with R as it is."""
    not_rigid: int
    """Rows whose R is no rotation: accepted by the official check, errors are measured with R as it is."""

    @property
    def is_complete(self) -> bool:
        """Whether every image and every object has an estimate."""
        return self.images == self.images_asked and self.objects == self.objects_asked


@dataclass(frozen=True)
class Covered:
    """Images and objects of the run that wrote a results file, according to its folder."""

    images: frozenset[Image]
    objects: frozenset[int] | None = None
    """BOP ids of the objects that it was to solve; None = all."""


@dataclass(frozen=True)
class OwnPart:
    """The part of the targets that a results file is about, where this is not all of them."""

    images: frozenset[Image]
    known_from: Literal["run", "file"]
    """run: by the folder of the batch that wrote the file. file: by its estimates alone, so that an image without
    one may also be one for which there was no answer."""
    objects: frozenset[int] | None = None
    """Objects that count; None = all of these images."""

    def holds(self, image: Image, obj_id: int) -> bool:
        """Whether an object of an image belongs to it."""
        return image in self.images and (self.objects is None or obj_id in self.objects)


def coverage(table: PoseTable, targets: Targets) -> Coverage:
    """How much of ``targets`` a table has estimates for."""
    images, objects = 0, set[int]()
    for image, asked in targets.counts.items():
        there = table.by_image.get(image, {})
        estimated = asked.keys() & there.keys()
        images += bool(estimated) if targets.task == "localization" else bool(there)
        objects |= estimated
    finite = (np.abs(table.R) < 1e100).all(axis=(1, 2)) & (np.abs(table.t_mm) < 1e100).all(axis=1)
    off = rotation_faults(table.R[finite])
    return Coverage(
        images,
        len(targets.counts),
        len(objects),
        len({obj_id for asked in targets.counts.values() for obj_id in asked}),
        int((~finite).sum()),
        int(np.isnan(table.scores).sum()),
        int(((off >= ROUNDED) & (off <= RIGID_TOLERANCE)).sum()),
        int((off > RIGID_TOLERANCE).sum()),
    )


def own_part(table: PoseTable, targets: Targets, covered: Covered | None) -> OwnPart | None:
    """The part of ``targets`` that ``table`` is about; None where this is all of them, or nothing.

    Args:
        table: the estimates.
        targets: what is asked for.
        covered: what the run covered; None = unknown.
    """
    images = frozenset(targets.counts.keys() & (table.by_image.keys() if covered is None else covered.images))
    objects = None if covered is None else covered.objects
    asked = {obj_id for image in images for obj_id in targets.counts[image]}
    if objects is not None and asked:
        objects = None if asked <= objects else objects & asked
    if not images or objects == frozenset() or (len(images) == len(targets.counts) and objects is None):
        return None
    return OwnPart(images, "file" if covered is None else "run", objects)


def missing_reason(table: PoseTable, targets: Targets) -> str:
    """Words for a table that has nothing that is asked for: by its scenes, its images, or its objects."""
    mine, asked = ({scene_id for scene_id, _ in images} for images in (table.by_image, targets.counts))
    if not mine & asked:
        return f"it names {_listed('scene', mine)}, the targets {_listed('scene', asked)}"
    both = mine & asked
    mine, asked = ({im_id for s, im_id in images if s in both} for images in (table.by_image, targets.counts))
    common = table.by_image.keys() & targets.counts.keys()
    if not common:
        return f"in {_listed('scene', both)} it names {_listed('image', mine)}, the targets {_listed('image', asked)}"
    mine, asked = ({i for image in common for i in rows[image]} for rows in (table.by_image, targets.counts))
    return f"in images asked for it names {_listed('object', mine)}, the targets {_listed('object', asked)}"


def _listed(word: str, ids: Collection[int], most: int = 5) -> str:
    """``scenes 48, 49, 50, 51, 52, …``."""
    first = [*map(str, sorted(ids)[:most]), *(["…"] if len(ids) > most else [])]
    return f"{word}{'s' * (len(ids) > 1)} {', '.join(first)}"
