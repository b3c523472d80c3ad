"""Solving one frame: the one code path behind every kind of batch."""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache, partial
from pathlib import Path

import numpy as np

from verefine_viz.batch.journal import Journal
from verefine_viz.batch.machine import temporary_folder
from verefine_viz.batch.rows import Estimate, FrameResult, ObjectRow, failed_frame, file_stem
from verefine_viz.batch.summary import frame_result, left_out_row, object_facts
from verefine_viz.batch.worker_process import TaskName
from verefine_viz.core.errors import InputError, VerefineError
from verefine_viz.core.paths import DISK_FULL, atomic
from verefine_viz.core.problem import Problem
from verefine_viz.core.protocols import RunState
from verefine_viz.core.records import Iteration
from verefine_viz.diagnosis.diagnose import diagnose
from verefine_viz.grasping.grasp_answer import AnswerGrasps, answer_grasps
from verefine_viz.recording.recorder import Recorder
from verefine_viz.run.engine import Run
from verefine_viz.run.toolbox import Toolbox
from verefine_viz.run.track import Answer, with_its_tracked

FrameTask = Callable[[Toolbox, str, Path], FrameResult]
"""(tools, "scene/image", folder of the batch) → result. A frame that fails is a result too; it never raises."""


def solve_frame(toolbox: Toolbox, frame: str, out: Path) -> FrameResult:
    """Runs the session's method on one frame and records it below ``out``."""
    return _result(lambda: _solved(toolbox, frame, out, explain=False), toolbox, frame, out)


def explain_frame(toolbox: Toolbox, frame: str, out: Path) -> FrameResult:
    """The same, with the causes of wrong answers where ground truth is known; their re-runs take time."""
    return _result(lambda: _solved(toolbox, frame, out, explain=True), toolbox, frame, out)


def estimate_frame(toolbox: Toolbox, frame: str, out: Path) -> FrameResult:
    """Initial poses only: all hypotheses of a frame as estimates, with the estimator's confidence as their score."""
    return _result(lambda: _estimates(toolbox.problem(frame), toolbox.session.hypotheses.source), toolbox, frame, out)


TASKS: dict[TaskName, FrameTask] = {"solve": solve_frame, "explain": explain_frame, "estimate": estimate_frame}
"""What a worker runs for each frame."""


def _result(solve: Callable[[], FrameResult], toolbox: Toolbox, frame: str, out: Path) -> FrameResult:
    """What ``solve`` returns, or why it failed, with the time it took."""
    started = time.perf_counter()
    try:
        result = solve()
    except VerefineError as error:
        result = failed_frame(frame, str(error), toolbox.session)
    except Exception as error:
        result = _unforeseen(toolbox, frame, out, error)
    return result.model_copy(update={"seconds": time.perf_counter() - started})


def _unforeseen(toolbox: Toolbox, frame: str, out: Path, error: Exception) -> FrameResult:
    """The result of a frame that failed for an unforeseen reason; its traceback is saved below ``out``."""
    log = out / "errors" / f"{file_stem(frame)}.txt"
    # On a full disk the frame fails all the same, just without its traceback.
    with suppress(InputError), atomic(log) as part:
        part.write_text("".join(traceback.format_exception(error)), encoding="utf-8")
    if isinstance(error, OSError) and error.errno in DISK_FULL and error.filename is None:
        disks = f"the disk of {out} or that of temporary files, {temporary_folder()}"
        return failed_frame(frame, f"no space on {disks}: {error.strerror}", toolbox.session)
    where = f" (see errors/{log.name})" if log.is_file() else ""
    return failed_frame(frame, f"{type(error).__name__}: {error}{where}", toolbox.session)


def with_causes(result: FrameResult, run: Run, toolbox: Toolbox) -> FrameResult:
    """``result`` with ``cause`` and ``evidence`` in the rows of objects that failed and have ground truth.

    Where the data of such a frame do not fit together, the doubts are in ``evidence`` as well.
    """
    doubts = result.doubts
    try:
        diagnoses = diagnose(run, toolbox)
        causes: dict[int | None, tuple[str, str]] = {d.instance_id: (str(d.main.cause), d.main.text) for d in diagnoses}
        # Each has all of the frame's.
        doubts = diagnoses[0].doubts if diagnoses else doubts
    except Exception as error:
        # The answers are there all the same.
        why = f"no diagnosis: {type(error).__name__}: {error}"
        causes = {row.instance_id: ("", why) for row in result.objects if row.has_truth and row.is_correct is not True}
    rows = []
    for row in result.objects:
        unknown = ("", "") if row.has_truth else (row.cause, row.evidence)
        cause, sentence = causes.get(row.instance_id, unknown)
        rows.append(row.model_copy(update={"cause": cause, "evidence": " ".join(sentence.split())}))
    return result.model_copy(update={"objects": tuple(rows), "doubts": doubts})


def _solved(toolbox: Toolbox, frame: str, out: Path, explain: bool) -> FrameResult:
    keep, watch, settings = toolbox.session.recording.keep, _Stopwatch(), toolbox.session.grasp
    if toolbox.session.method.track:
        toolbox.track.recall = partial(_answers, Journal(out / "frames"))
    with watch("read"):
        problem = toolbox.problem(frame, lambda: watch("prepare"))

    @cache
    def grasping(state: RunState) -> AnswerGrasps | None:
        if not settings.answers:
            return None
        with watch("grasp"):
            return answer_grasps(problem, [best and best.T_cam_obj for best in state.best], settings)

    recorder = Recorder(
        out / "recordings" / f"{file_stem(frame)}.rrd",
        with_its_tracked(toolbox.session, problem),
        problem,
        toolbox.verifier_of,
        refiner_of=toolbox.refiner_of,
        grasps_of=grasping,
    )
    timed = _TimedRecorder(recorder, watch)
    try:
        with watch("start"):
            run = toolbox.run(problem, [timed] if keep == "all" else [])
        with watch("iterate"):
            run.finish()
        grasps = grasping(run.final_state)
        with watch("summarise"):
            result = frame_result(run, toolbox.session, recorder.landscapes, grasps)
        if keep == "failures" and result.is_failure:
            run.fork(run.length, watchers=[timed])  # the recorder sees the whole history
    except BaseException:
        # The recording so far is saved where it can be; the first error is the one to report.
        with suppress(VerefineError):
            recorder.close()
        raise
    with watch("record"):
        recorder.close()
    if explain and any(row.has_truth and row.is_correct is not True and row.was_asked_for for row in result.objects):
        with watch("explain"):
            result = with_causes(result, run, toolbox)
    return result.model_copy(update={"stages_ms": watch.stages_ms})


def _answers(journal: Journal, frame: str) -> tuple[Answer, ...] | None:
    """What a frame answered that is in the journal; None where it is not."""
    result = journal.read(frame)
    if result is None:
        return None
    T_map_cam = None if result.T_map_cam is None else np.reshape(result.T_map_cam, (4, 4))
    return tuple(
        Answer(frame, one.obj_id, one.instance_id, np.reshape(one.T_cam_obj, (4, 4)), T_map_cam)
        for one in result.estimates
        if one.instance_id is not None
    )


class _Stopwatch:
    """Milliseconds by stage; a stage within another takes its time from it."""

    def __init__(self) -> None:
        self.stages_ms: dict[str, float] = {}
        self._stage = ""

    @contextmanager
    def __call__(self, stage: str) -> Iterator[None]:
        outer, self._stage = self._stage, stage
        started = time.perf_counter()
        try:
            yield
        finally:
            ms = 1e3 * (time.perf_counter() - started)
            self._stage = outer
            self._add(stage, ms)
            if outer:
                self._add(outer, -ms)

    def _add(self, stage: str, ms: float) -> None:
        self.stages_ms[stage] = self.stages_ms.get(stage, 0.0) + ms


class _TimedRecorder:
    """Watches a run, so its time falls into other stages, and is counted as recording."""

    def __init__(self, recorder: Recorder, watch: _Stopwatch) -> None:
        self._recorder, self._watch = recorder, watch

    def on_start(self, state: RunState) -> None:
        with self._watch("record"):
            self._recorder.on_start(state)

    def on_iteration(self, state: RunState, iteration: Iteration) -> None:
        with self._watch("record"):
            self._recorder.on_iteration(state, iteration)

    def on_finish(self, state: RunState) -> None:
        with self._watch("record"):
            self._recorder.on_finish(state)


def _estimates(problem: Problem, estimator: str) -> FrameResult:
    rows, estimates = [], []
    for target in problem.targets:
        instance = target.instance
        rows.append(
            ObjectRow(
                **object_facts(problem, target, estimator),
                status="ok" if instance.hypotheses else "no_answer",
                message="" if instance.hypotheses else f"{estimator} found no hypothesis",
            )
        )
        estimates += [
            Estimate(obj_id=instance.obj_id, score=h.confidence, T_cam_obj=tuple(h.T_cam_obj.ravel().tolist()))
            for h in instance.hypotheses
        ]
    rows += [left_out_row(problem, one, estimator) for one in problem.left_out]
    return FrameResult(
        frame=problem.frame,
        failed=False,
        seconds=0.0,
        objects=tuple(rows),
        estimates=tuple(estimates),
        n_unreadable=sum(one.is_unreadable for one in problem.left_out),
    )
