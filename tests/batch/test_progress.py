"""What a batch says while it works."""

from __future__ import annotations

import io
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest
from rich.console import Console

from tests.made_runs import answer, finished
from verefine_viz.batch import progress
from verefine_viz.batch.batch_command import in_short
from verefine_viz.batch.progress import in_words, shown_progress
from verefine_viz.batch.run_batch import Outcome, Progress
from verefine_viz.batch.totals import Counts, Totals
from verefine_viz.core.problem import LeftOut
from verefine_viz.core.settings import Session
from verefine_viz.run.record import RunEnd, RunRecord, failed_run


def solved(im_id: int, add_s_mm: float | None, status: str = "ok") -> RunRecord:
    row = answer(0, im_id, status=status, add_s_mm=add_s_mm, diameter_mm=100.0, score=0.5, has_truth=True)
    return finished(f"0/{im_id}", [row], seconds=1.0, stages_ms={"read": 2.0})


def failed(frame: str, objects: Sequence[LeftOut] = ()) -> RunRecord:
    return failed_run(Session(), frame, "no depth", objects)


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


def counted() -> Counts:
    counts = Counts()
    for result in RESULTS:
        counts.add(end_of(result))
    return counts


def test_objects_without_an_answer_are_missed() -> None:
    counts = counted()
    assert counts.recall == 2 / 4
    assert (counts.frames_done, counts.frames_failed, counts.objects_without_answer) == (5, 1, 1)


def test_objects_that_were_left_out_or_are_in_failed_frames_are_missed() -> None:
    counts = counted()
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
    said = in_short(Outcome(tmp_path, totals.as_json(5), (), 0, 1.0, ""))
    assert said == (
        "5 frames, 6 objects, 1 without a hypothesis, 1 left out (frames.csv says why), 2 in failed frames, "
        "median ADD(-S) 27.5 mm of 2 answers, 1 of 6 right (17%; ADD(-S) below 10 % of the diameter)"
    )


def test_totals_see_every_result_once() -> None:
    totals = Totals()
    assert list(totals.passing(RESULTS)) == RESULTS
    numbers = totals.as_json(7)
    assert (numbers["frames"], numbers["frames_done"], numbers["frames_failed"]) == (7, 5, 1)
    assert numbers["median_add_s_mm"] == 5.0
    assert numbers["mean_stages_ms_per_frame"] == {"read": 2.0}
    assert totals.failures == [("0/3", "no depth")]


@pytest.mark.parametrize(
    ("frame_s", "n_frames", "said"),
    [
        (None, 100, "starting, recall 50%, 1 failed"),
        (0.25, 100, "4.0 frames/s, 0:24 left, recall 50%, 1 failed"),
        (60.0, 105, "60.0 s a frame, 1:40:00 left, recall 50%, 1 failed"),
        (2.0, 5, "2.0 s a frame, recall 50%, 1 failed"),
    ],
)
def test_rate_rest_and_recall(frame_s: float | None, n_frames: int, said: str) -> None:
    assert in_words(Progress(counted(), n_frames, 0, 10.0, frame_s)) == said


def test_what_takes_long_is_a_line_of_its_own() -> None:
    text = io.StringIO()
    with shown_progress("run", Console(file=text, width=200)) as tell:
        for doing in ("", "Compiling.", ""):
            tell(Progress(Counts(), 100, 0, 1.0, doing=doing))
    assert text.getvalue().splitlines() == ["Compiling."]


def test_a_log_file_gets_a_line_now_and_then(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(progress, "EVERY_S", 30.0)
    text = io.StringIO()
    with shown_progress("run", Console(file=text, width=200)) as tell:
        for seconds in (1.0, 31.0, 45.0, 62.0):
            tell(Progress(counted(), 100, 0, seconds, 1.0, "too little memory"))
    lines = text.getvalue().splitlines()
    assert lines == [
        "note: too little memory",
        *["run: 5/100 frames, 1.0 frames/s, 1:35 left, recall 50%, 1 failed"] * 2,
    ]


def test_a_log_file_gets_a_line_also_while_one_frame_takes_long(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(progress, "EVERY_S", 0.05)
    text = io.StringIO()
    with shown_progress("run", Console(file=text, width=200)) as tell:
        wait_for(lambda: text.getvalue().count("run: starting\n") >= 2)
        tell(Progress(counted(), 100, 0, 0.01, 1.0))
        wait_for(lambda: "run: 5/100 frames" in text.getvalue())
    n = len(text.getvalue())
    time.sleep(0.2)
    assert len(text.getvalue()) == n, "it ends with the batch"


def wait_for(condition: Callable[[], bool]) -> None:
    until = time.monotonic() + 10.0
    while not condition():
        assert time.monotonic() < until, "it never happened"
        time.sleep(0.01)
