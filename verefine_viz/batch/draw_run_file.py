"""Draws the run of a run file into a recording, as a batch does that keeps it."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from verefine_viz.core.errors import InputError
from verefine_viz.core.problem import Problem
from verefine_viz.core.protocols import RunState
from verefine_viz.core.writing import atomic
from verefine_viz.diagnosis.films import films_of
from verefine_viz.grasping.grasp_answer import AnswerGrasps, answer_grasps
from verefine_viz.recording.recorder import Recorder
from verefine_viz.run.engine import Run
from verefine_viz.run.record import RunRecord
from verefine_viz.run.run_file import read_run_file
from verefine_viz.run.run_header import session_of
from verefine_viz.run.session_parts import check_parts, weights_of
from verefine_viz.run.toolbox import Toolbox


class RunDrawer:
    """Draws one run file after another; runs of the same session share the models that were prepared."""

    def __init__(self) -> None:
        self._toolbox: Toolbox | None = None

    def draw(self, run_file: Path, recording: Path) -> None:
        """Write ``recording``, which appears under its name when it is whole.

        Raises:
            VerefineError: the run or its data cannot be read, the frame failed, or the disk does not take it.
        """
        record = read_run_file(run_file)
        if record.end is not None and record.end.failed:
            raise InputError(f"{run_file} has nothing to draw: the frame failed, {record.end.answers[0].message}")
        toolbox = self._toolbox_of(record, run_file)
        problem = toolbox.problem(record.header.frame)
        with atomic(recording) as part:
            recorder = Recorder(
                part,
                toolbox.session,
                problem,
                toolbox.verifier_of,
                refiner_of=toolbox.refiner_of,
                grasps_of=partial(_grasps, toolbox, problem) if _has_grasps(record) else None,
                weights=weights_of(toolbox.session),
                films_of=lambda record: films_of(record, problem, toolbox.verifier_of),
            )
            Run.from_record(record, problem, [recorder])
            recorder.close(run_file.read_bytes())

    def _toolbox_of(self, record: RunRecord, run_file: Path) -> Toolbox:
        session = session_of(record.header)
        if self._toolbox is None or self._toolbox.session != session:
            check_parts(session, f"run {run_file}", "draw", f"replay {run_file} --draw")
            self._toolbox = Toolbox(session)
        return self._toolbox


def _has_grasps(record: RunRecord) -> bool:
    return any(one.grasp or one.grasp_ground_truth for one in (record.end.answers if record.end else ()))


def _grasps(toolbox: Toolbox, problem: Problem, state: RunState) -> AnswerGrasps:
    return answer_grasps(problem, [best and best.T_cam_obj for best in state.best], toolbox.session.grasp)
