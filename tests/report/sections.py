"""Sections of a report that no file holds."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from verefine_viz.batch.index import BatchIndex
from verefine_viz.batch.runs import BatchInfo
from verefine_viz.report.groups import Group, Section
from verefine_viz.run.record import Answer
from verefine_viz.run.session_file import resolve

WRONG = {"add_s_mm": 40.0}
NO_ANSWER = {"status": "no_answer", "add_s_mm": None, "score": None}


def run(folder: str, *rows: Answer, **settings: Any) -> BatchIndex:
    return BatchIndex(Path(folder), resolve({"title": "One of many", **settings}), BatchInfo(), rows)


def group(method: str, *rows_by_seed: tuple[Answer, ...]) -> Group:
    def of_seed(seed: int, rows: tuple[Answer, ...]) -> BatchIndex:
        settings = {"method": {"name": method, "seed": seed}, "hypotheses": {"seed": seed}}
        return run(f"{method}-{seed}", *rows, **settings)

    return Group(method, tuple(of_seed(seed, rows) for seed, rows in enumerate(rows_by_seed)))


def section_of(*groups: Group) -> Section:
    return Section("some data", groups)
