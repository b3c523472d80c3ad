"""The table of answers: its columns, each with what it says. ``docs/tables.md`` repeats it."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from verefine_viz.core.problem import LeftOut
from verefine_viz.core.writing import atomic
from verefine_viz.run.record import Answer, RunEnd, RunRecord, unsolved
from verefine_viz.scenes.frames import parse_frame
from verefine_viz.scenes.results_csv import ResultRow


@dataclass(frozen=True)
class Column:
    """One column of frames.csv."""

    name: str
    text: str
    """What it says, with its unit, as markdown."""
    kind: Literal["exact", "time"] = "exact"
    """exact: the same for the same session; time: differs from run to run."""
    digits: int | None = 3
    """After the point; None = all, as such numbers are compared. More digits of a millimetre are noise."""
    value: Callable[[Answer], object] | None = None
    """How it follows from an answer; None = its field or property of that name."""

    def cell(self, answer: Answer) -> object:
        """The value as the table has it; "" where it is unknown."""
        value = getattr(answer, self.name) if self.value is None else self.value(answer)
        if value is None:
            return ""
        return f"{value:.{self.digits}f}" if isinstance(value, float) and self.digits is not None else value


COLUMNS = (
    Column("scene_id", "BOP's number of the scene"),
    Column("im_id", "BOP's number of the image"),
    Column(
        "instance_id",
        "number of the object in the frame, from 0: its place in `scene_gt.json`; with masks from a "
        "detections file, its rank by detection score",
    ),
    Column("obj_id", "BOP's number of the object's model"),
    Column("name", "name of the object's model"),
    Column("method", "method of the session (`method.name`)"),
    Column("seed", "seed of the initial poses (`hypotheses.seed`)"),
    Column("visib_fract", "visible share of the object, 0 to 1, where the data set says"),
    Column(
        "has_truth",
        "whether ground truth is known; every such object counts in the share of right ones, with an answer or without",
    ),
    Column(
        "status",
        "`ok`: there is an answer; `no_answer`: there was no hypothesis; `left_out`: its mask or its model "
        "is missing or damaged (mend it: `--retry-failed` then solves the frame again), its mask is empty, "
        "or it was not detected; `failed`: its frame could not be solved",
    ),
    Column("score", "verification score of the answer, 0 to 1", digits=None),
    Column("initial_score", "best score among the hypotheses as they were given", digits=None),
    Column(
        "colour_fit",
        "f_c of the answer, -1 to 1: correlation of rendered and observed colour; empty where colour does "
        "not count (`score.colour_weight` is 0, or model or image have no contrast)",
    ),
    Column(
        "plausibility",
        "p of the answer, 0 to 1: half of it for touching without sinking in, half for being stable; empty where "
        "plausibility does not count (`score.plausibility_weight` is 0, or no support plane is known)",
    ),
    Column(
        "recorded_score",
        "score that the program whose steps were recorded gave to the answer, in its own units; empty where"
        " nothing was recorded, it gave none, or the answer is another pose",
        digits=None,
    ),
    Column("missing_depth", "share of the object's mask without depth, 0 to 1"),
    Column(
        "add_s_mm",
        "error of the answer [mm]: ADD, the mean distance of model points from where they should be; for "
        "objects declared symmetric ADD-S, from the nearest such point. Right is below 10 % of the "
        "diameter. [Measured on](#what-errors-are-measured-on) points sampled on the surface",
    ),
    Column("initial_add_s_mm", "ADD(-S) of the hypothesis with the best initial score [mm]"),
    Column("rotation_deg", "rotation error of the answer [°], the smallest over declared symmetries"),
    Column("translation_mm", "translation error of the answer [mm]"),
    Column("diameter_mm", "diameter of the object's model [mm]"),
    Column("best_hypothesis", "number of the hypothesis that the answer comes from, from 1"),
    Column(
        "best_iteration", "the iteration that made the answer, counted over the frame; 0: a hypothesis as it was given"
    ),
    Column(
        "worst_iteration",
        "the iteration that gave up a correct pose for the wrong answer; else the one that took the "
        "accepted pose furthest from the ground truth, if one added more than 3 % of the diameter to the "
        "error; without ground truth the one that lost most score, if more than 0.01. Empty: none did. The "
        "page opens an answer here, else at `best_iteration`",
    ),
    Column(
        "undetermined_mm",
        "how far the answer could be shifted, along an axis of the table or of the model, without the score"
        " falling by more than twice the standard deviation that noise of the depth image gives the "
        "difference [mm]; at most 30: the longer side of a connected interval around the answer. The noise is"
        " measured in the frame itself",
    ),
    Column(
        "undetermined_deg",
        "how far the answer could be turned so, about an axis through what is seen of the object [°]; 180 about an "
        "axis of symmetry, declared or not",
    ),
    Column("n_hypotheses", "hypotheses it started from"),
    Column("n_iterations", "iterations spent on it"),
    Column(
        "grasp",
        "how a simulated grasp by the answer ends, with `batch --grasp` (`grasp.answers`): `success`, "
        "`slipped`, `no contact`, `collided with the target`, `collided with a neighbour`, `collided with "
        "the ground`, or `no collision-free grasp`; [how](methods.md#84-grasping). Empty where it was not "
        "tried: no answer, an object of the frame without ground truth, no support plane",
    ),
    Column("grasp_ground_truth", "how a simulated grasp by the ground-truth pose ends"),
    Column("events", "what happened in them and how often, by kind: `arm_switched 4; score_fell 1`"),
    Column("ms_refine", "time in the refiner [ms]", kind="time"),
    Column("ms_simulate", "time in the physics simulation [ms]", kind="time"),
    Column("ms_score", "time that iterations waited for scores [ms]", kind="time"),
    Column("ms_total", "time of its iterations [ms]", kind="time"),
    Column(
        "cause",
        "why the answer is wrong or missing, one of those below; needs ground truth, and `batch` without "
        "`--no-diagnose`; without ground truth only `impossible`",
    ),
    Column(
        "evidence",
        "the cause in a sentence, with its numbers; where the camera, the models or the depth of the frame "
        'look wrong it ends with that: "Look at the data first: …". Without ground truth it says that '
        "alone, and also where the support plane looks wrong; where it says nothing of the data, why an answer is "
        "physically impossible",
    ),
    Column(
        "message",
        "why there is no answer, or what was missing: no support plane, say; also that an answer is right "
        "by ADD-S only, while ADD over the declared symmetries is above 10 % of the diameter",
    ),
)
HEADER = ",".join(column.name for column in COLUMNS) + "\n"
"""The first line of frames.csv."""
STAGES = ("read", "prepare", "compile", "start", "iterate", "grasp", "record", "summarise", "explain")
"""What a frame's time goes to: images and clouds; models, most of it at the first frame that shows them; kernels, once
after installing; first scores; iterations; grasps; recording; errors and rows; causes."""
ONCE = ("prepare", "compile")
"""The stages that later frames need not repeat."""
SOLVING = ("start", "iterate")
"""The stages that are the method's own."""


def table_lines(record: RunRecord) -> str:
    """The lines of frames.csv about a frame."""
    assert record.end is not None
    text = io.StringIO(newline="")
    rows = ([column.cell(answer) for column in COLUMNS] for answer in record.end.answers)
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue()


def write_table(path: Path, records: Iterable[RunRecord]) -> None:
    """Write frames.csv, row by row; it appears under its name only when it is whole.

    Raises:
        InputError: the file cannot be written.
    """
    with atomic(path) as part, part.open("w", encoding="utf-8", newline="") as file:
        file.write(HEADER)
        file.writelines(map(table_lines, records))


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


def once_s(end: RunEnd) -> float:
    """Time for what later frames need not repeat [s]."""
    return 1e-3 * sum(end.stages_ms.get(name, 0.0) for name in ONCE)


def left_out_answer(frame: str, one: LeftOut, method: str, seed: int | None = None) -> Answer:
    """The answer about an object that was left out of its frame."""
    return unsolved(frame, one, "left_out", f"left out: {' '.join(one.why.split())}", method, seed)
