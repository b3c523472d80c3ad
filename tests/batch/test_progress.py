"""What a batch counts, and what it says while it works."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path

import pytest

from tests.made_runs import answer, finished
from verefine_viz.batch.batch_command import brief
from verefine_viz.batch.progress import BatchProgress
from verefine_viz.batch.run_batch import BatchOutcome, BatchStatus
from verefine_viz.batch.totals import BatchCounts, Totals
from verefine_viz.core import console
from verefine_viz.core.console import Terminal
from verefine_viz.core.problem import LeftOut
from verefine_viz.core.settings import Session
from verefine_viz.run.record import RunEnd, RunRecord
from verefine_viz.run.run_header import failed_run


def solved(im_id: int, add_s_mm: float | None, status: str = "ok") -> RunRecord:
    row = answer(0, im_id, status=status, add_s_mm=add_s_mm, diameter_mm=100.0, score=0.5, has_truth=True)
    return finished(f"0/{im_id}", [row], seconds=1.0, stages_ms={"read": 2.0})


def failed(frame: str, objects: Sequence[LeftOut] = ()) -> RunRecord:
    return failed_run(Session(), {}, frame, "no depth", objects)


def end_of(record: RunRecord) -> RunEnd:
    assert record.end is not None
    return record.end


RESULTS = [
    solved(0, 5.0),
    solved(1, 50.0),
    solved(2, None, "no_answer"),
    failed("0/3"),
    solved(4, 1.0),
]


def counted() -> BatchCounts:
    counts = BatchCounts()
    for result in RESULTS:
        counts.add(end_of(result))
    return counts


def test_objects_without_an_answer_left_out_or_in_failed_frames_are_missed() -> None:
    counts = counted()
    assert counts.recall == 2 / 4
    assert (counts.frames_done, counts.frames_failed, counts.objects_without_answer) == (5, 1, 1)
    objects = [LeftOut(k, 5, "mug", "its mask is missing", has_truth=True) for k in range(3)]
    counts.add(end_of(failed("0/5", objects)))
    counts.add(end_of(solved(6, None, "left_out")))
    assert (counts.objects, counts.objects_with_truth, counts.objects_correct) == (8, 8, 2)
    assert (counts.objects_in_failed_frames, counts.objects_left_out, counts.answers_with_truth) == (3, 1, 3)
    assert counts.recall == 2 / 8


def test_the_summary_adds_up(tmp_path: Path) -> None:
    totals = Totals()
    objects = [LeftOut(k, 5, "mug", "", has_truth=True) for k in range(2)]
    for _ in totals.passing([*RESULTS[:3], failed("0/5", objects), solved(6, None, "left_out")]):
        pass
    said = brief(BatchOutcome(tmp_path, totals.as_json(5), (), 0, 1.0, ""))
    assert said.startswith(
        "5 frames, 6 objects, 1 without a hypothesis, 1 left out (frames.csv says why), 2 in failed "
    )
    assert "median ADD(-S) 27.5 mm of 2 answers, 1 of 6 right (17%" in said


def test_totals_see_every_result_once() -> None:
    totals = Totals()
    assert list(totals.passing(RESULTS)) == RESULTS
    numbers = totals.as_json(7)
    assert (numbers["frames"], numbers["frames_done"], numbers["frames_failed"]) == (7, 5, 1)
    assert numbers["median_add_s_mm"] == 5.0
    assert numbers["mean_stages_ms_per_frame"] == {"read": 2.0}
    assert totals.failures == [("0/3", "no depth")]


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
