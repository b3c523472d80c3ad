"""Many runs in a few lines: a row for those that differ only in their seeds."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from rich.markup import escape
from rich.table import Table

from verefine_viz.batch.jobs import Job
from verefine_viz.batch.runner import Outcome

OF_THE_METHOD = ("start", "iterate")
"""Stages that are the method's own; the others read, record and explain."""


def sweep_table(outcomes: Sequence[tuple[Job, Outcome]]) -> Table:
    """The table; best recall first, without ground truth best score."""
    groups: dict[str, list[dict[str, Any]]] = {}
    for job, outcome in outcomes:
        groups.setdefault(job.group, []).append(outcome.totals)
    rows = [(name, _numbers(totals)) for name, totals in groups.items()]
    has_truth = any(row["recall"] is not None for _, row in rows)
    rows.sort(key=lambda row: -(row[1]["recall" if has_truth else "score"] or 0.0))
    table = Table(box=None, pad_edge=False, header_style="bold")
    table.add_column("run" if all(row["runs"] == 1 for _, row in rows) else "runs of")
    for head in ("seeds", "right", "by seed", "median mm", "score", "ms a frame"):
        table.add_column(head, justify="right")
    for name, row in rows:
        low, high = row["ends"]
        table.add_row(
            escape(name),
            str(row["runs"]),
            _shown(row["recall"], "{:.1%}"),
            "" if low is None or row["runs"] == 1 else f"{low:.0%} to {high:.0%}",
            _shown(row["median_mm"], "{:.1f}"),
            _shown(row["score"], "{:.3f}"),
            _shown(row["ms"], "{:.0f}"),
        )
    return table


def _numbers(totals: Sequence[dict[str, Any]]) -> dict[str, Any]:
    recalls = [(t["recall"], t["objects_with_truth"]) for t in totals if t["recall"] is not None]
    n = sum(n for _, n in recalls)
    stages = [t["mean_stages_ms_per_frame"] for t in totals if t["mean_stages_ms_per_frame"]]
    return {
        "runs": len(totals),
        "recall": sum(recall * m for recall, m in recalls) / n if n else None,
        "ends": (min(r for r, _ in recalls), max(r for r, _ in recalls)) if recalls else (None, None),
        "median_mm": _median([t["median_add_s_mm"] for t in totals]),
        "score": _median([t["median_score"] for t in totals]),
        "ms": _median([sum(mine.get(stage, 0.0) for stage in OF_THE_METHOD) for mine in stages]),
    }


def _median(values: Sequence[float | None]) -> float | None:
    """Of the runs' numbers: one slow start does not count."""
    known = [value for value in values if value is not None]
    return float(np.median(known)) if known else None


def _shown(value: float | None, form: str) -> str:
    return "–" if value is None else form.format(value)
