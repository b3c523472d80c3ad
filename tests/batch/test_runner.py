"""The loop of a batch with made-up workers: what it keeps, what it holds in memory, what an interruption leaves."""

from __future__ import annotations

import csv
import json
import pathlib
import tracemalloc
from pathlib import Path

import pytest

from tests.batch.at_once import AtOnce, AtOnceBackend, failed, solved
from verefine_viz.batch import run_batch as runner
from verefine_viz.batch.index import read_batch
from verefine_viz.batch.run_batch import BatchStatus, run_batch
from verefine_viz.core.errors import UnavailableError
from verefine_viz.core.settings import Session
from verefine_viz.run.record import RunRecord
from verefine_viz.scenes.results_csv import read_results


def frames(n: int, monkeypatch: pytest.MonkeyPatch, *notes: str) -> tuple[str, ...]:
    names = tuple(f"0/{k}" for k in range(n))
    monkeypatch.setattr(runner, "check", lambda session: (names, notes))
    return names


def test_what_is_odd_about_the_choice_is_said_before_the_work(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    frames(2, monkeypatch, "a.csv gives no pose", "object 5 is nowhere")
    told: list[tuple[str, int]] = []
    run_batch(Session(), tmp_path, AtOnceBackend(), lambda now: told.append((now.doing, now.counts.frames_done)))
    assert [one for one in told if one[0]] == [("note: a.csv gives no pose", 0), ("note: object 5 is nowhere", 0)]


@pytest.mark.usefixtures("long_run")
def test_the_parent_does_not_grow_with_the_number_of_frames(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    frames(1500, monkeypatch)
    held: dict[int, int] = {}

    def look(now: BatchStatus) -> None:
        if now.counts.frames_done in (300, 1400):
            # Without pathlib: it puts names into the interpreter's own table, which doubles now and then by megabytes.
            own = tracemalloc.take_snapshot().filter_traces([tracemalloc.Filter(False, pathlib.__file__)])
            held[now.counts.frames_done] = sum(trace.size for trace in own.traces)

    tracemalloc.start()
    try:
        run_batch(Session(), tmp_path / "out", AtOnceBackend(), look)
    finally:
        tracemalloc.stop()
    # A single record is about 5 kB of Python objects; 1100 of them would be 5 MB.
    assert held[1400] - held[300] < 200_000
    assert len(read_batch(tmp_path / "out").frames) == 1500


def test_tables_are_in_the_session_s_order_whatever_the_order_of_the_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    names = frames(9, monkeypatch)
    backwards = AtOnce()
    backwards.solve = lambda frames, pace: map(backwards.done, reversed(list(frames)))  # type: ignore[method-assign]
    outcome = run_batch(Session(), tmp_path, AtOnceBackend(made=backwards))
    assert backwards.is_closed
    assert outcome.totals["frames_done"] == len(names)
    assert table_of(tmp_path) == list(range(9))
    assert [row.im_id for row in read_results(tmp_path / "results.csv")] == [k for k in range(9) for _ in range(5)]


def table_of(folder: Path) -> list[int]:
    """The images in frames.csv, in its order."""
    with (folder / "frames.csv").open(newline="") as file:
        return list(dict.fromkeys(int(row["im_id"]) for row in csv.DictReader(file)))


def contents(folder: Path) -> dict[str, tuple[bytes, int]]:
    files = (p for p in folder.rglob("*") if p.is_file() and p.name != ".lock")
    return {p.relative_to(folder).as_posix(): (p.read_bytes(), p.stat().st_mtime_ns) for p in files}


def test_a_finished_batch_is_left_as_it_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    frames(4, monkeypatch)
    backend = AtOnceBackend(made=AtOnce(lambda frame: failed(frame, "no depth") if frame == "0/2" else solved(frame)))
    first = run_batch(Session(), tmp_path, backend)
    assert not first.was_finished
    before = contents(tmp_path)
    again = run_batch(Session(), tmp_path, backend)
    assert again.was_finished
    assert contents(tmp_path) == before
    assert (again.totals, again.failures, again.n_failed) == (first.totals, (("0/2", "no depth"),), 1)
    # Failed frames are something to do for those who ask for it.
    mended = run_batch(Session(), tmp_path, AtOnceBackend(), retry_failed=True)
    assert (mended.was_finished, mended.n_failed) == (False, 0)
    assert run_batch(Session(), tmp_path, AtOnceBackend(), retry_failed=True).was_finished


@pytest.mark.parametrize("lost", ["frames.csv", "results.csv", "run.json", "runs/000000_000001.vfrun"])
def test_what_a_finished_batch_has_lost_is_made_again(
    lost: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    frames(3, monkeypatch)
    run_batch(Session(), tmp_path, AtOnceBackend())
    before = (tmp_path / lost).read_bytes()
    (tmp_path / lost).unlink()
    assert not run_batch(Session(), tmp_path, AtOnceBackend()).was_finished
    assert (tmp_path / lost).is_file()
    if lost != "run.json":
        assert (tmp_path / lost).read_bytes() == before


def test_a_batch_of_fewer_frames_than_before_is_counted_anew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    frames(3, monkeypatch)
    run_batch(Session(), tmp_path, AtOnceBackend())
    frames(2, monkeypatch)
    assert not run_batch(Session(), tmp_path, AtOnceBackend()).was_finished
    assert table_of(tmp_path) == [0, 1]
    assert json.loads((tmp_path / "run.json").read_text())["totals"]["frames"] == 2


def test_what_takes_long_is_passed_on_and_no_result(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    names = frames(3, monkeypatch)
    made = AtOnce()
    made.solve = lambda frames, pace: iter(["Compiling.", *map(made.done, frames)])  # type: ignore[method-assign]
    seen: list[BatchStatus] = []
    outcome = run_batch(Session(), tmp_path, AtOnceBackend(made=made), seen.append)
    assert [now.doing for now in seen] == ["", "Compiling.", "", "", ""]
    assert outcome.totals["frames_done"] == len(names)


@pytest.mark.parametrize("end", [KeyboardInterrupt, UnavailableError("the scheduler is gone")])
def test_what_is_done_when_it_ends_early_is_there(
    end: type[BaseException] | BaseException, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    frames(9, monkeypatch)

    def answer(frame: str) -> RunRecord | None:
        if frame == "0/4":
            raise end
        return None if frame == "0/2" else solved(frame)

    made = AtOnce(answer)
    with pytest.raises(end if isinstance(end, type) else type(end)):
        run_batch(Session(), tmp_path, AtOnceBackend(made=made))
    assert made.is_closed
    assert table_of(tmp_path) == [0, 1, 3]
    run = json.loads((tmp_path / "run.json").read_text())
    assert (run["status"], run["totals"]["frames"], run["totals"]["frames_done"]) == ("stopped", 9, 3)
    # Nobody holds the folder any more, and only the rest is asked for.
    asked: list[str] = []
    again = AtOnce(lambda frame: asked.append(frame) or solved(frame))
    assert run_batch(Session(), tmp_path, AtOnceBackend(made=again)).n_resumed == 3
    assert asked == [f"0/{k}" for k in (2, 4, 5, 6, 7, 8)]
    assert table_of(tmp_path) == list(range(9))
    assert read_batch(tmp_path).frames == tuple(f"0/{k}" for k in range(9))
