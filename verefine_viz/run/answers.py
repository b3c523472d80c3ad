"""The table of answers: its columns, and how they are written."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator
from dataclasses import KW_ONLY, dataclass
from typing import Literal

from verefine_viz.core.frame_names import parse_frame
from verefine_viz.core.problem import LeftOut
from verefine_viz.run.record import Answer, RunEnd, RunRecord, unsolved
from verefine_viz.scenes.results_csv import ResultRow


@dataclass(frozen=True)
class Column:
    """One column of frames.csv. What it says is the docstring of the answer's field or property of its name."""

    name: str
    _: KW_ONLY
    kind: Literal["exact", "time"] = "exact"
    """exact: the same for the same session; time: differs from run to run."""
    digits: int | None = 3
    """After the point; None = all, as such numbers are compared. More digits of a millimetre are noise."""

    def cell(self, answer: Answer) -> object:
        """The value as the table has it; "" where it is unknown."""
        value = getattr(answer, self.name)
        if value is None:
            return ""
        return f"{value:.{self.digits}f}" if isinstance(value, float) and self.digits is not None else value


COLUMNS = (
    Column("scene_id"),
    Column("im_id"),
    Column("instance_id"),
    Column("obj_id"),
    Column("name"),
    Column("method"),
    Column("seed"),
    Column("visib_fract"),
    Column("has_truth"),
    Column("status"),
    Column("score", digits=None),
    Column("initial_score", digits=None),
    Column("colour_fit"),
    Column("plausibility"),
    Column("recorded_score", digits=None),
    Column("missing_depth"),
    Column("add_s_mm"),
    Column("initial_add_s_mm"),
    Column("rotation_deg"),
    Column("translation_mm"),
    Column("diameter_mm"),
    Column("ar", digits=4),
    Column("ar_vsd"),
    Column("ar_mssd"),
    Column("ar_mspd"),
    Column("best_hypothesis"),
    Column("best_iteration"),
    Column("worst_iteration"),
    Column("undetermined_mm"),
    Column("undetermined_deg"),
    Column("n_alike"),
    Column("error_seen_mm"),
    Column("right_seen"),
    Column("n_hypotheses"),
    Column("n_iterations"),
    Column("grasp"),
    Column("grasp_ground_truth"),
    Column("events"),
    Column("ms_refine", kind="time"),
    Column("ms_simulate", kind="time"),
    Column("ms_score", kind="time"),
    Column("ms_total", kind="time"),
    Column("cause"),
    Column("evidence"),
    Column("message"),
)
HEADER = ",".join(column.name for column in COLUMNS) + "\n"
"""The first line of frames.csv."""
STAGES = ("read", "prepare", "compile", "start", "iterate", "grasp", "record", "summarise", "explain")
"""What a frame's time goes to: images and clouds; models, most of it at the first frame that shows them; kernels, once
after installing; first scores; iterations; grasps; recording; errors and rows; causes."""
SOLVING = ("start", "iterate")
"""The stages that are the method's own."""


def table_lines(record: RunRecord) -> str:
    """The lines of frames.csv about a frame."""
    assert record.end is not None
    text = io.StringIO(newline="")
    rows = ([column.cell(answer) for column in COLUMNS] for answer in record.end.answers)
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue()


def result_rows(record: RunRecord) -> Iterator[ResultRow]:
    """A frame's answers as results.csv has them, with the time of solving alone.

    Where poses were only estimated, these are all hypotheses of an object.
    """
    assert record.end is not None
    (scene_id, im_id), seconds = parse_frame(record.header.frame), round(solving_s(record.end), 3)
    hypotheses = {one.instance_id: one.hypotheses for one in record.header.objects}
    for answer in record.end.answers:
        if answer.obj_id is None or answer.status != "ok":
            continue
        if answer.T_cam_obj is not None and answer.score is not None:
            yield ResultRow(scene_id, im_id, answer.obj_id, answer.score, answer.T_cam_obj, seconds)
        elif answer.instance_id is not None:
            for h in hypotheses[answer.instance_id]:
                yield ResultRow(scene_id, im_id, answer.obj_id, h.confidence, h.T_cam_obj, seconds)


def solving_s(end: RunEnd) -> float:
    """Time for first scores and iterations alone, as results.csv has it [s].

    Reading, recording and explaining are no part of the method. The whole time where stages are unknown.
    """
    parts = [end.stages_ms[name] for name in SOLVING if name in end.stages_ms]
    return 1e-3 * sum(parts) if parts else end.seconds


def left_out_answer(frame: str, one: LeftOut, method: str, seed: int | None = None) -> Answer:
    """The answer about an object that was left out of its frame."""
    return unsolved(frame, one, "left_out", f"left out: {' '.join(one.why.split())}", method, seed)
