"""Many runs in a few lines: a row for those that differ only in their seeds, in the report's numbers."""

from __future__ import annotations

from array import array
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from rich.markup import escape
from rich.table import Table

from verefine_viz.batch.index import read_batch
from verefine_viz.batch.jobs import Job
from verefine_viz.batch.rows import ObjectRow
from verefine_viz.batch.runner import Outcome


@dataclass(frozen=True)
class SweepRow:
    """Runs that differ only in their seeds, all objects of all runs together. None = nobody can say."""

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


def sweep_table(outcomes: Sequence[tuple[Job, Outcome]]) -> Table:
    """The table; best recall first, without ground truth best score.

    Raises:
        InputError: what a run left behind is damaged.
    """
    groups: dict[str, list[Outcome]] = {}
    for job, outcome in outcomes:
        groups.setdefault(job.group, []).append(outcome)
    rows = [(name, sweep_row(read_batch(outcome.folder).rows for outcome in mine)) for name, mine in groups.items()]
    has_truth = any(row.recall is not None for _, row in rows)
    rows.sort(key=lambda row: -((row[1].recall if has_truth else row[1].score) or 0.0))
    table = Table(box=None, pad_edge=False, header_style="bold")
    table.add_column("run" if all(row.n_runs == 1 for _, row in rows) else "runs of")
    for head in ("seeds", "right", "by seed", "median mm", "score", "iterations ms"):
        table.add_column(head, justify="right")
    for name, row in rows:
        table.add_row(
            escape(name),
            str(row.n_runs),
            _shown(row.recall, "{:.1%}"),
            "" if row.ends is None or row.n_runs == 1 else "{:.0%} to {:.0%}".format(*row.ends),
            _shown(row.median_mm, "{:.1f}"),
            _shown(row.score, "{:.3f}"),
            _shown(row.ms_per_frame, "{:.0f}"),
        )
    return table


def sweep_row(runs: Iterable[Sequence[ObjectRow]]) -> SweepRow:
    """What the rows of some runs come to, one run after the other: only numbers of them are kept."""
    errors_mm, scores, frames_ms = array("d"), array("d"), array("d")
    counts: list[tuple[int, int]] = []
    for rows in runs:
        objects = [row for row in rows if row.is_object]
        truth = [row for row in objects if row.has_truth or row.add_s_mm is not None]
        counts.append((sum(row.is_correct is True for row in truth), len(truth)))
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
