"""Solving one frame: the one code path behind every kind of batch."""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, suppress
from functools import cache, partial
from pathlib import Path
from typing import Protocol

from msgspec import structs

from verefine_viz.batch.folder import ERRORS
from verefine_viz.batch.machine import temporary_folder
from verefine_viz.batch.runs import Runs, file_stem
from verefine_viz.batch.summary import object_facts, run_end
from verefine_viz.batch.worker_tasks import TaskName
from verefine_viz.core.errors import InputError, VerefineError
from verefine_viz.core.protocols import RunState, Watcher
from verefine_viz.core.records import Iteration
from verefine_viz.core.writing import DISK_FULL, atomic
from verefine_viz.diagnosis.diagnose import diagnose
from verefine_viz.grasping.grasp_answer import AnswerGrasps, answer_grasps
from verefine_viz.recording.recorder import Recorder
from verefine_viz.run.answers import left_out_answer
from verefine_viz.run.engine import Run
from verefine_viz.run.kernel_compilation import compiling_reported
from verefine_viz.run.record import Answer, RunEnd, RunRecord, failed_run, header_of, session_of
from verefine_viz.run.run_file import RunFile
from verefine_viz.run.toolbox import Toolbox
from verefine_viz.run.track import EarlierPose, with_its_tracked


class FrameTask(Protocol):
    """What a worker does with a frame; it never raises."""

    def __call__(
        self, toolbox: Toolbox, frame: str, out: Path, compiling: Callable[[], None] = lambda: None, /
    ) -> RunRecord:
        """Do it.

        Args:
            toolbox: the session's tools.
            frame: "scene/image".
            out: the folder of the batch.
            compiling: called whenever a kernel is about to be compiled.

        Returns:
            The record without its iterations. That of a frame that fails is not yet on the disk.
        """
        ...


def solve_frame(toolbox: Toolbox, frame: str, out: Path, compiling: Callable[[], None] = lambda: None) -> RunRecord:
    """Runs the session's method on one frame and records it below ``out``."""
    return _result(partial(_solved, toolbox, frame, out, False), toolbox, frame, out, compiling)


def explain_frame(toolbox: Toolbox, frame: str, out: Path, compiling: Callable[[], None] = lambda: None) -> RunRecord:
    """Solve a frame and name the causes of wrong answers where ground truth is known; their re-runs take time."""
    return _result(partial(_solved, toolbox, frame, out, True), toolbox, frame, out, compiling)


def estimate_frame(toolbox: Toolbox, frame: str, out: Path, compiling: Callable[[], None] = lambda: None) -> RunRecord:
    """Initial poses only: all hypotheses of a frame as estimates, with the estimator's confidence as their score."""
    return _result(partial(_estimated, toolbox, frame, out), toolbox, frame, out, compiling)


TASKS: dict[TaskName, FrameTask] = {"solve": solve_frame, "explain": explain_frame, "estimate": estimate_frame}
"""What a worker runs for each frame."""


def _result(
    solve: Callable[[_Stopwatch], RunRecord], toolbox: Toolbox, frame: str, out: Path, compiling: Callable[[], None]
) -> RunRecord:
    """What ``solve`` returns, or why it failed."""
    watch = _Stopwatch()
    try:
        with compiling_reported(compiling, partial(watch, "compile")):
            return solve(watch)
    except VerefineError as error:
        return failed_run(toolbox.session, frame, str(error))
    except Exception as error:
        return _unforeseen(toolbox, frame, out, error)


def _unforeseen(toolbox: Toolbox, frame: str, out: Path, error: Exception) -> RunRecord:
    """The result of a frame that failed for an unforeseen reason; its traceback is saved below ``out``."""
    where = _logged(frame, out, error)
    if isinstance(error, OSError) and error.errno in DISK_FULL and error.filename is None:
        disks = f"the disk of {out} or that of temporary files, {temporary_folder()}"
        return failed_run(toolbox.session, frame, f"no space on {disks}: {error.strerror}")
    return failed_run(toolbox.session, frame, f"{type(error).__name__}: {error}{where}")


def _logged(frame: str, out: Path | None, error: Exception) -> str:
    """Where the traceback of a frame's error is saved, for a message; "" where it could not be, or has no place."""
    if out is None:
        return ""
    log = out / ERRORS / f"{file_stem(frame)}.txt"
    # On a full disk all goes on the same, just without the traceback.
    with suppress(InputError), atomic(log) as part:
        part.write_text("".join(traceback.format_exception(error)), encoding="utf-8")
    return f" (see {ERRORS}/{log.name})" if log.is_file() else ""


def with_causes(end: RunEnd, run: Run, toolbox: Toolbox, out: Path | None = None) -> RunEnd:
    """``end`` with ``cause`` and ``evidence`` in the answers that are wrong and have ground truth.

    Where the data of such a frame do not fit together, the doubts are in ``evidence`` as well. Where the diagnosis
    fails, that is said there, and its traceback saved below ``out``.
    """
    doubts = end.doubts
    try:
        diagnoses = diagnose(run, toolbox)
        causes: dict[int | None, tuple[str, str]] = {d.instance_id: (str(d.main.cause), d.main.text) for d in diagnoses}
        # Each has all of the frame's.
        doubts = diagnoses[0].doubts if diagnoses else doubts
    except Exception as error:
        # The answers are there all the same.
        known = isinstance(error, VerefineError)
        why = str(error) if known else f"an error of the program{_logged(run.problem.frame, out, error)}"
        why = f"no diagnosis: {why}"
        causes = {row.instance_id: ("", why) for row in end.answers if row.has_truth and row.is_correct is not True}
    rows = []
    for row in end.answers:
        unknown = ("", "") if row.has_truth else (row.cause, row.evidence)
        cause, sentence = causes.get(row.instance_id, unknown)
        rows.append(structs.replace(row, cause=cause, evidence=" ".join(sentence.split())))
    return structs.replace(end, answers=tuple(rows), doubts=doubts)


def _solved(toolbox: Toolbox, frame: str, out: Path, explain: bool, watch: _Stopwatch) -> RunRecord:
    session, started = toolbox.session, time.perf_counter()
    keep, settings, runs = session.recording.keep, session.grasp, Runs(out / "runs")
    if session.method.track:
        toolbox.track.recall = partial(_answers, runs)
    with watch("read"):
        problem = toolbox.problem(frame, lambda: watch("prepare"))

    @cache
    def grasping(state: RunState) -> AnswerGrasps | None:
        if not settings.answers:
            return None
        with watch("grasp"):
            return answer_grasps(problem, [best and best.T_cam_obj for best in state.best], settings)

    recorded = with_its_tracked(session, problem)
    file = RunFile(runs.path(frame), recorded)
    recorder = Recorder(
        out / "recordings" / f"{file_stem(frame)}.rrd",
        recorded,
        problem,
        toolbox.verifier_of,
        refiner_of=toolbox.refiner_of,
        grasps_of=grasping,
    )
    timed = [_Timed(recorder, watch)] if keep == "all" else []
    with closing(file):
        try:
            with watch("start"):
                run = toolbox.run(problem, [_Timed(file, watch), *timed])
            with watch("iterate"):
                run.finish()
            grasps = grasping(run.final_state)
            with watch("summarise"):
                end = run_end(run, session, recorder.landscapes, grasps, toolbox.surfaces)
            is_recorded = keep == "all" or (keep == "failures" and end.is_failure)
            if is_recorded and not timed:
                run.show([_Timed(recorder, watch)])
            if explain and any(a.has_truth and a.is_correct is not True and a.was_asked_for for a in end.answers):
                with watch("explain"):
                    end = with_causes(end, run, toolbox, out)
            end = structs.replace(end, seconds=time.perf_counter() - started, stages_ms=watch.stages_ms)
            if is_recorded:
                recorder.close(file.finished_as(end))
            # Last: a frame whose run file is finished is never solved again.
            file.finish(end)
        except BaseException:
            # The recording so far is saved where it can be; the first error is the one to report.
            with suppress(VerefineError):
                recorder.close()
            raise
    return RunRecord(header_of(problem, run.state_at(0), recorded), (), end)


def end_again(run: Run, recorded: RunRecord) -> RunEnd:
    """The end of a run that is over, worked out as that of a record of it was: with grasps and causes where it has any.

    Raises:
        VerefineError: what works it out cannot be made here.
    """
    session, problem = session_of(recorded.header), run.problem
    answers = () if recorded.end is None else recorded.end.answers
    grasps = None
    if any(one.grasp or one.grasp_ground_truth for one in answers):
        grasps = answer_grasps(problem, [best and best.T_cam_obj for best in run.final_state.best], session.grasp)
    end = run_end(run, session, grasps=grasps)
    plain = {one.instance_id: (one.cause, one.evidence) for one in end.answers}
    if any((one.cause, one.evidence) != plain.get(one.instance_id) for one in answers):
        end = with_causes(end, run, Toolbox(session))
    return end


def _answers(runs: Runs, frame: str) -> tuple[EarlierPose, ...] | None:
    """What a finished frame answered; None where it is not finished."""
    record = runs.read(frame)
    if record is None or record.end is None:
        return None
    return tuple(
        EarlierPose(frame, one.obj_id, one.instance_id, one.T_cam_obj, record.header.T_map_cam)
        for one in record.end.answers
        if one.T_cam_obj is not None and one.obj_id is not None and one.instance_id is not None
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


class _Timed:
    """A watcher whose time is counted as recording, not in the stages that it interrupts."""

    def __init__(self, watcher: Watcher[RunState], watch: _Stopwatch) -> None:
        self._watcher, self._watch = watcher, watch

    def on_start(self, state: RunState) -> None:
        with self._watch("record"):
            self._watcher.on_start(state)

    def on_iteration(self, state: RunState, iteration: Iteration) -> None:
        with self._watch("record"):
            self._watcher.on_iteration(state, iteration)

    def on_finish(self, state: RunState) -> None:
        with self._watch("record"):
            self._watcher.on_finish(state)


def _estimated(toolbox: Toolbox, frame: str, out: Path, watch: _Stopwatch) -> RunRecord:
    started, session = time.perf_counter(), toolbox.session
    with watch("read"):
        problem = toolbox.problem(frame, lambda: watch("prepare"))
    estimator = session.hypotheses.source
    answers = [
        Answer(
            **object_facts(problem, target, estimator),
            status="ok" if target.instance.hypotheses else "no_answer",
            message="" if target.instance.hypotheses else f"{estimator} found no hypothesis",
        )
        for target in problem.targets
    ]
    answers += [left_out_answer(problem.frame, one, estimator, None) for one in problem.left_out]
    n_unreadable = sum(one.is_unreadable for one in problem.left_out)
    seconds = time.perf_counter() - started
    record = RunRecord(
        header_of(problem, None, session),
        (),
        RunEnd(answers=tuple(answers), seconds=seconds, stages_ms=watch.stages_ms, n_unreadable=n_unreadable),
    )
    Runs(out / "runs").save(session, record)
    return record
