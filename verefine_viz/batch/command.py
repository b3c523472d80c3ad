"""What ``verefine-viz batch`` shows while it works and when it is done."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from verefine_viz.batch.rows import FrameResult
from verefine_viz.batch.runner import Outcome, check, run_batch, totals
from verefine_viz.core.errors import SettingsError
from verefine_viz.core.settings import Session
from verefine_viz.session.files import load_session

SHOWN_FAILURES = 10


def run_sessions(paths: Sequence[Path], out: Path, n_workers: int, overrides: Mapping[str, Any]) -> int:
    """Runs each session; the exit code: 0, or 1 where frames failed.

    Raises:
        VerefineError: a session or ``out`` cannot be used.
    """
    jobs = folders(paths, out)
    sessions = {path: load_session(path, overrides) for path in jobs}
    if len(sessions) > 1:
        # A mistake in the last of several sessions should not show after hours.
        for session in sessions.values():
            check(session)
    outcomes = [_run(sessions[path], folder, n_workers) for path, folder in jobs.items()]
    return 1 if any(outcome.failed for outcome in outcomes) else 0


def folders(paths: Sequence[Path], out: Path) -> dict[Path, Path]:
    """The output folder of each session: ``out`` itself for one, ``out/NAME`` for several.

    Raises:
        SettingsError: two sessions would write to the same folder.
    """
    if len(paths) == 1:
        return {paths[0]: out}
    stems = [path.stem for path in paths]
    for stem in stems:
        if stems.count(stem) > 1:
            raise SettingsError(f"two sessions are called {stem!r} and would share {out / stem}; rename one")
    return {path: out / path.stem for path in paths}


def _run(session: Session, out: Path, n_workers: int) -> Outcome:
    errors = Console(stderr=True)
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[note]}"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=errors, transient=True, disable=not errors.is_terminal) as bar:
        task = bar.add_task(escape(out.name), total=None, note="starting")
        n_failed = 0

        def progress(result: FrameResult | None, done: int, n_frames: int) -> None:
            nonlocal n_failed
            n_failed += bool(result and result.failed)
            bar.update(task, completed=done, total=n_frames, note=f"{n_failed} failed" if n_failed else "")

        outcome = run_batch(session, out, n_workers, progress)
    _print_summary(outcome)
    return outcome


def _print_summary(outcome: Outcome) -> None:
    console = Console(highlight=False, soft_wrap=True)
    numbers = totals(outcome.results, len(outcome.results))
    parts = [
        f"{numbers['frames']} frames" + (f" ({outcome.n_resumed} done before)" if outcome.n_resumed else ""),
        f"{numbers['objects']} objects",
    ]
    if numbers["objects_without_answer"]:
        parts.append(f"{numbers['objects_without_answer']} without a hypothesis")
    if numbers["median_add_s_mm"] is not None:
        parts.append(f"median ADD(-S) {numbers['median_add_s_mm']:.1f} mm")
        parts.append(f"{numbers['correct_share']:.0%} below 10 % of the diameter")
    elif numbers["median_score"] is not None:
        parts.append(f"median score {numbers['median_score']:.3f}")
    console.print(f"{', '.join(parts)}; {outcome.seconds:.1f} s. Results in {escape(str(outcome.folder))}")
    for result in outcome.failed[:SHOWN_FAILURES]:
        console.print(f"frame {result.frame} failed: {escape(result.objects[0].message)}")
    if len(outcome.failed) > SHOWN_FAILURES:
        console.print(f"… and {len(outcome.failed) - SHOWN_FAILURES} more, see frames.csv")
