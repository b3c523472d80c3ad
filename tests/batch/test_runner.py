"""The loop of a batch with made-up workers: what it keeps, what it holds in memory, what an interruption leaves."""

from __future__ import annotations

import csv
import json
import pathlib
import tracemalloc
from pathlib import Path

import pytest

from tests.batch.at_once import AtOnce, AtOnceBackend, Loop, failed, solved
from verefine_viz.batch import run_batch as run_batch_module
from verefine_viz.batch.index import read_batch
from verefine_viz.batch.run_batch import BatchStatus, run_batch
from verefine_viz.batch.runs import read_run
from verefine_viz.core.errors import UnavailableError
from verefine_viz.core.settings import Session
from verefine_viz.run.record import RunRecord
from verefine_viz.scenes.results_csv import read_results


def test_what_is_odd_about_the_choice_is_said_before_the_work(loop: Loop) -> None:
    loop.frames(2, "a.csv gives no pose", "object 5 is nowhere")
    before: list[list[str]] = []
    loop.run(lambda frame: before.append(loop.told) or solved(frame))
    assert before[0] == ["note: a.csv gives no pose", "note: object 5 is nowhere"]


@pytest.mark.usefixtures("long_run")
def test_the_parent_does_not_grow_with_the_number_of_frames(loop: Loop) -> None:
    loop.frames(1500)
    held: dict[int, int] = {}

    def look(now: BatchStatus) -> None:
        if now.counts.frames_done in (300, 1400):
            # Without pathlib: it puts names into the interpreter's own table, which doubles now and then by megabytes.
            own = tracemalloc.take_snapshot().filter_traces([tracemalloc.Filter(False, pathlib.__file__)])
            held[now.counts.frames_done] = sum(trace.size for trace in own.traces)

    tracemalloc.start()
    try:
        run_batch(Session(), loop.out, AtOnceBackend(), look)
    finally:
        tracemalloc.stop()
    # A single record is about 5 kB of Python objects; 1100 of them would be 5 MB.
    assert held[1400] - held[300] < 200_000
    assert len(read_batch(loop.out).frames) == 1500


def test_tables_are_in_the_session_s_order_whatever_the_order_of_the_work(loop: Loop) -> None:
    loop.frames(9)
    backwards = AtOnce()
    backwards.solve = lambda frames: map(backwards.done, reversed(list(frames)))  # type: ignore[method-assign]
    assert loop.run(workers=backwards).totals["frames_done"] == 9
    assert backwards.is_closed
    assert table_of(loop.out) == list(range(9))
    assert [row.im_id for row in read_results(loop.out / "results.csv")] == [k for k in range(9) for _ in range(5)]


def table_of(folder: Path) -> list[int]:
    """The images in frames.csv, in its order."""
    with (folder / "frames.csv").open(newline="") as file:
        return list(dict.fromkeys(int(row["im_id"]) for row in csv.DictReader(file)))


def contents(folder: Path) -> dict[str, tuple[bytes, int]]:
    files = (p for p in folder.rglob("*") if p.is_file() and p.name != ".lock")
    return {p.relative_to(folder).as_posix(): (p.read_bytes(), p.stat().st_mtime_ns) for p in files}


def test_a_finished_batch_is_left_as_it_is(loop: Loop) -> None:
    loop.frames(4)
    first = loop.run(lambda frame: failed(frame, "no depth") if frame == "0/2" else solved(frame))
    assert not first.was_finished
    before = contents(loop.out)
    again = loop.run()
    assert (again.was_finished, loop.asked) == (True, [])
    assert contents(loop.out) == before
    assert (again.totals, again.failures, again.n_failed) == (first.totals, (("0/2", "no depth"),), 1)
    # Failed frames are something to do for those who ask for it.
    mended = loop.run(retry_failed=True)
    assert (mended.was_finished, mended.n_failed) == (False, 0)
    assert loop.run(retry_failed=True).was_finished
    # The same folder with fewer frames is counted again.
    loop.frames(2)
    assert not loop.run().was_finished
    assert table_of(loop.out) == [0, 1]


def test_what_takes_long_is_passed_on_and_no_result(loop: Loop) -> None:
    loop.frames(3)
    made = AtOnce()
    made.solve = lambda frames: iter(["Compiling.", *map(made.done, frames)])  # type: ignore[method-assign]
    assert loop.run(workers=made).totals["frames_done"] == 3
    assert [now.doing for now in loop.seen] == ["", "Compiling.", "", "", ""]


def test_a_second_ctrl_c_while_it_tidies_up_leaves_no_batch_that_runs(loop: Loop) -> None:
    loop.frames(3)

    def stop(*_: object) -> RunRecord:
        raise KeyboardInterrupt

    loop.patch.setattr(run_batch_module, "write_tables", stop)
    with pytest.raises(KeyboardInterrupt):
        loop.run(lambda frame: solved(frame) if frame == "0/0" else stop())
    assert read_run(loop.out).status == "stopped"
    loop.patch.undo()
    loop.frames(3)
    assert loop.run().n_resumed == 1
    assert read_run(loop.out).status == "finished"


@pytest.mark.parametrize("end", [KeyboardInterrupt(), UnavailableError("the scheduler is gone")])
def test_what_is_done_when_it_ends_early_is_there(end: BaseException, loop: Loop) -> None:
    loop.frames(9)

    def answer(frame: str) -> RunRecord | None:
        if frame == "0/4":
            raise end
        return None if frame == "0/2" else solved(frame)

    made = AtOnce(answer)
    with pytest.raises(type(end)):
        loop.run(workers=made)
    assert made.is_closed
    assert table_of(loop.out) == [0, 1, 3]
    run = json.loads((loop.out / "run.json").read_text())
    assert (run["status"], run["totals"]["frames"], run["totals"]["frames_done"]) == ("stopped", 9, 3)
    # Nobody holds the folder any more, and only the rest is asked for.
    assert loop.run().n_resumed == 3
    assert loop.asked == [f"0/{k}" for k in (2, 4, 5, 6, 7, 8)]
    assert table_of(loop.out) == list(range(9))
    assert read_batch(loop.out).frames == tuple(f"0/{k}" for k in range(9))
