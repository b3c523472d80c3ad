"""The journal of a batch: a small file per finished frame, so that neither a kill nor the number of frames matters.

Results live on the disk and not in memory; to use them all, read them one after the other. A study has a journal of the
same form. Beside it ``run.json``: which version and machine made a batch, how far it came, and what it came to.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Annotated, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from verefine_viz.batch.rows import FrameResult, file_stem
from verefine_viz.core.errors import InputError, first_fault
from verefine_viz.core.paths import atomic, read_input

Entry = TypeVar("Entry", bound=BaseModel)


def save_entry(file: Path, entry: BaseModel) -> None:
    """Writes an entry of a journal as JSON, whole or not at all.

    Raises:
        InputError: the disk refuses.
    """
    with atomic(file) as part:
        part.write_text(entry.model_dump_json(), encoding="utf-8")


def read_entry(file: Path, kind: type[Entry]) -> Entry | None:
    """An entry of a journal; None where there is none.

    Raises:
        InputError: it is damaged; the text says how.
    """
    if not file.exists():
        return None
    try:
        return kind.model_validate_json(read_input(file))
    except ValidationError as error:
        raise InputError(f"{file} is damaged: {first_fault(error)}") from None


class Journal:
    """The folder ``frames/`` of a batch."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def save(self, result: FrameResult) -> None:
        """Notes a finished frame, solved or failed; from now on a restart does not repeat it.

        Raises:
            InputError: the disk refuses.
        """
        save_entry(self._file(result.frame), result)

    def forget(self, frame: str) -> None:
        """Has a restart solve a frame again."""
        self._file(frame).unlink(missing_ok=True)

    def entry(self, frame: str) -> FrameResult | None:
        """The result of a frame; None where it is not finished.

        Raises:
            InputError: the entry is damaged; the text says how.
        """
        file = self._file(frame)
        result = read_entry(file, FrameResult)
        if result is not None and result.frame != frame:
            raise InputError(f"{file} is damaged: it is about frame {result.frame}")
        if result is not None and not result.objects:
            raise InputError(f"{file} is damaged: it holds no object")
        return result

    def read(self, frame: str) -> FrameResult | None:
        """The result of a frame; None where it is not finished, or its entry is damaged."""
        with suppress(InputError):
            return self.entry(frame)
        return None

    def results(self, frames: Iterable[str]) -> Iterator[FrameResult]:
        """The results of ``frames``, in their order, one at a time; frames that are not finished are skipped."""
        for frame in frames:
            result = self.read(frame)
            if result is not None:
                yield result

    def _file(self, frame: str) -> Path:
        return self.folder / f"{file_stem(frame)}.json"


RUN_FILE = "run.json"
Number = Annotated[int, Field(ge=0)]
Positive = Annotated[float, Field(ge=0)]


class _Lenient(BaseModel):
    # A file of another version may have other fields; which version wrote it is checked where that matters.
    model_config = ConfigDict(frozen=True, extra="ignore", strict=True, allow_inf_nan=False)


class RunTotals(_Lenient):
    """What the frames came to. None = unknown: the batch runs, or was killed."""

    frames: Number | None = None
    """Of the session."""
    frames_done: Number | None = None
    frames_failed: Number | None = None
    objects: Number | None = None
    """All that are known of, also those of failed frames."""
    answers_with_truth: Number | None = None
    objects_without_answer: Number | None = None
    objects_left_out: Number | None = None
    objects_unreadable: Number | None = None
    objects_in_failed_frames: Number | None = None
    objects_with_truth: Number | None = None
    objects_correct: Number | None = None
    recall: float | None = None
    causes: dict[str, Number] = {}
    data_in_doubt: str = ""
    notes: dict[str, Number] = {}
    median_score: float | None = None
    median_add_s_mm: float | None = None
    median_ms_per_object: float | None = None
    mean_stages_ms_per_frame: dict[str, float] = {}


class RunFile(_Lenient):
    """The content of run.json."""

    version: str = ""
    """Of verefine-viz; empty = unknown."""
    status: str = "unknown"
    """running (or killed), stopped, incomplete (frames were lost while it ran), finished."""
    title: str = ""
    begun: str = ""
    """When the last start began, as in 2026-01-02T03:04:05+00:00."""
    seconds: Positive = 0.0
    """Of all starts together [s]."""
    totals: RunTotals = RunTotals()
    workers: Number | None = None
    cluster: str = ""
    memory: str = ""
    """What it took, in words."""
    machine: dict[str, str | int] = {}
    packages: dict[str, str] = {}
    weights: dict[str, str] = {}
    """Hashes of the learned refiner's weights."""


def read_run(folder: Path) -> RunFile:
    """The run.json of a batch folder; everything is unknown where there is none.

    Raises:
        InputError: it is not what a batch writes.
    """
    file = folder / RUN_FILE
    if not file.exists():
        return RunFile()
    try:
        return RunFile.model_validate_json(read_input(file))
    except ValidationError as error:
        raise InputError(
            f"{file} cannot be read: {first_fault(error)}; it is not what a batch writes: delete it, and the same "
            "batch command writes it again"
        ) from None
