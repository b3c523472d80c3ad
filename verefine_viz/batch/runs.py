"""The runs of a batch: a run file per frame, so that neither a kill nor the number of frames matters.

Results live on the disk and not in memory; to use them all, read them one after the other. Beside them ``run.json``
says which version and machine made a batch, how far it got, and its totals.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from contextlib import closing, suppress
from pathlib import Path
from typing import Annotated

import msgspec
from msgspec import Meta

from verefine_viz.core.errors import InputError
from verefine_viz.core.files import read_json
from verefine_viz.core.frame_names import frame_name, parse_frame
from verefine_viz.core.number_kinds import Real
from verefine_viz.core.settings import Session
from verefine_viz.run.record import RunRecord
from verefine_viz.run.run_file import SUFFIX, RunFile, read_run_file


class Runs:
    """The folder ``runs/`` of a batch: a run file per frame. A frame is finished when its file holds the answers."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def path(self, frame: str) -> Path:
        """The run file of a frame."""
        return self.folder / f"{file_stem(frame)}{SUFFIX}"

    @property
    def frames(self) -> tuple[str, ...]:
        """The frames that have a file, by their numbers; files of other names are not the batch's."""
        stems = (re.fullmatch(r"(\d+)_(\d+)", path.stem) for path in self.folder.glob(f"*{SUFFIX}"))
        return tuple(map(frame_name, sorted((int(stem[1]), int(stem[2])) for stem in stems if stem)))

    def save(self, session: Session, record: RunRecord) -> None:
        """Write a finished record that has no iterations, such as that of a frame that failed.

        Raises:
            InputError: the disk refuses.
        """
        assert record.end is not None
        with closing(RunFile(self.path(record.header.frame), session)) as file:
            file.begin(record.header)
            file.finish(record.end)

    def forget(self, frame: str) -> None:
        """Delete the run file of a frame, so that a restart solves the frame again."""
        self.path(frame).unlink(missing_ok=True)

    def entry(self, frame: str) -> RunRecord | None:
        """The record of a finished frame, without its iterations; None where the frame is not finished.

        Raises:
            InputError: its file is damaged; the text says how.
        """
        path = self.path(frame)
        if not path.exists():
            return None
        record = read_run_file(path, with_iterations=False)
        if record.header.frame != frame:
            raise InputError(f"{path} is damaged: it is about frame {record.header.frame}")
        if record.damaged:
            raise InputError(f"{path} is damaged: {record.missing}")
        return None if record.end is None or not record.end.answers else record

    def read(self, frame: str) -> RunRecord | None:
        """The record of a finished frame; None where the frame is not finished, or its file is damaged."""
        with suppress(InputError):
            return self.entry(frame)
        return None

    def records(self, frames: Iterable[str]) -> Iterator[RunRecord]:
        """The records of ``frames``, in their order, one at a time; frames that are not finished are skipped."""
        for frame in frames:
            record = self.read(frame)
            if record is not None:
                yield record


def file_stem(frame: str) -> str:
    """The name of a frame's files without its ending: 000050_000001 of "50/1"."""
    scene_id, im_id = parse_frame(frame)
    return f"{scene_id:06d}_{im_id:06d}"


RUN_FILE = "run.json"
Number = Annotated[int, Meta(ge=0, le=2**53)]
Positive = Annotated[float, Meta(ge=0, le=1e300)]


class RunTotals(msgspec.Struct, frozen=True, omit_defaults=True):
    """Totals of a batch's frames. None = unknown: the batch is running, or was killed."""

    frames: Number | None = None
    """Number of frames of the session."""
    frames_done: Number | None = None
    frames_failed: Number | None = None
    objects: Number | None = None
    """All known objects, those of failed frames included."""
    answers_with_truth: Number | None = None
    objects_without_answer: Number | None = None
    objects_left_out: Number | None = None
    objects_unreadable: Number | None = None
    objects_in_failed_frames: Number | None = None
    objects_with_truth: Number | None = None
    objects_correct: Number | None = None
    recall: Real | None = None
    causes: dict[str, Number] = {}
    data_in_doubt: str = ""
    notes: dict[str, Number] = {}
    median_score: Real | None = None
    median_add_s_mm: Real | None = None
    median_ms_per_object: Real | None = None
    mean_stages_ms_per_frame: dict[str, float] = {}


class BatchInfo(msgspec.Struct, frozen=True, omit_defaults=True):
    """The content of run.json. A file of another version may have other fields."""

    version: str = ""
    """Version of verefine-viz; empty = unknown."""
    status: str = "unknown"
    """running (or killed), stopped, incomplete (frames were lost while it ran), finished."""
    title: str = ""
    begun: str = ""
    """When the last start began, as in 2026-01-02T03:04:05+00:00."""
    seconds: Positive = 0.0
    """Time of all starts together [s]."""
    totals: RunTotals = RunTotals()
    workers: Number | None = None
    cluster: str = ""
    memory: str = ""
    """Memory that workers and parent took, in words."""
    machine: dict[str, str | int] = {}
    packages: dict[str, str] = {}
    weights: dict[str, str] = {}
    """Hashes of the learned refiner's weights."""


def read_run(folder: Path) -> BatchInfo:
    """The run.json of a batch folder; everything is unknown where there is none.

    Raises:
        InputError: it is not what a batch writes.
    """
    file = folder / RUN_FILE
    return read_json(file, BatchInfo) if file.exists() else BatchInfo()
