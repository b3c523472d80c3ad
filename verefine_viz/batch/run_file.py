"""run.json: which version and machine made a batch, how far it came, and what it came to."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from verefine_viz.core.errors import InputError, first_fault
from verefine_viz.core.input_files import read_input

RUN_FILE = "run.json"
Number = Annotated[int, Field(ge=0)]
Positive = Annotated[float, Field(ge=0)]


class _Part(BaseModel):
    # A file of another version may say more; which version wrote it is checked where that matters.
    model_config = ConfigDict(frozen=True, extra="ignore", strict=True, allow_inf_nan=False)


class RunTotals(_Part):
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


class RunFile(_Part):
    """What run.json says."""

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


def read_run(folder: Path) -> RunFile:
    """What the run.json of a batch folder says; nothing is known where there is none.

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
