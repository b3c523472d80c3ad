"""motion.csv of a batch over a sequence: how the pose of each object changes from frame to frame (docs/tables.md)."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import groupby
from pathlib import Path
from typing import Protocol

import msgspec
import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.files import reading
from verefine_viz.core.frame_names import parse_frame
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.number_kinds import Id, Real
from verefine_viz.core.writing import atomic
from verefine_viz.evaluation.pose_motion import (
    NO_SYMMETRY,
    Kind,
    Motion,
    MotionCounts,
    MotionMark,
    PosedFrame,
    Reference,
    counted,
    marks,
    motions,
)
from verefine_viz.run.record import Answer, RunRecord

MOTION = "motion.csv"
NO_TURNS = np.zeros((0, 4, 4))


class Shapes(Protocol):
    """What is known of the objects' shapes; both answer for obj_id and a frame that shows it."""

    def symmetries_of(self, obj_id: int, frame: str) -> Float:
        """(S, 4, 4) the declared symmetries, the identity first."""
        ...

    def turns_of(self, obj_id: int, frame: str) -> Float:
        """(N, 4, 4) turns after which the shape nearly looks the same; working them out may take seconds."""
        ...


@dataclass(frozen=True)
class KnownShapes:
    """The shapes of objects whose models are at hand; others have no symmetry."""

    models: Mapping[int, ObjectModel]
    flips: Callable[[ObjectModel], Float] = lambda model: NO_TURNS

    def symmetries_of(self, obj_id: int, frame: str) -> Float:
        """See :class:`Shapes`."""
        return self.models[obj_id].symmetries if obj_id in self.models else NO_SYMMETRY

    def turns_of(self, obj_id: int, frame: str) -> Float:
        """See :class:`Shapes`."""
        return self.flips(self.models[obj_id]) if obj_id in self.models else NO_TURNS


class MotionRow(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One object in one frame. Empty = unknown."""

    scene_id: Id
    im_id: Id
    track: str
    """The object over the frames of its scene: obj_id, and where a frame has several of it, "obj_id#instance_id"."""
    obj_id: Id
    instance_id: Id | None = None
    name: str
    kind: Kind
    reference: Reference
    moved_mm: Real
    turned_deg: Real
    lifted_mm: Real | None = None
    tilted_deg: Real | None = None
    drift_mm: Real | None = None
    score: Real | None = None
    recorded_score: Real | None = None
    missing_depth: Real | None = None
    undetermined_mm: Real | None = None
    undetermined_deg: Real | None = None

    @property
    def frame(self) -> str:
        """``scene/image``."""
        return f"{self.scene_id}/{self.im_id}"

    @property
    def motion(self) -> Motion:
        """What it says about the motion."""
        return Motion(self.frame, **{name: getattr(self, name) for name in OF_MOTION})


@dataclass(frozen=True)
class MotionTrack:
    """One object over the frames of a scene."""

    rows: tuple[MotionRow, ...]

    @property
    def name(self) -> str:
        return self.rows[0].name

    @property
    def scene_id(self) -> int:
        return self.rows[0].scene_id

    @cached_property
    def counts(self) -> MotionCounts:
        """Flips, jumps, …"""
        return counted([row.motion for row in self.rows])

    @property
    def marks(self) -> tuple[MotionMark, ...]:
        """Flips, jumps, and where it is lost and recovered."""
        return marks([row.kind for row in self.rows])

    def marked(self, kind: Kind) -> tuple[str, ...]:
        """The frames in which it flips, jumps, …"""
        return tuple(row.frame for row in self.rows if row.kind == kind)

    @property
    def text(self) -> str:
        """How it moves, and where it flips."""
        flips = self.marked("flip")
        more = f", and {len(flips) - 3} more" if len(flips) > 3 else ""
        where = f" Flips in {', '.join(flips[:3])}{more}." if flips else ""
        return f"{self.name} in scene {self.scene_id}: {self.counts.text}{where}"


def motion_rows(results: Iterable[RunRecord], shapes: Shapes) -> Iterator[MotionRow]:
    """The rows of some frames, in their order; one scene is in memory at a time.

    Args:
        results: of the frames, those of a scene in order and together; one without an end is not solved yet.
        shapes: of the objects; turns are asked for only where one turns by as much as a flip does.
    """
    for _, of_scene in groupby(results, lambda result: parse_frame(result.header.frame)[0]):
        scene = [*of_scene]
        by_frame: dict[str, list[MotionRow]] = {result.header.frame: [] for result in scene}
        for obj_id, instance_id in _objects(scene):
            for row in _track_rows(scene, obj_id, instance_id, shapes):
                by_frame[row.frame].append(row)
        for rows in by_frame.values():
            yield from rows


def _objects(scene: Sequence[RunRecord]) -> list[tuple[int, int | None]]:
    """The objects of a scene: those that a frame has several of by instance, others by their model alone."""
    several, seen = set[int](), dict[tuple[int, int | None], None]()
    for result in scene:
        ids = [row.obj_id for row in _answers(result)]
        several |= {i for i in ids if i is not None and ids.count(i) > 1}
    for result in scene:
        for row in _answers(result):
            if row.obj_id is not None:
                seen[row.obj_id, row.instance_id if row.obj_id in several else None] = None
    return [*seen]


def _track_rows(
    scene: Sequence[RunRecord], obj_id: int, instance_id: int | None, shapes: Shapes
) -> Iterator[MotionRow]:
    """Rows of one object, from the first frame on that has it."""
    rows: dict[str, Answer] = {}
    poses: list[PosedFrame] = []
    middle_m = np.zeros(3)
    for result in scene:
        row = next((r for r in _answers(result) if r.obj_id == obj_id and instance_id in (None, r.instance_id)), None)
        if row is not None:
            rows[result.header.frame] = row
        if rows:
            T = None if row is None else row.T_cam_obj
            middle_m = middle_m if row is None or row.middle_m is None else row.middle_m
            header = result.header
            poses.append(PosedFrame(header.frame, T, header.T_map_cam, header.T_table_cam, result.end is not None))
    first = next(iter(rows))
    symmetries = shapes.symmetries_of(obj_id, first)
    changes = motions(poses, middle_m, NO_TURNS, symmetries)
    if any(motion.kind == "jump" for motion in changes):
        changes = motions(poses, middle_m, shapes.turns_of(obj_id, first), symmetries)
    name = next(iter(rows.values())).name
    for motion in changes:
        (scene_id, im_id), row = parse_frame(motion.frame), rows.get(motion.frame)
        yield MotionRow(
            scene_id=scene_id,
            im_id=im_id,
            track=f"{obj_id}" if instance_id is None else f"{obj_id}#{instance_id}",
            obj_id=obj_id,
            instance_id=None if row is None else row.instance_id,
            name=name,
            **{name: getattr(motion, name) for name in OF_MOTION},
            **({} if row is None else {name: getattr(row, name) for name in OF_OBJECT}),
        )


OF_MOTION = tuple(name for name in Motion.__dataclass_fields__ if name != "frame")
OF_OBJECT = ("score", "recorded_score", "missing_depth", "undetermined_mm", "undetermined_deg")
"""Columns that frames.csv has too."""


def write_motion(path: Path, rows: Iterable[MotionRow]) -> None:
    """Writes motion.csv; it appears under its name only when it is whole.

    Raises:
        InputError: the disk refuses.
    """
    with atomic(path) as part, part.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(MotionRow.__struct_fields__)
        writer.writerows([_cell(name, getattr(row, name)) for name in MotionRow.__struct_fields__] for row in rows)


def _cell(name: str, value: object) -> object:
    if value is None:
        return ""
    return f"{value:.3f}" if isinstance(value, float) and name not in ("score", "recorded_score") else value


def _answers(record: RunRecord) -> tuple[Answer, ...]:
    return () if record.end is None else record.end.answers


def read_tracks(folder: Path) -> tuple[MotionTrack, ...]:
    """The objects of a batch's motion.csv, scene by scene; none where the batch has no sequence.

    Raises:
        InputError: it is not what a batch writes.
    """
    path = folder / MOTION
    if not path.is_file():
        return ()
    with reading(path) as file:
        cells = csv.DictReader(file.read().decode("utf-8", "replace").splitlines())
        rows = [msgspec.convert(_filled(row), MotionRow, strict=False) for row in cells]
    return tracks_of(rows)


def tracks_of(rows: Iterable[MotionRow]) -> tuple[MotionTrack, ...]:
    """The objects, scene by scene."""
    tracks: dict[tuple[int, str], list[MotionRow]] = {}
    for row in rows:
        tracks.setdefault((row.scene_id, row.track), []).append(row)
    return tuple(MotionTrack(tuple(rows)) for rows in tracks.values())


def _filled(cells: Mapping[str, str]) -> dict[str, str]:
    return {name: value for name, value in cells.items() if value != ""}
