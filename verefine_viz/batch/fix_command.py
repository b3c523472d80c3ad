"""What ``verefine-viz fix`` does: remedies tried as batches, their table, and the session with those chosen."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from verefine_viz.batch.batch_command import failed, solved_jobs
from verefine_viz.batch.fix_files import CSV_FILE, FixRow, FixTable, best_row, fix_folder, write_fix
from verefine_viz.batch.index import BatchIndex, find_runs, has_finished_frame, read_batch
from verefine_viz.batch.remedy_table import fix_table
from verefine_viz.batch.remedy_trials import (
    TOGETHER,
    Trial,
    changes_of,
    check_trials,
    jobs_of,
    remedied,
    trials_of,
)
from verefine_viz.batch.run_batch import Backend
from verefine_viz.batch.runs import RUN_FILE
from verefine_viz.core.console import PrintedTable, print_table
from verefine_viz.core.errors import InputError, unknown
from verefine_viz.core.remedies import Remedy
from verefine_viz.core.settings import Session
from verefine_viz.core.text_format import say
from verefine_viz.run.session_file import save_session


@dataclass(frozen=True, kw_only=True)
class FixRequest:
    """What is tried on which runs."""

    folder: Path
    """Folder of a batch, or of several."""
    out: Path | None = None
    """None: see :func:`fix_folder`."""
    seed: int = 0
    every: bool = False
    together: tuple[str, ...] = ()

    @property
    def target(self) -> Path:
        return self.out or fix_folder(self.folder)

    def runs(self) -> dict[str, BatchIndex]:
        """The runs by the names of their folders.

        Raises:
            InputError: there is none, or one is no batch.
        """
        folders = find_runs(self.folder).runs
        finished = [path for path in folders if has_finished_frame(path)]
        runs = {path.name: read_batch(path) for path in finished or folders}
        for index in runs.values():
            if not (index.folder / RUN_FILE).is_file():
                raise InputError(f"{index.folder} holds run files and no batch; make one with verefine-viz batch")
        return runs

    def trials(self, runs: Mapping[str, BatchIndex]) -> tuple[Trial, ...]:
        """What is tried; nothing where no remedy is known.

        Raises:
            SettingsError: a remedy is unknown, or two exclude each other.
        """
        return trials_of(runs, self.target, self.seed, self.every, self.together)

    def table(self, trials: Sequence[Trial], runs: Mapping[str, BatchIndex]) -> FixTable:
        """What the trials came to so far."""
        return fix_table(trials, runs, self.seed, self.every, self.together)


def run_fix(request: FixRequest, backend: Backend, write: Path | None, retry_failed: bool = False) -> int:
    """Tries remedies, prints their table, and writes the session with those that were chosen, else with the best one.

    Args:
        request: what is tried.
        backend: where.
        write: the session file; None = none.
        retry_failed: whether frames that failed with a remedy are tried again.

    Returns:
        The exit code: 0, or 1 where a frame failed.

    Raises:
        VerefineError: there is nothing to try, a folder cannot be used, or nothing gains anything.
    """
    runs = request.runs()
    trials = request.trials(runs)
    check_trials(trials, runs)
    outcomes = [outcome for _, outcome in solved_jobs([*jobs_of(trials)], backend, retry_failed, "solve")]
    table = request.table(trials, runs)
    write_fix(table, request.target)
    print_table(printed(table))
    n_failed = sum(outcome.n_failed for outcome in outcomes)
    if n_failed:
        say(failed(n_failed))
    say(f"Table in {request.target / CSV_FILE}")
    if write is not None:
        chosen = request.together or (best_row(table).remedy,)
        for path in write_sessions(chosen, trials, runs, write):
            say(f"{TOGETHER.join(chosen)}: session in {path}")
    return 0 if all(outcome.is_whole for outcome in outcomes) else 1


def printed(table: FixTable) -> PrintedTable:
    """The table for a terminal."""
    has_fit = any(row.judged_by == "fit" for row in table.rows)
    by_fit = ("fit better", "worse") if has_fit else ()
    headings = ("remedy", "cause", "came right", *by_fit, "broke", "net gain", "s/frame")
    rows = []
    for row in table.rows:
        gained, fit = f"{row.came_right} of {row.tried}", row.judged_by == "fit"
        numbers = [["", gained, str(row.worse)] if fit else [gained, "", ""], [gained]][not has_fit]
        rows.append((row.remedy, row.cause_words, *numbers, *_lost(row)))
    return PrintedTable("", headings, tuple(rows), n_words=2)


def _lost(row: FixRow) -> tuple[str, str, str]:
    seconds = "–" if row.seconds_added is None else f"{row.seconds_added:+.1f}"
    net = f"{row.net_gain:+.1f} ({row.net_low:+.1f} to {row.net_high:+.1f})"
    return f"{row.broke} of {row.right_tried}", net, seconds


def write_sessions(
    chosen: Sequence[str], trials: Sequence[Trial], runs: Mapping[str, BatchIndex], path: Path
) -> list[Path]:
    """Writes the session of each run with remedies that were tried: ``path``, of several runs ``STEM-RUN.toml``. Its
    first line says what was changed.

    Raises:
        VerefineError: they were not tried, or a file cannot be written.
    """
    trial = _trial_of(chosen, trials)
    mended = {name: remedied(index.session, trial.remedies) for name, index in runs.items()}
    written = list[Path]()
    for name, session in mended.items():
        if session is not None:
            file = path if len(runs) == 1 else path.with_name(f"{path.stem}-{name}{path.suffix or '.toml'}")
            save_session(session, file, _changes_line(runs[name].session, trial.remedies))
            written.append(file)
    return written


def _changes_line(session: Session, remedies: Sequence[Remedy]) -> str:
    """``# changed by fix: physics.enabled = false (was true)``, the comment that heads a session with some remedies."""
    changes = []
    for name, value in changes_of(session, remedies).items():
        section, _, field = name.partition(".")
        was = getattr(getattr(session, section), field)
        changes.append(f"{name} = {json.dumps(value)} (was {json.dumps(was)})")
    return f"# changed by fix: {', '.join(changes)}\n"


def _trial_of(chosen: Sequence[str], trials: Sequence[Trial]) -> Trial:
    """The trial of some remedies, named as a row has them or by their settings alone, in any order.

    Raises:
        InputError: they were not tried, or not together.
    """
    names = TOGETHER.join(chosen).split(TOGETHER)
    for trial in trials:
        if len(trial.remedies) == len(names) and all(
            any(name in (one.name, one.setting) for name in names) for one in trial.remedies
        ):
            return trial
    raise InputError(unknown("remedy", TOGETHER.join(names), tuple(trial.name for trial in trials)))
