"""Solving one frame: the one code path behind every kind of batch."""

from __future__ import annotations

import time
import traceback
from pathlib import Path

from verefine_viz.batch.rows import FrameResult, failed_frame, frame_name
from verefine_viz.batch.summary import frame_result
from verefine_viz.core.errors import VerefineError
from verefine_viz.recording.recorder import Recorder
from verefine_viz.session.toolbox import Toolbox


def solve_frame(toolbox: Toolbox, frame: str, out: Path) -> FrameResult:
    """Runs the session's method on one frame, records it below ``out``, and says what came out.

    Whatever goes wrong is part of the answer: a frame that fails must not stop the others.
    """
    started = time.perf_counter()
    try:
        result = _solved(toolbox, frame, out / "recordings" / f"{frame_name(frame)}.rrd")
    except VerefineError as error:
        result = failed_frame(frame, str(error))
    except Exception as error:
        log = out / "errors" / f"{frame_name(frame)}.txt"
        log.parent.mkdir(exist_ok=True)
        log.write_text(traceback.format_exc(), encoding="utf-8")
        result = failed_frame(frame, f"{type(error).__name__}: {error} (see errors/{log.name})")
    return result.model_copy(update={"seconds": time.perf_counter() - started})


def _solved(toolbox: Toolbox, frame: str, recording: Path) -> FrameResult:
    keep = toolbox.session.recording.keep
    problem = toolbox.problem(frame)
    recorder = Recorder(recording, toolbox.session, problem, toolbox.verifier)
    try:
        run = toolbox.run(problem, [recorder] if keep == "all" else [])
        run.finish()
        result = frame_result(run)
        if keep == "failures" and is_failure(result):
            run.fork(run.length, watchers=[recorder])  # the recorder sees the whole history
    finally:
        recorder.close()
    return result


def is_failure(result: FrameResult) -> bool:
    """Whether a person will want to look: an object without an answer, or ADD(-S) not below 10 % of the diameter."""
    return any(row.status != "ok" or row.is_correct is False for row in result.objects)
