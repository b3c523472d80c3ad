"""What a batch counts, and shows while it works: recall, notes, doubts about data, how often the score misleads."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.made_runs import answer, finished
from verefine_viz.batch.batch_command import brief
from verefine_viz.batch.progress import BatchProgress
from verefine_viz.batch.run_batch import BatchOutcome, BatchStatus
from verefine_viz.batch.totals import BatchCounts, Doubts, Notes, Totals, describe_doubts, misranked_share
from verefine_viz.core import console
from verefine_viz.core.console import Terminal
from verefine_viz.core.geometry import rounding_note
from verefine_viz.core.problem import LeftOut
from verefine_viz.core.settings import Session
from verefine_viz.run.record import Answer, RunRecord
from verefine_viz.run.run_header import failed_run

LACKS = "mug (#{}) has no hypothesis: no row for object 5"
SCORES = st.lists(st.sampled_from([0.1, 0.5, 0.9]), min_size=1, max_size=8)


def solved(im_id: int, add_s_mm: float | None, status: str = "ok") -> RunRecord:
    row = answer(0, im_id, status=status, add_s_mm=add_s_mm, diameter_mm=100.0, score=0.5, has_truth=True)
    return finished(f"0/{im_id}", [row], seconds=1.0, stages_ms={"read": 2.0})


def failed(frame: str, objects: Sequence[LeftOut] = ()) -> RunRecord:
    return failed_run(Session(), {}, frame, "no depth", objects)


RESULTS = [solved(0, 5.0), solved(1, 50.0), solved(2, None, "no_answer"), failed("0/3"), solved(4, 1.0)]


def counted(results: Sequence[RunRecord] = RESULTS) -> BatchCounts:
    counts = BatchCounts()
    for result in results:
        assert result.end is not None
        counts.add(result.end)
    return counts


def test_objects_without_an_answer_left_out_or_in_failed_frames_are_missed(tmp_path: Path) -> None:
    counts = counted()
    assert counts.recall == 2 / 4
    assert (counts.frames_done, counts.frames_failed, counts.objects_without_answer) == (5, 1, 1)
    objects = [LeftOut(k, 5, "mug", "its mask is missing", has_truth=True) for k in range(3)]
    results = [*RESULTS, failed("0/5", objects), solved(6, None, "left_out")]
    counts = counted(results)
    assert (counts.objects, counts.objects_with_truth, counts.objects_correct) == (8, 8, 2)
    assert (counts.objects_in_failed_frames, counts.objects_left_out, counts.answers_with_truth) == (3, 1, 3)
    assert counts.recall == 2 / 8
    # Totals see every result once, and the summary adds up.
    totals = Totals()
    assert list(totals.passing(results)) == results
    numbers = totals.as_json(9)
    assert (numbers["frames"], numbers["frames_done"], numbers["frames_failed"]) == (9, 7, 2)
    assert (numbers["median_add_s_mm"], numbers["mean_stages_ms_per_frame"]) == (5.0, {"read": 2.0})
    assert totals.failures == [("0/3", "no depth"), ("0/5", "no depth")]
    summary = brief(BatchOutcome(tmp_path, numbers, (), 0, 1.0, ""))
    for part in ("9 frames", "8 objects", "1 left out", "3 in failed frames", "5.0 mm of 3 answers", "2 of 8 right"):
        assert part in summary


def noted(*places: tuple[str, ...], most: int = 20) -> dict[str, int]:
    notes = Notes(most)
    for place in places:
        notes.add(place)
    return notes.counted()


def test_a_note_is_counted_once_a_frame_whatever_the_number_of_its_object() -> None:
    without_number = LACKS.replace(" (#{})", "")
    assert noted((LACKS.format(2),), (LACKS.format(2),)) == {LACKS.format(2): 2}
    assert noted((LACKS.format(0),), (LACKS.format(3),), (LACKS.format(0),)) == {without_number: 3}
    assert noted((LACKS.format(0), LACKS.format(1))) == {without_number: 1}
    assert len(noted((LACKS.format(0), LACKS.format(0).replace("mug", "jug"), "mug (#0) has no depth"))) == 3


def test_what_differs_by_its_numbers_alone_is_one_note() -> None:
    rounded = [rounding_note("ground truth", [np.diag([1, 1, x])] * n) for x, n in ((1.002, 1), (1.01, 2))]
    faults = [(f"mug (#{k}) has no ground truth: image {k}, entry {k}: it is not rigid",) for k in range(2)]
    for notes in (rounded, faults):
        ((note, n),) = noted(*notes).items()
        assert n == 2
        assert note not in (notes[0][0], notes[1][0])
        assert noted(notes[0]) == {notes[0][0]: 1}


def test_the_most_frequent_notes_come_first_and_the_first_ones_are_kept() -> None:
    assert list(noted(("a",), ("b",), ("b",)).items()) == [("b", 2), ("a", 1)]
    assert noted(("a", "b", "c"), ("c", "a"), most=2) == {"a": 2, "b": 1}


LARGE, LARGER, FAR, SINK, FLOAT = "11% larger", "12.5% larger", "depth is 8% larger", "all 3 sink", "all 3 float"
"""Doubts about a frame's data; the first two differ by their number alone."""


def test_reasons_of_doubt_are_counted_by_kind_the_most_frequent_first() -> None:
    doubts = Doubts()
    assert doubts.describe(9) == ""
    for k, why in enumerate((FAR, FAR, LARGE, LARGER, LARGE, SINK, FLOAT)):
        doubts.add(f"0/{k}", why)
    text = doubts.describe(9)
    parts = ["7 of 9 frames", "3, such as 0/2", LARGE, "2, such as 0/0", FAR, "2 other"]
    places = [text.index(part) for part in parts]
    assert places == sorted(places)
    assert SINK not in text


def test_a_frame_is_in_doubt_once_and_of_several_runs_the_one_is_named() -> None:
    def row(im_id: int, doubt: str) -> Answer:
        return answer(0, im_id, doubts=(doubt,) * bool(doubt))

    one, other = ("rir-0", [row(1, ""), row(2, FAR), row(2, FAR)]), ("rir-1", [row(1, LARGE), row(2, FAR)])
    assert "frame 0/2, " in describe_doubts([one])
    text = describe_doubts([one, other])
    for part in ("3 of 4 frames of 2 runs", "2, such as 0/2 of rir-0", "frame 0/1 of rir-1"):
        assert part in text


@given(SCORES, SCORES)
def test_misranked_is_the_share_of_pairs_and_a_draw_counts_half(right: list[float], wrong: list[float]) -> None:
    def rows(scores: list[float], add_s_mm: float) -> list[Answer]:
        return [answer(diameter_mm=100.0, add_s_mm=add_s_mm, score=score) for score in scores]

    pairs = [1.0 if w > r else 0.5 if w == r else 0.0 for w in wrong for r in right]
    assert misranked_share(rows(right, 1.0) + rows(wrong, 50.0)) == pytest.approx(sum(pairs) / len(pairs))
    assert misranked_share(rows(right, 1.0)) is misranked_share(rows(wrong, 50.0)) is misranked_share([]) is None


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


@pytest.mark.parametrize(("counts", "numbers"), [(BatchCounts(), ()), (counted(), ("5 of 100", "50%", "1 failed"))])
def test_ctrl_c_says_how_far_it_came(counts: BatchCounts, numbers: tuple[str, ...]) -> None:
    text = io.StringIO()
    with pytest.raises(KeyboardInterrupt), BatchProgress(console=Terminal(file=text)).run("run") as report:
        report(BatchStatus(counts, 100))
        raise KeyboardInterrupt
    assert len(text.getvalue().splitlines()) == bool(numbers)
    assert all(number in text.getvalue() for number in numbers)
