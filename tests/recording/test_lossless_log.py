"""What the journal gives back is what would have been drawn."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.fakes import box_problem
from tests.methods.test_physim_mcts import method_of
from tests.recording.runs import new_run, session
from verefine_viz.methods.registry import METHOD_NAMES
from verefine_viz.recording.lossless_log import Entry, Journal, as_recorded, read_journal
from verefine_viz.recording.verify import first_difference
from verefine_viz.run.engine import Run


@pytest.mark.parametrize("name", [*METHOD_NAMES, "physim_mcts"])
def test_entries_come_back_as_they_were(tmp_path: Path, name: str) -> None:
    problem = box_problem(3, 2)
    run = Run(method_of(problem), problem) if name == "physim_mcts" else new_run(session(name, iterations=3), problem)
    run.finish()
    rng, path = np.random.default_rng(0), tmp_path / "a.journal"
    entries = [Entry(iteration, rng.normal(size=3)) for iteration in run.iterations]
    journal = Journal(path, {"title": "µ"})
    for entry in entries:
        journal.append(entry)
    journal.close()
    about, found = read_journal(path)
    assert about == {"title": "µ"}
    for back, entry in zip(found, entries, strict=True):
        assert back.packed == entry.packed
        np.testing.assert_array_equal(back.errors, entry.errors)
        assert first_difference(back.iteration, as_recorded(entry.iteration)) is None
        assert [s.ms for s in back.iteration.stages] == [s.ms for s in entry.iteration.stages]
