"""The loop of a batch with made-up workers: what it keeps, holds in memory, leaves when it ends early, and repairs."""

from __future__ import annotations

import csv
import json
import pathlib
import shutil
import tracemalloc
from collections.abc import Callable
from pathlib import Path

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec import structs

from tests.batch.at_once import AtOnce, AtOnceBackend, Loop, failed, solved
from tests.made_runs import written
from verefine_viz.batch import run_batch as run_batch_module
from verefine_viz.batch.batch_command import run_jobs
from verefine_viz.batch.index import read_batch
from verefine_viz.batch.jobs import BatchJob
from verefine_viz.batch.kept_recordings import SAMPLE, Keep, KeptRecordings
from verefine_viz.batch.run_batch import BatchStatus, run_batch
from verefine_viz.batch.runs import Runs, file_stem, read_run
from verefine_viz.core.errors import InputError, UnavailableError
from verefine_viz.core.settings import Session
from verefine_viz.run.answers import table_lines
from verefine_viz.run.record import FORMAT, Answer, RunEnd, RunRecord
from verefine_viz.run.run_file import MAGIC, decoded, framed
from verefine_viz.scenes.results_csv import read_results


def table_of(folder: Path) -> list[int]:
    """The images in frames.csv, in its order."""
    with (folder / "frames.csv").open(newline="") as file:
        return list(dict.fromkeys(int(row["im_id"]) for row in csv.DictReader(file)))


def contents(folder: Path) -> dict[str, tuple[bytes, int]]:
    files = (p for p in folder.rglob("*") if p.is_file() and p.name != ".lock")
    return {p.relative_to(folder).as_posix(): (p.read_bytes(), p.stat().st_mtime_ns) for p in files}


def test_what_is_odd_or_takes_long_is_said_before_the_work_and_is_no_result(loop: Loop) -> None:
    loop.frames(3, "a.csv gives no pose")
    made = AtOnce()
    made.solve = lambda frames: iter(["Compiling.", *map(made.done, frames)])  # type: ignore[method-assign]
    assert loop.run(workers=made).totals["frames_done"] == 3
    assert loop.told == ["note: a.csv gives no pose", "Compiling."]
    assert [now.doing for now in loop.seen][-3:] == ["", "", ""]


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


# What is written is checked at the end, and by a repeated command


def cut(file: Path) -> None:
    content = file.read_bytes()
    file.write_bytes(content[: len(content) // 2])


def lengthen(file: Path) -> None:
    file.write_bytes(file.read_bytes() * 2)


@pytest.mark.parametrize("table", ["frames.csv", "results.csv"])
@pytest.mark.parametrize("damage", [cut, lengthen, Path.unlink])
def test_a_table_of_a_finished_batch_is_written_again_from_the_run_files(
    table: str, damage: Callable[[Path], None], loop: Loop
) -> None:
    loop.frames(4)
    loop.run()
    whole = (loop.out / table).read_bytes()
    damage(loop.out / table)
    again = loop.run()
    assert loop.asked == []
    assert (again.was_finished, again.is_whole) == (False, True)
    assert [table in note for note in again.notes] == [True]
    assert (loop.out / table).read_bytes() == whole
    assert loop.run().was_finished


def test_frames_that_are_lost_while_the_batch_runs_are_no_success(
    loop: Loop, capsys: pytest.CaptureFixture[str]
) -> None:
    loop.frames(5)
    out = loop.out

    def answer(frame: str) -> RunRecord:
        if frame == "0/2":
            shutil.rmtree(out)
        return solved(frame)

    assert run_jobs([BatchJob(Session(), out, "")], out, AtOnceBackend(made=AtOnce(answer))) == 1
    assert "0/0, 0/1" in capsys.readouterr().out
    assert read_run(out).status == "incomplete"
    assert [*dict.fromkeys(row.frame for row in read_batch(out).rows)] == ["0/2", "0/3", "0/4"]
    # The same command solves what is missing, and nothing else.
    assert loop.run().is_whole
    assert loop.asked == ["0/0", "0/1"]


def flipped(content: bytes, at: int, bit: int = 3) -> bytes:
    """One bit is another; ``at`` from the end where it is negative."""
    changed = bytearray(content)
    changed[at] ^= 1 << bit
    return bytes(changed)


def changed_header(content: bytes, **values: object) -> bytes:
    """A run file whose header says something else, with checksums that fit."""
    header, encoder = decoded(content, "it").header, msgspec.msgpack.Encoder()
    was, now = (framed(b"H" + encoder.encode(one)) for one in (header, structs.replace(header, **values)))
    assert was in content
    return content.replace(was, now)


@pytest.mark.parametrize(
    ("change", "is_told"),
    [
        (lambda content: flipped(content, -9), True),
        (lambda content: content[: len(MAGIC) + 20], True),
        (lambda content: b"7,0,5,0.9", True),
        (lambda content: changed_header(content, format=FORMAT + 1), True),
        (lambda content: changed_header(content, frame="0/7"), True),
        (lambda content: content[: len(content) // 2], False),  # As a kill leaves it: nothing to tell.
    ],
)
def test_a_damaged_run_file_is_said_and_its_frame_solved_again(
    change: Callable[[bytes], bytes], is_told: bool, loop: Loop
) -> None:
    loop.frames(3)
    loop.run()
    before = {name: (loop.out / name).read_bytes() for name in ("frames.csv", "results.csv")}
    file = Runs(loop.out / "runs").path("0/1")
    file.write_bytes(change(file.read_bytes()))
    assert Runs(loop.out / "runs").read("0/1") is None
    assert loop.run().is_whole
    assert loop.asked == ["0/1"]
    assert [str(file) in note for note in loop.told] == [True] * is_told
    assert {name: (loop.out / name).read_bytes() for name in before} == before


@given(st.data())
def test_no_changed_bit_and_no_cut_gives_other_answers(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    folder = tmp_path_factory.mktemp("runs")
    record = written(folder, solved("0/1"))
    runs = Runs(folder / "runs")
    file = runs.path("0/1")
    content = file.read_bytes()
    at = data.draw(st.integers(0, len(content) - 1))
    spoiled = (flipped(content, at, data.draw(st.integers(0, 7))), content[:at])
    file.write_bytes(data.draw(st.sampled_from(spoiled)))
    assert runs.read("0/1") is None
    assert list(runs.records(["0/1"])) == []
    file.write_bytes(content)
    (again,) = runs.records(["0/1"])
    assert table_lines(again) == table_lines(record)


def test_a_damaged_run_json_stops_a_repeated_batch_and_a_missing_one_is_written_again(loop: Loop) -> None:
    loop.frames(3)
    loop.run()
    (loop.out / "run.json").write_text('{"totals": {"frames": "three"}}')
    with pytest.raises(InputError, match=r"run\.json"):
        loop.run()
    (loop.out / "run.json").unlink()
    assert loop.run().is_whole
    assert loop.asked == []
    assert read_run(loop.out).status == "finished"


# Recordings


def test_recordings_that_are_gone_are_named_and_made_again_when_asked_for(loop: Loop) -> None:
    loop.frames(4)
    assert loop.run().notes == ()
    for k in (1, 3):
        (loop.out / "recordings" / f"000000_00000{k}.rrd").unlink()
    before = contents(loop.out)
    (note,) = loop.run().notes
    assert "0/1, 0/3" in note
    assert contents(loop.out) == before
    assert loop.run(retry_failed=True).notes == ()
    assert len(list((loop.out / "recordings").iterdir())) == 4


@pytest.mark.parametrize("keep", ["none", "failures"])
def test_recordings_that_were_not_asked_for_are_not_missed(keep: str, loop: Loop) -> None:
    loop.frames(3)
    session = msgspec.convert({"recording": {"keep": keep}}, Session)
    assert run_batch(session, loop.out, AtOnceBackend(made=AtOnce(leaves_recordings=False))).notes == ()


RIGHT, MISSED, FAILED = (
    RunEnd(answers=(Answer(frame="0/0", status=status),)) for status in ("ok", "no_answer", "failed")
)


def test_what_is_kept_follows_from_the_setting_and_the_answers() -> None:
    wanted: dict[Keep, tuple[bool, bool]] = {
        "sample": (True, True), "all": (True, True), "failures": (False, True), "none": (False, False)
    }  # fmt: skip
    for keep, (right, missed) in wanted.items():
        kept = KeptRecordings(keep, SAMPLE)
        assert (kept.holds("0/0", RIGHT), kept.holds("0/0", MISSED)) == (right, missed), keep
        assert not kept.holds("0/0", FAILED)
        assert kept.always("0/0") == (keep in ("sample", "all"))


def test_of_a_large_batch_about_two_hundred_and_every_failure() -> None:
    kept = KeptRecordings("sample", 20_000)
    frames = [f"{scene}/{image}" for scene in range(20) for image in range(1000)]
    assert 150 < sum(kept.holds(frame, RIGHT) for frame in frames) < 250
    assert all(kept.holds(frame, MISSED) for frame in frames)
    other = KeptRecordings("sample", 20_000, seed=1)
    assert [f for f in frames if other.always(f)] != [f for f in frames if kept.always(f)]


@given(st.integers(0, 10**6), st.integers(1, 10**5), st.integers(1, 10**5))
def test_what_is_kept_of_a_batch_that_grew_was_kept_before(image: int, n: int, more: int) -> None:
    if KeptRecordings("sample", n + more).always(f"0/{image}"):
        assert KeptRecordings("sample", n).always(f"0/{image}")


def test_a_sampled_batch_misses_nothing_and_says_once_what_it_saves(loop: Loop) -> None:
    frames = loop.frames(2 * SAMPLE)
    kept = KeptRecordings.of(Session(), len(frames))

    def recorded(frame: str) -> RunRecord:
        if kept.always(frame):
            (loop.out / "recordings" / f"{file_stem(frame)}.rrd").write_bytes(bytes(1_000_000))
        return solved(frame)

    (note,) = loop.run(workers=AtOnce(recorded, leaves_recordings=False)).notes
    n_kept = sum(map(kept.always, frames))
    assert f"{n_kept} frames" in note
    assert f"{len(frames) - n_kept} MB" in note
    assert loop.run().notes == ()
