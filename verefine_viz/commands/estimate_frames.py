"""What ``verefine-viz estimate`` does: run a session's estimator over its frames and write its poses."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

from msgspec import structs

from verefine_viz.batch.batch_command import unreadable
from verefine_viz.batch.index import read_batch
from verefine_viz.batch.jobs import check_outside
from verefine_viz.batch.progress import BatchProgress
from verefine_viz.batch.run_batch import Backend, BatchOutcome, run_batch
from verefine_viz.core.algorithm_settings import DependencySettings
from verefine_viz.core.errors import SettingsError
from verefine_viz.core.settings import Session
from verefine_viz.core.text_format import say
from verefine_viz.core.writing import atomic, check_file, check_no_link, clear_parts
from verefine_viz.estimators.registry import ESTIMATORS
from verefine_viz.run.data_folder import open_session
from verefine_viz.run.record import Answer

WITHOUT_POSE = ("left_out", "no_answer")
"""Status of objects without a pose, those that can be mended first."""
MOST_SHOWN = 10
"""Objects without a pose that are named; the others are counted."""


def write_pools(
    path: Path, out: Path, overrides: Mapping[str, Any], n_workers: int = 1, retry_failed: bool = False
) -> int:
    """Estimate every frame of the session at ``path`` into the results file ``out``; return the exit code.

    Frames that fail and objects whose files cannot be read are listed and make it 1; the others are written. Without a
    hypothesis in any frame there is nothing to write. Beside ``out`` lies a journal while something is missing,
    so that the next start goes on.

    Raises:
        VerefineError: the session or ``out`` cannot be used.
    """
    session = _only_estimating(open_session(path, overrides, partial(say, to=sys.stderr)))
    if session.hypotheses.source not in ESTIMATORS:
        raise SettingsError(
            f"hypotheses.source is {session.hypotheses.source!r}, expected an estimator ({', '.join(ESTIMATORS)}); "
            "use --hypotheses.source ppf"
        )
    check_file(out, "pool.csv")
    check_outside(out, session)
    clear_parts(out.parent, out.name)
    journal = out.with_name(f"{out.name}.journal")
    check_no_link(journal)
    with BatchProgress().run(out.name) as report:
        outcome = run_batch(session, journal, Backend(n_workers), report, retry_failed, "estimate")
    rows = read_batch(journal).rows
    n_hypotheses = sum(row.n_hypotheses for row in rows)
    if n_hypotheses:
        with atomic(out) as part:
            shutil.copyfile(journal / "results.csv", part)
    lacking = sorted(
        (row for row in rows if row.status in WITHOUT_POSE), key=lambda row: WITHOUT_POSE.index(row.status)
    )
    _print_summary(outcome, n_hypotheses, lacking, out)
    if outcome.is_whole:
        shutil.rmtree(journal)
    return 0 if outcome.is_whole and n_hypotheses else 1


def _only_estimating(session: Session) -> Session:
    """The session without settings that estimators do not need and that could fail: simulator, order, tracking."""
    physics = structs.replace(session.physics, enabled=False)
    method = structs.replace(session.method, track=False)
    return structs.replace(session, physics=physics, dependency=DependencySettings(), method=method)


def _print_summary(outcome: BatchOutcome, n_hypotheses: int, lacking: list[Answer], out: Path) -> None:
    numbers = outcome.totals
    before = f" ({outcome.n_resumed} done before)" if outcome.n_resumed else ""
    counts = f"{numbers['frames']} frames{before}, {numbers['objects']} objects, {n_hypotheses} hypotheses"
    where = f"Results in {out}" if n_hypotheses else f"No pose was found, so {out} was not written"
    say(f"{counts}; {outcome.seconds:.1f} s. {where}")
    for row in lacking[:MOST_SHOWN]:
        number = "" if row.instance_id is None else f" (#{row.instance_id})"
        why = f", {row.message}" if row.status == "left_out" else ""
        say(f"frame {row.frame}: no hypothesis for {row.name}{number}{why}")
    if len(lacking) > MOST_SHOWN:
        say(f"… and {len(lacking) - MOST_SHOWN} more objects without a hypothesis")
    for frame, why in outcome.failures:
        say(f"frame {frame} failed: {why}")
    if outcome.n_failed:
        say(f"{outcome.n_failed} failed; the same command with --retry-failed tries them again.")
    if outcome.n_unreadable:
        say(unreadable(outcome.n_unreadable, "see above"))
    for line in (*outcome.notes, *outcome.faults):
        say(line)
