"""What a batch says while it works."""

from __future__ import annotations

import io

import pytest

from tests.batch.test_totals import counted
from verefine_viz.batch.progress import BatchProgress
from verefine_viz.batch.run_batch import BatchStatus
from verefine_viz.batch.totals import BatchCounts
from verefine_viz.core import console
from verefine_viz.core.console import Terminal


def test_a_log_has_frames_of_all_runs_recall_failures_and_each_note_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(console, "EVERY_S", -1.0)
    text = io.StringIO()
    progress = BatchProgress(200, Terminal(file=text))
    for title in ("run 1", "run 2"):
        with progress.run(title) as report:
            report(BatchStatus(BatchCounts(), 100, doing="Compiling."))
            report(BatchStatus(counted(), 100, "too little memory"))
    first, doing, later, note, second, _, last = text.getvalue().splitlines()
    assert (first, second) == ("run 1, 0/200", "run 2, 100/200")
    assert (doing, note) == ("Compiling.", "note: too little memory")
    assert later == "run 1, 5/200, recall 50%, 1 failed"
    assert last.startswith("run 2, 105/200, ")
    assert last.endswith(", recall 50%, 1 failed")


@pytest.mark.parametrize(
    ("counts", "said"),
    [
        (BatchCounts(), ""),
        (counted(), "run: stopped after 5 of 100 frames, recall 50%, 1 failed; the same command goes on\n"),
    ],
)
def test_ctrl_c_says_how_far_it_came(counts: BatchCounts, said: str) -> None:
    text = io.StringIO()
    with pytest.raises(KeyboardInterrupt), BatchProgress(console=Terminal(file=text)).run("run") as report:
        report(BatchStatus(counts, 100))
        raise KeyboardInterrupt
    assert text.getvalue() == said
