"""What ``verefine-viz batch`` does: one run or many, and what it prints on the way and when it is done."""

from __future__ import annotations

from array import array
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich.text import Text

from verefine_viz.batch.frame_work import FrameWork
from verefine_viz.batch.index import read_batch
from verefine_viz.batch.jobs import BatchJob, check_jobs
from verefine_viz.batch.motion_table import MOTION
from verefine_viz.batch.progress import BatchProgress
from verefine_viz.batch.run_batch import Backend, BatchOutcome, run_batch
from verefine_viz.batch.totals import Notes
from verefine_viz.batch.worker_pool import Pool
from verefine_viz.batch.worker_tasks import TaskName
from verefine_viz.core.causes import Cause, cause_title
from verefine_viz.core.console import PrintedTable, Terminal, print_table
from verefine_viz.core.text_format import say
from verefine_viz.run.record import Answer, RunRecord

MISSED = {
    "objects_without_answer": "without a hypothesis",
    "objects_left_out": "left out (frames.csv says why)",
    "objects_in_failed_frames": "in failed frames",
}
"""Why objects have no answer, by the total that counts them."""

MOST_TRACKS = 6
"""Objects of a sequence whose motion is printed."""


def run_jobs(
    jobs: Sequence[BatchJob], out: Path, backend: Backend, retry_failed: bool = False, task: TaskName = "explain"
) -> int:
    """Runs one job after the other, on this machine by the same workers.

    Returns:
        The exit code: 0, or 1 where a frame failed or was lost, or a file of an object could not be read.

    Raises:
        VerefineError: a session or a folder cannot be used, or the cluster does not answer.
    """
    if len(jobs) == 1:
        outcome = _run(jobs[0], jobs[0].folder.name, backend, retry_failed, task, None, BatchProgress())
        _print_summary(outcome)
        return 0 if outcome.is_whole else 1
    outcomes = list[tuple[BatchJob, BatchOutcome]]()
    for job, outcome in solved_jobs(jobs, backend, retry_failed, task):
        outcomes.append((job, outcome))
        _print_line(outcome)
    _print_all(outcomes, out)
    return 0 if all(outcome.is_whole for _, outcome in outcomes) else 1


def solved_jobs(
    jobs: Sequence[BatchJob], backend: Backend, retry_failed: bool = False, task: TaskName = "explain"
) -> Iterator[tuple[BatchJob, BatchOutcome]]:
    """Runs one job after the other, on this machine by the same workers, with their progress on the terminal.

    Raises:
        VerefineError: a session or a folder cannot be used, or the cluster does not answer.
    """
    n_frames, first = check_jobs(jobs), jobs[0]
    with ExitStack() as stack:
        pool = None
        if not backend.cluster:
            work = FrameWork(first.session, first.folder.absolute(), task)
            pool = Pool(work, backend.n_workers, backend.limit_bytes)
            stack.enter_context(closing(pool))
        progress = BatchProgress(n_frames)
        for k, job in enumerate(jobs):
            title = f"run {k + 1} of {len(jobs)}: {job.folder.name}"
            yield job, _run(job, title, backend, retry_failed, task, pool, progress)


def _print_all(outcomes: Sequence[tuple[BatchJob, BatchOutcome]], out: Path) -> None:
    print_table(sweep_table(outcomes))
    notes = Notes()
    for _, outcome in outcomes:
        notes.add(outcome.totals["notes"])
    for note, n in notes.counted().items():
        say(f"note ({n} run{'s' * (n > 1)}): {note}")
    n_failed = sum(outcome.n_failed for _, outcome in outcomes)
    if n_failed:
        say(failed(n_failed))
    n_unreadable = sum(outcome.n_unreadable for _, outcome in outcomes)
    if n_unreadable:
        say(unreadable(n_unreadable))
    say(f"Side by side: verefine-viz report {out}")


def _run(
    job: BatchJob,
    title: str,
    backend: Backend,
    retry_failed: bool,
    task: TaskName,
    pool: Pool[str, RunRecord] | None,
    progress: BatchProgress,
) -> BatchOutcome:
    if pool is not None:
        pool.switch_to(FrameWork(job.session, job.folder.absolute(), task))
    with progress.run(title) as report:
        return run_batch(job.session, job.folder, backend, report, retry_failed, task, pool)


def _print_line(outcome: BatchOutcome) -> None:
    took = "nothing was left to do" if outcome.was_finished else f"{outcome.seconds:.1f} s"
    say(f"{outcome.folder.name}: {brief(outcome)}; {took}")
    _print_doubt(outcome)
    _print_failures(outcome)
    _print_written(outcome)


def _print_summary(outcome: BatchOutcome) -> None:
    numbers = outcome.totals
    took = "nothing was left to do" if outcome.was_finished else f"{outcome.seconds:.1f} s, memory {outcome.memory}"
    say(f"{brief(outcome)}; {took}. Results in {outcome.folder}")
    _print_doubt(outcome)
    for track in outcome.motion[:MOST_TRACKS]:
        say(f"motion of {track.text}")
    if len(outcome.motion) > MOST_TRACKS:
        say(f"… and {len(outcome.motion) - MOST_TRACKS} more objects, see {MOTION}")
    # How many have no hypothesis is in the line above, and why in a note below.
    causes = {cause: n for cause, n in numbers["causes"].items() if cause != Cause.NO_HYPOTHESIS}
    if causes:
        say("causes: " + ", ".join(f"{cause_title(cause)} {n}" for cause, n in causes.items()))
    for note, n in numbers["notes"].items():
        say(f"note ({n} frame{'s' * (n > 1)}): {note}")
    _print_failures(outcome)
    if outcome.n_failed:
        say("The same command with --retry-failed tries them again.")
    if outcome.n_unreadable:
        say(unreadable(outcome.n_unreadable))
    _print_written(outcome)


def failed(n: int) -> str:
    """A sentence on ``n`` frames that failed: what to do."""
    who, whom = ("1 frame", "it") if n == 1 else (f"{n} frames", "them")
    return f"{who} failed; the same command with --retry-failed tries {whom} again."


def unreadable(n: int, which: str = "frames.csv says which") -> str:
    """A sentence on ``n`` objects whose files cannot be read: ``which`` they are, and what to do."""
    who, whose = ("1 object was", "its frame") if n == 1 else (f"{n} objects were", "their frames")
    return (
        f"{who} not solved, as a model or mask is missing or damaged ({which}); mend it, and the same "
        f"command with --retry-failed solves {whose} again."
    )


def _print_doubt(outcome: BatchOutcome) -> None:
    if outcome.totals["data_in_doubt"]:
        Terminal().print(Text(outcome.totals["data_in_doubt"], "red"))


def brief(outcome: BatchOutcome) -> str:
    """``8 frames, 28 objects, 1 left out, median ADD(-S) 2.2 mm of 27 answers, 24 of 28 right (86 %)``."""
    numbers = outcome.totals
    parts = [
        f"{numbers['frames']} frame{'s' * (numbers['frames'] != 1)}"
        + (f" ({outcome.n_resumed} done before)" if outcome.n_resumed else ""),
        f"{numbers['objects']} object{'s' * (numbers['objects'] != 1)}",
    ]
    parts += [f"{numbers[key]} {why}" for key, why in MISSED.items() if numbers[key]]
    if numbers["median_add_s_mm"] is not None:
        n = numbers["answers_with_truth"]
        parts.append(f"median ADD(-S) {numbers['median_add_s_mm']:.1f} mm of {n} answer{'s' * (n != 1)}")
    if numbers["recall"] is not None:
        right = f"{numbers['objects_correct']} of {numbers['objects_with_truth']} right"
        parts.append(f"{right} ({numbers['recall']:.0%}; ADD(-S) below 10 % of the diameter)")
    elif numbers["median_score"] is not None:
        parts.append(f"median score {numbers['median_score']:.3f}")
    return ", ".join(parts)


def _print_written(outcome: BatchOutcome) -> None:
    for note in outcome.notes:
        say(f"note: {note}")
    for fault in outcome.faults:
        Terminal().print(Text(fault, "red"))


def _print_failures(outcome: BatchOutcome) -> None:
    for frame, why in outcome.failures:
        say(f"frame {frame} failed: {why}")
    n_more = outcome.n_failed - len(outcome.failures)
    if n_more:
        say(f"… and {n_more} more, see frames.csv")


@dataclass(frozen=True)
class SweepRow:
    """Runs that differ only in their seeds, all objects of all runs together. None = unknown."""

    n_runs: int
    recall: float | None
    """Share of the objects with ground truth whose ADD(-S) is below 10 % of the diameter."""
    ends: tuple[float, float] | None
    """Lowest and highest recall of a run."""
    median_mm: float | None
    """ADD(-S), over the objects that got an answer."""
    score: float | None
    """Mean, of the answers."""
    ms_per_frame: float | None
    """The iterations of a frame's objects: median over the frames, as the first one of a worker may compile."""


def sweep_table(outcomes: Sequence[tuple[BatchJob, BatchOutcome]]) -> PrintedTable:
    """A row for the runs that differ only in their seeds; best recall first, without ground truth best score.

    Raises:
        InputError: a file of a run is damaged.
    """
    groups: dict[str, list[BatchOutcome]] = {}
    for job, outcome in outcomes:
        groups.setdefault(job.group, []).append(outcome)
    rows = [(name, sweep_row(read_batch(outcome.folder).rows for outcome in mine)) for name, mine in groups.items()]
    has_recall = any(row.recall is not None for _, row in rows)
    rows.sort(key=lambda row: -((row[1].recall if has_recall else row[1].score) or 0.0))
    first = "run" if all(row.n_runs == 1 for _, row in rows) else "runs of"
    headings = (first, "seeds", "right", "by seed", "median mm", "score", "iterations ms")
    return PrintedTable("", headings, tuple((name, *_cells(row)) for name, row in rows))


def _cells(row: SweepRow) -> tuple[str, ...]:
    return (
        str(row.n_runs),
        _shown(row.recall, "{:.1%}"),
        "" if row.ends is None or row.n_runs == 1 else "{:.0%} to {:.0%}".format(*row.ends),
        _shown(row.median_mm, "{:.1f}"),
        _shown(row.score, "{:.3f}"),
        _shown(row.ms_per_frame, "{:.0f}"),
    )


def sweep_row(runs: Iterable[Sequence[Answer]]) -> SweepRow:
    """Summarises the rows of some runs, read one run after the other: only their numbers stay in memory."""
    errors_mm, scores, frames_ms = array("d"), array("d"), array("d")
    counts: list[tuple[int, int]] = []
    for rows in runs:
        objects = [row for row in rows if row.is_object]
        with_truth = [row for row in objects if row.can_be_right]
        counts.append((sum(row.is_correct is True for row in with_truth), len(with_truth)))
        solved = [row for row in objects if row.status == "ok"]
        errors_mm.extend(row.add_s_mm for row in solved if row.add_s_mm is not None)
        scores.extend(row.score for row in solved if row.score is not None)
        by_frame: dict[str, float] = {}
        for row in objects:
            if row.status != "failed":
                by_frame[row.frame] = by_frame.get(row.frame, 0.0) + row.ms_total
        frames_ms.extend(by_frame.values())
    n = sum(m for _, m in counts)
    recalls = [right / m for right, m in counts if m]
    return SweepRow(
        n_runs=len(counts),
        recall=sum(right for right, _ in counts) / n if n else None,
        ends=(min(recalls), max(recalls)) if recalls else None,
        median_mm=float(np.median(errors_mm)) if errors_mm else None,
        score=float(np.mean(scores)) if scores else None,
        ms_per_frame=float(np.median(frames_ms)) if frames_ms else None,
    )


def _shown(value: float | None, form: str) -> str:
    return "–" if value is None else form.format(value)
