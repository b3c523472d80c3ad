"""What a batch says while it works."""

from __future__ import annotations

import io
import re
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest
from rich.console import Console

from tests.made_runs import answer, finished
from verefine_viz.batch import progress
from verefine_viz.batch.batch_command import brief
from verefine_viz.batch.pace import Pace
from verefine_viz.batch.progress import BatchProgress, counted_bar
from verefine_viz.batch.run_batch import BatchOutcome, BatchStatus
from verefine_viz.batch.totals import BatchCounts, Totals
from verefine_viz.core.problem import LeftOut
from verefine_viz.core.settings import Session
from verefine_viz.run.kernel_compilation import COMPILING
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


class Clock:
    """Time that passes when it is told to."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now = 100.0
        monkeypatch.setattr(progress, "monotonic", lambda: self.now)

    def solve(self, pace: Pace, n: int, frame_s: float) -> None:
        """``n`` frames, one after the other."""
        for _ in range(n):
            pace.begin("0/0", self.now)
            self.now += frame_s
            pace.end("0/0", self.now)


@pytest.mark.parametrize(
    ("frame_s", "n_frames", "said"),
    [
        (0.25, 100, "0.25 s a frame, 0:24 left, recall 50%, 1 failed"),
        (60.0, 105, "60 s a frame, 1:40:00 left, recall 50%, 1 failed"),
        (2.0, 5, "2.0 s a frame, writing tables, recall 50%, 1 failed"),
    ],
)
def test_rate_rest_and_recall(frame_s: float, n_frames: int, said: str, monkeypatch: pytest.MonkeyPatch) -> None:
    clock, shown = Clock(monkeypatch), BatchProgress(Console(file=io.StringIO()))
    with shown.run("run") as report:
        report(BatchStatus(BatchCounts(), n_frames))
        assert shown.describe() == f"run, 0/{n_frames} frames, starting"
        clock.solve(shown.pace, 5, frame_s)
        report(BatchStatus(counted(), n_frames))
        assert shown.describe() == f"run, 5/{n_frames} frames, {said}"


def test_several_runs_are_counted_together_and_the_recall_is_of_one(monkeypatch: pytest.MonkeyPatch) -> None:
    clock, shown = Clock(monkeypatch), BatchProgress(Console(file=io.StringIO()), 20)
    for k in range(2):
        with shown.run(f"run {k}") as report:
            clock.solve(shown.pace, 5, 2.0)
            report(BatchStatus(counted(), 5))
            assert shown.describe().startswith(f"run {k}, {5 * k + 5}/20 frames, 2.0 s a frame, 0:{30 - 10 * k} left, ")
    with shown.run("run 2") as report:
        report(BatchStatus(BatchCounts(), 5))
        assert shown.describe() == "run 2, 10/20 frames, 2.0 s a frame, 0:20 left"


@pytest.mark.parametrize(("why", "doing"), [(COMPILING, "compiling"), ("Preparing a mug.", "preparing")])
def test_what_is_done_once_is_a_line_of_its_own_and_not_in_the_time_left(
    why: str, doing: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = io.StringIO()
    clock, shown = Clock(monkeypatch), BatchProgress(Console(file=text, width=200))
    with shown.run("run") as report:
        report(BatchStatus(BatchCounts(), 10))
        shown.pace.begin("0/0", clock.now)
        shown.pace.slow_down("0/0", why)
        assert shown.describe() == f"run, 0/10 frames, {doing}"
        shown.pace.end("0/0", clock.now)
        clock.solve(shown.pace, 5, 2.0)
        shown.pace.begin("0/1", clock.now)
        shown.pace.slow_down("0/1", why)
        for one in ("", why, ""):
            report(BatchStatus(counted(), 10, doing=one))
        clock.now += 60.0
        assert f"2.0 s a frame, 0:08 left + {doing}, " in shown.describe()
    assert text.getvalue().splitlines() == [why]


def test_a_warning_is_printed_once() -> None:
    text = io.StringIO()
    with BatchProgress(Console(file=text, width=200)).run("run") as report:
        for _ in range(3):
            report(BatchStatus(counted(), 100, "too little memory"))
    assert text.getvalue().splitlines() == ["note: too little memory"]


def test_a_log_file_gets_a_line_now_and_then_where_there_is_news(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(progress, "EVERY_S", 0.02)
    text = io.StringIO()
    with BatchProgress(Console(file=text, width=200)).shown() as shown, shown.run("run") as report:
        wait_for(lambda: "run, 0/? frames, starting\n" in text.getvalue())
        report(BatchStatus(counted(), 100))
        wait_for(lambda: "run, 5/100 frames, starting, recall 50%, 1 failed\n" in text.getvalue())
        time.sleep(0.2)
        assert len(text.getvalue().splitlines()) == 2
    assert len(text.getvalue().splitlines()) == 2, "it ends with the batch"


def test_counted_things_are_lines_in_a_log_too(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(progress, "EVERY_S", 0.02)
    clock, said = Clock(monkeypatch), ""

    def wait_for_line(line: str) -> None:
        nonlocal said

        def is_there() -> bool:
            nonlocal said
            said += capsys.readouterr().err
            return f"{line}\n" in said

        wait_for(is_there)

    with counted_bar("study") as report:
        wait_for_line("study: starting")
        report("study", 40, 60)
        wait_for_line("study: 40/60")
        for done in range(41, 51):  # 40 were done before
            clock.now += 3.0
            report("study", done, 60)
        wait_for_line("study: 50/60, 0:30 left")
        report("figures", 0, 4)
        wait_for_line("figures: 0/4")


def on_terminal(width: int, n_failed: int = 0) -> str:
    """The last state of a bar, with its colours, and what comes after it."""
    text = io.StringIO()
    console = Console(file=text, width=width, force_terminal=True, color_system="standard", legacy_windows=False)
    with BatchProgress(console, 300).run("run 12 of 100: a-long-name-of-a-method-17") as report:
        report(
            BatchStatus(BatchCounts(frames_done=7, frames_failed=n_failed, objects_with_truth=3, objects_correct=3), 30)
        )
    return text.getvalue()


@pytest.mark.parametrize("width", [80, 130])
def test_the_bar_leaves_room_for_a_typed_ctrl_c_and_is_red_only_where_frames_fail(width: int) -> None:
    red = re.compile(r"\x1b\[(\d+;)*(31|91|35)m")
    assert not red.search(on_terminal(width))
    assert red.search(on_terminal(width, n_failed=1))
    lines = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", on_terminal(width, n_failed=2)).replace("\r", "\n").splitlines()
    bars = [line for line in lines if "━" in line]
    assert max(len(line) for line in bars) <= width - 3
    assert bars[-1].startswith("run 12 of 100: ")
    assert bars[-1].rstrip().endswith("recall 100% 2 failed")
    assert "━━" in bars[-1]
    assert " 7/300 " in bars[-1]


@pytest.mark.parametrize(
    ("counts", "said"),
    [
        (BatchCounts(), ""),
        (counted(), "run: stopped after 5 of 100 frames, recall 50%, 1 failed; the same command goes on\n"),
    ],
)
def test_ctrl_c_says_how_far_it_came(counts: BatchCounts, said: str) -> None:
    text = io.StringIO()

    def stopped() -> None:
        with BatchProgress(Console(file=text, width=200)).run("run") as report:
            report(BatchStatus(counts, 100))
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        stopped()
    assert text.getvalue() == said


def wait_for(condition: Callable[[], bool]) -> None:
    until = time.monotonic() + 10.0
    while not condition():
        assert time.monotonic() < until, "it never happened"
        time.sleep(0.01)
