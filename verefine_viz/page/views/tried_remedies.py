"""Remedies that were tried on the runs of a gallery: their table, and the answers before and after."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from verefine_viz.batch.fix_files import EVERY_CAUSE, FixAnswer, FixRow, FixTable
from verefine_viz.batch.runs import Runs
from verefine_viz.page.gallery_messages import FixedAnswer, FixLine, FixMessage, FixShown

if TYPE_CHECKING:
    from verefine_viz.batch.fix_thread import FixState
    from verefine_viz.page.gallery import Gallery

AnswerKey = tuple[str, str, int | None]
"""Name of the run's folder, frame, instance."""


def fix_message(gallery: Gallery, state: FixState, target: Path) -> FixMessage:
    """Return the progress of the remedies being tried, and their table once it exists; ``target`` holds their
    batches.
    """
    table = None if state.table is None else fix_shown(state.table, keys_of(gallery), target)
    return FixMessage(state.is_running, state.done, state.total, state.fault, table)


def keys_of(gallery: Gallery) -> dict[AnswerKey, int]:
    """Return the indices of answers in a gallery."""
    return {
        (gallery.runs[entry.run].folder.name, entry.row.frame, entry.row.instance_id): key
        for key, entry in enumerate(gallery.entries)
    }


def fix_shown(table: FixTable, keys: Mapping[AnswerKey, int], target: Path | None) -> FixShown:
    """Return a table for the page; without ``target``, its batches are not opened."""
    return FixShown([_line(row, table) for row in table.rows], [_answer(one, keys, target) for one in table.answers])


def _line(row: FixRow, table: FixTable) -> FixLine:
    fit = row.judged_by == "fit"
    shown = [
        k
        for k, one in enumerate(table.answers)
        if one.remedy == row.remedy
        and one.by_truth != fit
        and (not one.was_bad or row.cause in (one.cause, EVERY_CAUSE))
    ]
    return FixLine(
        remedy=row.remedy,
        cause=row.cause_words,
        fit=fit,
        tried=row.tried,
        came_right=row.came_right,
        worse=row.worse,
        right_tried=row.right_tried,
        broke=row.broke,
        right_known=row.right_known,
        net=(row.net_gain, row.net_low, row.net_high),
        seconds=row.seconds_added,
        answers=shown,
    )


def _answer(one: FixAnswer, keys: Mapping[AnswerKey, int], target: Path | None) -> FixedAnswer:
    change: Literal[-1, 0, 1] = 1 if one.change > 0 else -1 if one.change < 0 else 0
    return FixedAnswer(
        key=keys.get((one.run, one.frame, one.instance_id)),
        name=one.name,
        frame=one.frame,
        was_bad=one.was_bad,
        change=change,
        errors=one.errors_mm,
        scores=one.scores,
        recording="" if target is None else str(Runs(target / one.folder / "runs").path(one.frame)),
    )
