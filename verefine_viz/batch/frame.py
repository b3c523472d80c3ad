"""Solving one frame: the one code path behind every kind of batch."""

from __future__ import annotations

import time
import traceback
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from verefine_viz.batch.causes import with_causes
from verefine_viz.batch.room import temporary_folder
from verefine_viz.batch.rows import FrameResult, failed_frame, frame_name
from verefine_viz.batch.summary import frame_result
from verefine_viz.core.atomic import NO_ROOM, atomic
from verefine_viz.core.errors import InputError, VerefineError
from verefine_viz.core.protocols import RunState
from verefine_viz.core.records import Iteration
from verefine_viz.recording.recorder import Recorder
from verefine_viz.session.toolbox import Toolbox


def solve_frame(toolbox: Toolbox, frame: str, out: Path) -> FrameResult:
    """Runs the session's method on one frame, records it below ``out``, and says what came out.

    Whatever goes wrong is part of the answer: a frame that fails must not stop the others.
    """
    return _answered(toolbox, frame, out, explain=False)


def explain_frame(toolbox: Toolbox, frame: str, out: Path) -> FrameResult:
    """The same, with the causes of wrong answers where ground truth is known; their re-runs take time."""
    return _answered(toolbox, frame, out, explain=True)


def _answered(toolbox: Toolbox, frame: str, out: Path, explain: bool) -> FrameResult:
    started = time.perf_counter()
    try:
        result = _solved(toolbox, frame, out / "recordings" / f"{frame_name(frame)}.rrd", explain)
    except VerefineError as error:
        result = failed_frame(frame, str(error), toolbox.session)
    except Exception as error:
        result = unforeseen(toolbox, frame, out, error)
    return result.model_copy(update={"seconds": time.perf_counter() - started})


def unforeseen(toolbox: Toolbox, frame: str, out: Path, error: Exception) -> FrameResult:
    """The result of a frame that failed for a reason nobody foresaw; its traceback is kept below ``out``."""
    log = out / "errors" / f"{frame_name(frame)}.txt"
    # On a full disk the frame fails all the same, just without its traceback.
    with suppress(InputError), atomic(log) as part:
        part.write_text("".join(traceback.format_exception(error)), encoding="utf-8")
    if isinstance(error, OSError) and error.errno in NO_ROOM and error.filename is None:
        disks = f"the disk of {out} or that of temporary files, {temporary_folder()}"
        return failed_frame(frame, f"no room on {disks}: {error.strerror}", toolbox.session)
    where = f" (see errors/{log.name})" if log.is_file() else ""
    return failed_frame(frame, f"{type(error).__name__}: {error}{where}", toolbox.session)


def _solved(toolbox: Toolbox, frame: str, recording: Path, explain: bool) -> FrameResult:
    keep, watch = toolbox.session.recording.keep, _Stopwatch()
    with watch("read"):
        problem = toolbox.problem(frame)
    recorder = Recorder(recording, toolbox.session, problem, toolbox.verifier_of)
    booked = _Booked(recorder, watch)
    try:
        with watch("start"):
            run = toolbox.run(problem, [booked] if keep == "all" else [])
        with watch("iterate"):
            run.finish()
        with watch("summarise"):
            result = frame_result(run, toolbox.session)
        if keep == "failures" and result.is_failure:
            run.fork(run.length, watchers=[booked])  # the recorder sees the whole history
    except BaseException:
        # What there is of the recording is kept where it can be; that it ends for another reason is what is told.
        with suppress(VerefineError):
            recorder.close()
        raise
    with watch("record"):
        recorder.close()
    if explain and any(row.has_truth and row.is_correct is not True and row.was_asked_for for row in result.objects):
        with watch("explain"):
            result = with_causes(result, run, toolbox)
    return result.model_copy(update={"stages_ms": watch.stages_ms})


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


class _Booked:
    """A recorder whose time is booked as such: it watches while a run starts and goes on."""

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
