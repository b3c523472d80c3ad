"""One batch: every frame of a session, headless, resumable."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Sequence
from contextlib import closing
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

import verefine_viz
from verefine_viz.batch.folder import RUN_FILE, RunFolder
from verefine_viz.batch.machine import machine, package_versions
from verefine_viz.batch.pool import Pool
from verefine_viz.batch.rows import FrameResult, frame_ids, frames_csv
from verefine_viz.core.errors import InputError
from verefine_viz.core.settings import Session
from verefine_viz.scenes.results import ResultRow, write_results
from verefine_viz.session.toolbox import Toolbox

Progress = Callable[[FrameResult | None, int, int], None]
"""Told about each finished frame (None: at the start), how many are done, and how many there are."""


@dataclass(frozen=True)
class Outcome:
    """How a batch ended."""

    folder: Path
    results: tuple[FrameResult, ...]
    """In the session's order of frames."""
    n_resumed: int
    """Frames that an earlier start had already solved."""
    seconds: float

    @property
    def failed(self) -> tuple[FrameResult, ...]:
        return tuple(r for r in self.results if r.failed)


def check(session: Session) -> tuple[str, ...]:
    """The frames of a session, after everything in it that can be wrong was looked at once.

    Raises:
        VerefineError: the data set, a frame, the method or another name in the session is wrong.
    """
    toolbox = Toolbox(session)
    frames = toolbox.frames
    if not frames:
        raise InputError("the session names no frames: the split and the targets file hold none")
    _ = toolbox.method
    return frames


def run_batch(session: Session, out: Path, n_workers: int, progress: Progress) -> Outcome:
    """Solves every frame of ``session`` into ``out``; goes on where an earlier start of the same batch stopped.

    The files are the same for any number of workers and of interruptions, times aside.

    Raises:
        VerefineError: the session or ``out`` cannot be used. A frame that fails does not raise: it is in the outcome.
    """
    pool = Pool(session, out, n_workers)
    try:
        frames = check(session)
        with closing(RunFolder(out, session)) as folder:
            return _run(session, frames, folder, pool, n_workers, progress)
    finally:
        pool.close()


def _run(
    session: Session, frames: Sequence[str], folder: RunFolder, pool: Pool, n_workers: int, progress: Progress
) -> Outcome:
    started, begun = time.perf_counter(), datetime.now(UTC)
    results = {f: r for f, r in folder.finished().items() if f in frames}
    n_resumed = len(results)
    spent_s = float(folder.read_run().get("seconds", 0.0)) if n_resumed else 0.0

    def report(status: str) -> None:
        ordered = [results[f] for f in frames if f in results]
        facts = {"version": verefine_viz.__version__, "status": status, "title": session.title}
        when = {"begun": begun.isoformat(timespec="seconds"), "seconds": spent_s + time.perf_counter() - started}
        made_by = {"workers": n_workers, "machine": machine(), "packages": package_versions()}
        folder.write_json(RUN_FILE, {**facts, **when, "totals": totals(ordered, len(frames)), **made_by})
        if status != "running":
            folder.write("frames.csv", frames_csv(ordered))
            _write_results(folder.path / "results.csv", ordered)

    status = "stopped"
    try:
        report("running")
        progress(None, n_resumed, len(frames))
        missing = [f for f in frames if f not in results]
        for result in pool.solve(missing):
            results[result.frame] = result
            folder.keep(result)
            progress(result, len(results), len(frames))
        status = "finished"
    finally:
        report(status)
    ordered = tuple(results[f] for f in frames)
    return Outcome(folder.path, ordered, n_resumed, time.perf_counter() - started)


def totals(results: Sequence[FrameResult], n_frames: int) -> dict[str, Any]:
    """What a whole batch came to."""
    rows = [row for result in results for row in result.objects if row.status != "failed"]
    answered = [row for row in rows if row.status == "ok"]
    correct = [row.is_correct for row in answered if row.is_correct is not None]
    return {
        "frames": n_frames,
        "frames_done": len(results),
        "frames_failed": sum(r.failed for r in results),
        "objects": len(rows),
        "objects_without_answer": len(rows) - len(answered),
        "median_score": _median(row.score for row in answered),
        "median_add_s_mm": _median(row.add_s_mm for row in answered),
        "correct_share": sum(correct) / len(correct) if correct else None,
        "median_ms_per_object": _median(row.ms_total for row in answered),
    }


def _median(values: Iterable[float | None]) -> float | None:
    known = [v for v in values if v is not None]
    return float(np.median(known)) if known else None


def _write_results(path: Path, results: Sequence[FrameResult]) -> None:
    rows: list[ResultRow] = []
    for result in results:
        scene_id, im_id = frame_ids(result.frame)
        for e in result.estimates:
            T_cam_obj = np.array(e.T_cam_obj).reshape(4, 4)
            rows.append(ResultRow(scene_id, im_id, e.obj_id, e.score, T_cam_obj, round(result.seconds, 3)))
    try:
        write_results(path, rows)
    except OSError as error:
        raise InputError(f"cannot write {path}: {error.strerror}") from None
