"""docs/tables.md says what every column, cause and event means."""

from __future__ import annotations

import re
from pathlib import Path
from typing import get_args

from verefine_viz.batch.rows import ObjectRow, Status
from verefine_viz.core.records import EventKind
from verefine_viz.diagnosis.causes import TITLES, Cause

PAGE = (Path(__file__).resolve().parents[2] / "docs" / "tables.md").read_text("utf-8")


def rows_of(heading: str) -> dict[str, list[str]]:
    """The table below a heading: its rows by the name in their first cell."""
    section = PAGE.split(f"\n## {heading}\n")[1].split("\n## ")[0]
    lines = [re.split(r"\s*\|\s*", line.strip("| ")) for line in section.splitlines() if line.startswith("| `")]
    return {cells[0].strip("`"): cells[1:] for cells in lines}


def test_every_column_is_defined_in_the_order_of_the_table() -> None:
    columns = rows_of("frames.csv")
    assert list(columns) == list(ObjectRow.model_fields)
    assert all(len(said) == 1 and len(said[0]) > 5 for said in columns.values())
    for status in get_args(Status):
        assert f"`{status}`: " in columns["status"][0]


def test_every_cause_is_defined_under_its_title() -> None:
    causes = rows_of("Causes")
    assert list(causes) == list(Cause)
    assert {name: said[0] for name, said in causes.items()} == {str(cause): title for cause, title in TITLES.items()}
    assert all(len(said) == 3 for said in causes.values())


def test_every_event_is_defined() -> None:
    assert set(rows_of("Events")) == set(get_args(EventKind))
