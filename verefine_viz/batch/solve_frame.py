"""Solves one frame: the one code path behind every kind of batch."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, suppress
from functools import cache, partial
from pathlib import Path
from typing import Protocol

from msgspec import structs

from verefine_viz.batch.failures import save_traceback, why_failed
from verefine_viz.batch.kept_recordings import KeptRecordings
from verefine_viz.batch.runs import Runs, file_stem
from verefine_viz.batch.summary import object_facts, run_end, with_findings
from verefine_viz.batch.worker_tasks import TaskName
from verefine_viz.core.errors import VerefineError
from verefine_viz.core.finding import Finding
from verefine_viz.core.protocols import RunState, Watcher
from verefine_viz.core.records import Iteration
from verefine_viz.diagnosis.diagnose import diagnose
from verefine_viz.diagnosis.films import films_of
from verefine_viz.grasping.grasp_answer import AnswerGrasps, answer_grasps
from verefine_viz.recording.recorder import Recorder
from verefine_viz.run.answers import left_out_answer
from verefine_viz.run.engine import Run
from verefine_viz.run.kernel_compilation import compiling_reported
from verefine_viz.run.record import Answer, RunEnd, RunRecord
from verefine_viz.run.run_file import RunFile
from verefine_viz.run.run_header import failed_run, header_of, session_of
from verefine_viz.run.session_parts import weights_of
from verefine_viz.run.toolbox import Toolbox
from verefine_viz.run.track import EarlierPose, with_its_tracked


class FrameTask(Protocol):
    """What a worker does with a frame; it never raises."""

    def __call__(
        self, toolbox: Toolbox, frame: str, out: Path, compiling: Callable[[], None] = lambda: None, /
    ) -> RunRecord:
        """Solve a frame.

        Args:
            toolbox: the session's tools.
            frame: "scene/image".
            out: the folder of the batch.
            compiling: called whenever a kernel is about to be compiled.

        Returns:
            The record without its iterations. The record of a frame that failed is not yet on the disk.
        """
        ...


def solve_frame(toolbox: Toolbox, frame: str, out: Path, compiling: Callable[[], None] = lambda: None) -> RunRecord:
    """Run the session's method on one frame and record it below ``out``."""
    return _result(partial(_solved, toolbox, frame, out, False), toolbox, frame, out, compiling)


def explain_frame(toolbox: Toolbox, frame: str, out: Path, compiling: Callable[[], None] = lambda: None) -> RunRecord:
    """Solve a frame and name the causes of wrong answers where ground truth is known; their re-runs take time."""
    return _result(partial(_solved, toolbox, frame, out, True), toolbox, frame, out, compiling)


def estimate_frame(toolbox: Toolbox, frame: str, out: Path, compiling: Callable[[], None] = lambda: None) -> RunRecord:
    """Report all hypotheses of a frame as estimates, their confidence as score, without running a method."""
    return _result(partial(_estimated, toolbox, frame, out), toolbox, frame, out, compiling)


TASKS: dict[TaskName, FrameTask] = {"solve": solve_frame, "explain": explain_frame, "estimate": estimate_frame}
"""What a worker runs for each frame."""


def _result(
    solve: Callable[[_Stopwatch], RunRecord], toolbox: Toolbox, frame: str, out: Path, compiling: Callable[[], None]
) -> RunRecord:
    """The record that ``solve`` returns, or one that says why it failed."""
    watch = _Stopwatch()
    try:
        with compiling_reported(compiling, partial(watch, "compile")):
            return solve(watch)
    except Exception as error:
        return failed_run(toolbox.session, weights_of(toolbox.session), frame, why_failed(error, out, file_stem(frame)))


def with_causes(end: RunEnd, run: Run, toolbox: Toolbox, out: Path | None = None) -> RunEnd:
    """``end`` with the causes of its wrong answers as findings, where ground truth is known.

    Where the data of the frame do not fit together, wrong answers get the doubts as well. Where the diagnosis fails, a
    finding without a cause says so, and the traceback is saved below ``out``.
    """
    doubts = end.doubts
    try:
        diagnoses = diagnose(run, toolbox)
        findings: dict[int | None, tuple[Finding, ...]] = {d.instance_id: d.findings for d in diagnoses}
        # Each diagnosis has all doubts of the frame.
        doubts = of_wrong = diagnoses[0].doubts if diagnoses else doubts
    except Exception as error:
        # The answers are good without a diagnosis.
        known, stem = isinstance(error, VerefineError), file_stem(run.problem.frame)
        why = str(error) if known else f"an error of the program{save_traceback(error, out, stem)}"
        why = f"no diagnosis: {why}"
        unexplained = [row for row in end.answers if row.has_truth and row.is_correct is not True]
        findings, of_wrong = {row.instance_id: (Finding("", why),) for row in unexplained}, ()
    rows = [
        with_findings(row, findings[row.instance_id], of_wrong)
        if row.instance_id in findings
        else structs.replace(row, doubts=() if row.has_truth else row.doubts)
        for row in end.answers
    ]
    return structs.replace(end, answers=tuple(rows), doubts=doubts)


def _solved(toolbox: Toolbox, frame: str, out: Path, explain: bool, watch: _Stopwatch) -> RunRecord:
    session, started = toolbox.session, time.perf_counter()
    settings, runs = session.grasp, Runs(out / "runs")
    kept = KeptRecordings.of(session, len(toolbox.frames))
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
    weights = weights_of(recorded)
    file = RunFile(runs.path(frame), recorded, weights)
    recorder = Recorder(
        out / "recordings" / f"{file_stem(frame)}.rrd",
        recorded,
        problem,
        toolbox.verifier_of,
        refiner_of=toolbox.refiner_of,
        grasps_of=grasping,
        weights=weights,
        films_of=lambda record: films_of(record, problem, toolbox.verifier_of),
    )
    timed = [_Timed(recorder, watch)] if kept.always(frame) else []
    with closing(file):
        try:
            with watch("start"):
                run = toolbox.run(problem, [_Timed(file, watch), *timed])
            with watch("iterate"):
                run.finish()
            grasps = grasping(run.final_state)
            with watch("summarise"):
                end = run_end(run, session, recorder.allowed, grasps, toolbox.surfaces)
            is_recorded = kept.holds(frame, end)
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
    return RunRecord(header_of(problem, run.state_at(0), recorded, weights), (), end)


def end_again(run: Run, recorded: RunRecord) -> RunEnd:
    """The end of a finished run, worked out again: with grasps and causes where ``recorded``, its record, has any.

    Raises:
        VerefineError: a part that is needed for it cannot be made here.
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
    """The poses that a finished frame answered with; None where the frame is not finished."""
    record = runs.read(frame)
    if record is None or record.end is None:
        return None
    return tuple(
        EarlierPose(frame, one.obj_id, one.instance_id, one.T_cam_obj, record.header.T_map_cam)
        for one in record.end.answers
        if one.T_cam_obj is not None and one.obj_id is not None and one.instance_id is not None
    )


class _Stopwatch:
    """Milliseconds by stage; the time of a stage inside another counts for the inner one only."""

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
        header_of(problem, None, session, weights_of(session)),
        (),
        RunEnd(answers=tuple(answers), seconds=seconds, stages_ms=watch.stages_ms, n_unreadable=n_unreadable),
    )
    Runs(out / "runs").save(session, record)
    return record
