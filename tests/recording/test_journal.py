"""What the journal gives back is what would have been drawn."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from tests.fakes import box_problem
from tests.methods.test_physim_mcts import method_of
from tests.recording.runs import new_run, session
from verefine_viz.core.compare import first_difference
from verefine_viz.methods.registry import METHOD_NAMES
from verefine_viz.recording.entry import Entry
from verefine_viz.recording.journal import Journal, read_journal
from verefine_viz.recording.row import rows_of
from verefine_viz.session.engine import Run


@pytest.mark.parametrize("name", [*METHOD_NAMES, "physim_mcts"])
def test_entries_come_back_as_rows(tmp_path: Path, name: str) -> None:
    problem = box_problem(3, 2)
    run = Run(method_of(problem), problem) if name == "physim_mcts" else new_run(session(name, iterations=3), problem)
    run.finish()
    rng, path = np.random.default_rng(0), tmp_path / "a.journal"
    entries = [Entry.of(iteration, rng.normal(size=3)) for iteration in run.iterations]
    expected = rows_of(entries)
    journal = Journal(path, {"title": "µ"})
    for entry in entries:
        journal.append(entry)
    journal.close()
    about, rows = read_journal(path)
    assert about == {"title": "µ"}
    assert first_difference(rows, tuple(expected)) is None
    for row, other in zip(rows, expected, strict=True):
        np.testing.assert_array_equal(row.ms, other.ms)
        for field in fields(row):
            ours, theirs = getattr(row, field.name), getattr(other, field.name)
            if isinstance(theirs, np.ndarray):
                assert (ours.dtype, ours.shape) == (theirs.dtype, theirs.shape), field.name
