"""What a batch says about a frame and its objects: a row of frames.csv each, and the poses for results.csv."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable
from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict

Status = Literal["ok", "no_answer", "failed"]


class Row(BaseModel):
    """Base of the records below: immutable, and the same after a round trip through JSON."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class ObjectRow(Row):
    """One object of a frame, as frames.csv has it. Empty = unknown or not applicable."""

    scene_id: int
    im_id: int
    instance_id: int | None = None
    obj_id: int | None = None
    name: str = ""
    status: Status
    """ok; no_answer: the object has no hypothesis; failed: the whole frame failed, ``message`` says why."""
    score: float | None = None
    """Of the answer."""
    initial_score: float | None = None
    """Best of the hypotheses."""
    add_s_mm: float | None = None
    """ADD, or ADD-S for symmetric objects, of the answer against ground truth."""
    initial_add_s_mm: float | None = None
    """The same for the hypothesis with the best initial score."""
    rotation_deg: float | None = None
    translation_mm: float | None = None
    diameter_mm: float | None = None
    best_arm: int | None = None
    """Index of the hypothesis that the answer comes from, from 0."""
    best_iteration: int | None = None
    """0 = the answer is an initial pose."""
    worst_iteration: int | None = None
    """Where this object lost most: error (score where there is no ground truth) before against after."""
    n_hypotheses: int = 0
    n_iterations: int = 0
    events: str = ""
    """Kinds and how often: ``arm_switched 4; score_fell 1``."""
    ms_refine: float = 0.0
    ms_simulate: float = 0.0
    ms_score: float = 0.0
    ms_total: float = 0.0
    message: str = ""

    @property
    def is_correct(self) -> bool | None:
        """ADD(-S) below 10 % of the diameter; None without ground truth."""
        if self.add_s_mm is None or self.diameter_mm is None:
            return None
        return self.add_s_mm < 0.1 * self.diameter_mm


TIME_COLUMNS = ("ms_refine", "ms_simulate", "ms_score", "ms_total")
"""Columns of frames.csv that differ from run to run; everything else is the same for the same session."""


class Estimate(Row):
    """One answer, as results.csv has it."""

    obj_id: int
    score: float
    T_cam_obj: tuple[float, ...]
    """16 numbers, row by row [m]."""


class FrameResult(Row):
    """All that is known about a finished frame."""

    frame: str
    """"scene/image"."""
    failed: bool
    seconds: float
    """Computing time, from reading the frame to its last record [s]."""
    objects: tuple[ObjectRow, ...]
    estimates: tuple[Estimate, ...] = ()


def frame_ids(frame: str) -> tuple[int, int]:
    """(scene_id, im_id) of "50/1"."""
    scene, _, image = frame.partition("/")
    return int(scene), int(image)


def frame_name(frame: str) -> str:
    """The name of a frame's files: 000050_000001."""
    scene_id, im_id = frame_ids(frame)
    return f"{scene_id:06d}_{im_id:06d}"


def failed_frame(frame: str, message: str, seconds: float = 0.0) -> FrameResult:
    """The result of a frame that could not be solved."""
    scene_id, im_id = frame_ids(frame)
    row = ObjectRow(scene_id=scene_id, im_id=im_id, status="failed", message=" ".join(message.split()))
    return FrameResult(frame=frame, failed=True, seconds=seconds, objects=(row,))


def frames_csv(results: Iterable[FrameResult]) -> str:
    """The text of frames.csv."""
    text = io.StringIO()
    writer = csv.DictWriter(text, fieldnames=list(ObjectRow.model_fields), lineterminator="\n")
    writer.writeheader()
    for result in results:
        for row in result.objects:
            writer.writerow({k: _shown(k, v) for k, v in row.model_dump().items()})
    return text.getvalue()


def read_frames_csv(path: Path) -> list[ObjectRow]:
    """The rows of frames.csv as it was written.

    Raises:
        ValueError: the file has other columns or values.
    """
    with path.open(encoding="utf-8", newline="") as file:
        return [
            ObjectRow.model_validate({k: v for k, v in row.items() if v != ""}, strict=False)
            for row in csv.DictReader(file)
        ]


def _shown(name: str, value: object) -> object:
    if value is None:
        return ""
    # 6 digits of a millimetre or a millisecond are noise; scores keep theirs because people compare them.
    return f"{value:.3f}" if isinstance(value, float) and name not in ("score", "initial_score") else value
