"""What a batch says about a frame and its objects: a row of frames.csv each, and the poses for results.csv."""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator, model_validator

from verefine_viz.core.errors import InputError, ShapeError, first_fault
from verefine_viz.core.geometry import as_rigid
from verefine_viz.core.paths import atomic, open_input
from verefine_viz.core.problem import LeftOut
from verefine_viz.core.settings import Session
from verefine_viz.diagnosis.causes import DATA_FIRST
from verefine_viz.scenes.frames import parse_frame

Status = Literal["ok", "no_answer", "left_out", "failed"]
WAITING = "not solved yet"
"""The message of a row for a frame that has only just arrived in a watched folder; no table has such rows."""


class Row(BaseModel):
    """Base of the records below: immutable, of finite numbers, and the same after a round trip through JSON."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class ObjectRow(Row):
    """One object of a frame, as frames.csv has it. Empty = unknown or not applicable. See also ``docs/tables.md``.

    A frame that failed has a row for each object that ground truth names; without ground truth, one row without an
    object.
    """

    scene_id: int
    im_id: int
    instance_id: int | None = None
    obj_id: int | None = None
    name: str = ""
    method: str = ""
    seed: int | None = None
    """Of the initial poses (hypotheses.seed)."""
    visib_fract: float | None = None
    """Visible share of the object, where the data set knows it."""
    has_truth: bool = False
    """Whether the data set has its ground truth; such an object counts for the recall, also without an answer."""
    status: Status
    """ok; no_answer: the object has no hypothesis; left_out: its mask or its model is missing or damaged; failed: the
    whole frame is. ``message`` says why."""
    score: float | None = None
    """Of the answer."""
    initial_score: float | None = None
    """Best of the hypotheses."""
    colour_fit: float | None = None
    """f_c of the answer in [−1, 1]; empty where colour does not count."""
    recorded_score: float | None = None
    """Of the answer, by the program whose steps were recorded, in its own units."""
    missing_depth: float | None = None
    """Share of the object's mask without depth."""
    add_s_mm: float | None = None
    """ADD, or ADD-S for symmetric objects, of the answer against ground truth."""
    initial_add_s_mm: float | None = None
    """The same for the hypothesis with the best initial score."""
    rotation_deg: float | None = None
    translation_mm: float | None = None
    diameter_mm: float | None = None
    best_hypothesis: int | None = None
    """Number of the hypothesis that the answer comes from, from 1."""
    best_iteration: int | None = None
    """0 = the answer is an initial pose."""
    worst_iteration: int | None = None
    """The iteration that took this object furthest from its goal: by more than 3 % of the diameter, or by more than
    0.01 of the score where there is no ground truth. Empty where none took it so far."""
    undetermined_mm: float | None = None
    """The furthest shift of the answer, along an axis of the table or the model, by which the score falls no more than
    noise of the depth image explains."""
    undetermined_deg: float | None = None
    """The same for a turn; 180 about an axis of symmetry."""
    n_hypotheses: int = 0
    n_iterations: int = 0
    grasp: str = ""
    """How a simulated grasp by the answer ends (``grasping/grasp_trial.py``); empty where none was tried."""
    grasp_ground_truth: str = ""
    """The same by the ground-truth pose."""
    events: str = ""
    """Kinds and how often: ``arm_switched 4; score_fell 1``."""
    ms_refine: float = 0.0
    ms_simulate: float = 0.0
    ms_score: float = 0.0
    ms_total: float = 0.0
    cause: str = ""
    """Why the answer is wrong, where that is known."""
    evidence: str = ""
    """The cause in one sentence, with its numbers."""
    message: str = ""

    @property
    def frame(self) -> str:
        """``scene/image``."""
        return f"{self.scene_id}/{self.im_id}"

    @property
    def is_object(self) -> bool:
        """Whether it is about an object; False of a failed frame whose objects are unknown."""
        return self.status != "failed" or self.obj_id is not None

    @property
    def is_waiting(self) -> bool:
        """Whether it stands for a frame that is still to be solved."""
        return self.message == WAITING

    @property
    def can_be_right(self) -> bool:
        """Whether there is ground truth to compare an answer with; without an answer it is missed."""
        return self.has_truth or self.add_s_mm is not None

    @property
    def was_asked_for(self) -> bool:
        """Whether the method got it to solve: neither was it left out nor did its frame fail."""
        return self.status in ("ok", "no_answer")

    @property
    def doubt(self) -> str:
        """What of its frame's data does not fit together, as far as that was checked; else empty."""
        return self.evidence.partition(DATA_FIRST)[2].strip()

    @property
    def relative_error(self) -> float | None:
        """ADD(-S) of the answer as a share of the diameter; None where there is no answer or no ground truth."""
        if self.add_s_mm is None or not self.diameter_mm:
            return None
        return self.add_s_mm / self.diameter_mm

    @property
    def is_correct(self) -> bool | None:
        """ADD(-S) below 10 % of the diameter; None without ground truth."""
        if self.add_s_mm is None or self.diameter_mm is None:
            return None
        return self.add_s_mm < 0.1 * self.diameter_mm


TIME_COLUMNS = ("ms_refine", "ms_simulate", "ms_score", "ms_total")
"""Columns of frames.csv that differ from run to run; everything else is the same for the same session."""
STAGES = ("read", "prepare", "start", "iterate", "grasp", "record", "summarise", "explain")
"""What a frame's time goes to: images and clouds; models, most of it at the first frame that shows them; first scores;
iterations; grasps; recording; errors and rows; causes."""
SOLVING = ("start", "iterate")
"""The stages that are the method's own."""


class Estimate(Row):
    """One answer, as results.csv has it."""

    obj_id: int
    score: float
    T_cam_obj: Annotated[tuple[float, ...], Field(min_length=16, max_length=16)]
    """A rigid pose, row by row [m]."""
    instance_id: int | None = None
    middle_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """The middle of the object's bounding box, in its own frame [m]."""

    @field_validator("T_cam_obj")
    @classmethod
    def _is_rigid(cls, T_cam_obj: tuple[float, ...]) -> tuple[float, ...]:
        try:
            as_rigid(np.reshape(T_cam_obj, (4, 4)), "the pose")
        except ShapeError as error:
            raise ValueError(str(error)) from None
        return T_cam_obj


class FrameResult(Row):
    """All that is known about a finished frame."""

    frame: str
    """"scene/image"."""
    failed: bool
    seconds: float
    """All the time it took, from reading the frame to its last record [s]."""
    objects: tuple[ObjectRow, ...]
    estimates: tuple[Estimate, ...] = ()
    notes: tuple[str, ...] = ()
    """What to know about the frame's data: objects left out, unknown names in a given order, …"""
    doubts: tuple[str, ...] = ()
    """What of the frame's data does not fit together, with what to check: cam_K, depth, models, the plane."""
    n_unreadable: int = 0
    """Objects that were left out as their model or mask is missing or damaged."""
    stages_ms: dict[str, float] = {}
    """Where the time went, by stage (:data:`STAGES`) [ms]."""
    T_map_cam: tuple[float, ...] | None = None
    """Camera to the data set's world, row by row [m]; None where the data set does not know it."""
    T_table_cam: tuple[float, ...] | None = None
    """Camera to a frame on the support plane, z up, row by row [m]; None where no plane was detected."""

    @model_validator(mode="after")
    def _says_why_it_failed(self) -> Self:
        if self.failed and not self.objects:
            raise ValueError("a failed frame has a row that says why, and this one has none")
        return self

    @property
    def is_failure(self) -> bool:
        """Whether an object has no answer, or an ADD(-S) not below 10 % of the diameter."""
        return any(row.status != "ok" or row.is_correct is False for row in self.objects)

    @property
    def can_be_mended(self) -> bool:
        """Whether another try may solve more, once files are as they should be."""
        return self.failed or self.n_unreadable > 0

    @property
    def solving_s(self) -> float:
        """Time for first scores and iterations alone, as results.csv has it [s].

        Reading, recording and explaining are no part of the method. The whole time where stages are unknown.
        """
        parts = [self.stages_ms[name] for name in SOLVING if name in self.stages_ms]
        return 1e-3 * sum(parts) if parts else self.seconds


def file_stem(frame: str) -> str:
    """The name of a frame's files without its ending: 000050_000001 of "50/1"."""
    scene_id, im_id = parse_frame(frame)
    return f"{scene_id:06d}_{im_id:06d}"


def failed_frame(frame: str, message: str, session: Session | None = None) -> FrameResult:
    """The result of a frame that could not be solved."""
    scene_id, im_id = parse_frame(frame)
    made_by = {} if session is None else {"method": session.method.name, "seed": session.hypotheses.seed}
    row = ObjectRow(scene_id=scene_id, im_id=im_id, status="failed", message=" ".join(message.split()), **made_by)
    return FrameResult(frame=frame, failed=True, seconds=0.0, objects=(row,))


def with_objects(result: FrameResult, left_out: Sequence[LeftOut]) -> FrameResult:
    """A failed frame with a row for each object that is in it; unchanged where none is known."""
    (row, *_) = result.objects
    rows = tuple(row.model_copy(update=left_out_facts(one)) for one in left_out)
    return result.model_copy(update={"objects": rows}) if rows else result


def left_out_facts(one: LeftOut) -> dict[str, Any]:
    """The columns that say which object it is."""
    facts = {"instance_id": one.instance_id, "obj_id": one.obj_id, "name": one.name}
    return {**facts, "visib_fract": one.visib_fract, "has_truth": one.has_truth}


FRAMES_HEADER = ",".join(ObjectRow.model_fields) + "\n"
"""The first line of frames.csv."""


def frames_lines(result: FrameResult) -> str:
    """The lines of frames.csv about a frame."""
    text = io.StringIO(newline="")
    rows = ([shown_cell(k, v) for k, v in row.model_dump().items()] for row in result.objects)
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue()


def write_frames_csv(path: Path, results: Iterable[FrameResult]) -> None:
    """Writes frames.csv, row by row; it appears under its name only when it is whole.

    Raises:
        InputError: the file cannot be written.
    """
    with atomic(path) as part, part.open("w", encoding="utf-8", newline="") as file:
        file.write(FRAMES_HEADER)
        file.writelines(map(frames_lines, results))


def read_frames_csv(path: Path) -> list[ObjectRow]:
    """The rows of frames.csv as it was written.

    Raises:
        InputError: the file is missing, or has other columns or values; the line and the reason are named.
    """
    with open_input(path) as opened, io.TextIOWrapper(opened, "utf-8", newline="") as file:
        if opened.seek(0, os.SEEK_END):
            opened.seek(-1, os.SEEK_END)
            if opened.read(1) != b"\n":
                raise InputError(
                    f"{path} is not what a batch writes: its end is missing; the same batch command writes it again"
                )
            opened.seek(0)
        reader = csv.DictReader(file)
        try:
            columns = reader.fieldnames or ()
            if not columns:
                raise ValueError("the file is empty")
            if odd := sorted({*columns} ^ {*ObjectRow.model_fields}):
                raise InputError(
                    f"{path} is not what a batch writes: another version wrote it (its columns differ: "
                    f"{', '.join(odd)}); run the session again with this one"
                )
            return [_object_row(row) for row in reader]
        except ValidationError as error:
            why = first_fault(error)
        except (ValueError, csv.Error) as error:  # No text, a cell that is too long, or fewer cells than columns.
            why = str(error)
        raise InputError(
            f"{path} is not what a batch writes: line {reader.line_num}: {why}; the same batch command writes it again"
        )


def _object_row(cells: dict[str, Any]) -> ObjectRow:
    if None in cells or None in cells.values():
        raise ValueError(f"it does not have {len(ObjectRow.model_fields)} cells")
    return ObjectRow.model_validate({k: v for k, v in cells.items() if v != ""}, strict=False)


EXACT = ("score", "initial_score", "recorded_score")
"""Columns with all digits, as they are compared; more digits of a millimetre or a millisecond are noise."""


def shown_cell(name: str, value: object) -> object:
    """A value as a table has it in column ``name``."""
    if value is None:
        return ""
    return f"{value:.3f}" if isinstance(value, float) and name not in EXACT else value
