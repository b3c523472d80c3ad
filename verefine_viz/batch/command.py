"""What ``verefine-viz batch`` does with several sessions, and what it says when it is done."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.markup import escape

from verefine_viz.batch.progress import shown_progress
from verefine_viz.batch.runner import Outcome, Place, check, run_batch
from verefine_viz.batch.tasks import TaskName
from verefine_viz.core.errors import SettingsError
from verefine_viz.core.settings import Session
from verefine_viz.session.files import load_session


def run_sessions(
    paths: Sequence[Path],
    out: Path,
    place: Place,
    overrides: Mapping[str, Any],
    retry_failed: bool = False,
    task: TaskName = "explain",
) -> int:
    """Runs each session; the exit code: 0, or 1 where frames failed.

    Raises:
        VerefineError: a session or ``out`` cannot be used, or the cluster does not answer.
    """
    jobs = folders(paths, out)
    sessions = {path: load_session(path, overrides) for path in jobs}
    if len(sessions) > 1:
        # A mistake in the last of several sessions should not show after hours.
        for session in sessions.values():
            check(session)
    outcomes = [_run(sessions[path], folder, place, retry_failed, task) for path, folder in jobs.items()]
    return 1 if any(outcome.n_failed for outcome in outcomes) else 0


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


def _run(session: Session, out: Path, place: Place, retry_failed: bool, task: TaskName) -> Outcome:
    with shown_progress(out.name, Console(stderr=True)) as tell:
        outcome = run_batch(session, out, place, tell, retry_failed, task)
    _print_summary(outcome)
    return outcome


def _print_summary(outcome: Outcome) -> None:
    console = Console(highlight=False, soft_wrap=True)
    numbers = outcome.totals
    parts = [
        f"{numbers['frames']} frames" + (f" ({outcome.n_resumed} done before)" if outcome.n_resumed else ""),
        f"{numbers['objects']} objects",
    ]
    if numbers["objects_without_answer"]:
        parts.append(f"{numbers['objects_without_answer']} without a hypothesis")
    if numbers["median_add_s_mm"] is not None:
        parts.append(f"median ADD(-S) {numbers['median_add_s_mm']:.1f} mm")
        if numbers["recall"] is not None:
            parts.append(f"{numbers['recall']:.0%} below 10 % of the diameter")
    elif numbers["median_score"] is not None:
        parts.append(f"median score {numbers['median_score']:.3f}")
    took = f"{outcome.seconds:.1f} s, memory {outcome.memory}"
    console.print(escape(f"{', '.join(parts)}; {took}. Results in {outcome.folder}"))
    if numbers["causes"]:
        console.print("causes: " + ", ".join(f"{cause} {n}" for cause, n in numbers["causes"].items()))
    for note, n in numbers["notes"].items():
        console.print(escape(f"note ({n} frame{'s' * (n > 1)}): {note}"))
    for frame, why in outcome.failures:
        console.print(escape(f"frame {frame} failed: {why}"))
    n_more = outcome.n_failed - len(outcome.failures)
    if n_more:
        console.print(f"… and {n_more} more, see frames.csv")
    if outcome.n_failed:
        console.print("The same command with --retry-failed tries them again.")
