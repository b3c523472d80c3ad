"""What a batch has written is checked at its end and by a repeated command: frames, tables and recordings."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec import structs

from tests.batch.at_once import AtOnce, AtOnceBackend, Loop, solved
from tests.batch.test_runner import contents
from tests.made_runs import written
from verefine_viz.batch.batch_command import run_jobs
from verefine_viz.batch.index import read_batch
from verefine_viz.batch.jobs import BatchJob
from verefine_viz.batch.run_batch import run_batch
from verefine_viz.batch.runs import Runs
from verefine_viz.core.errors import InputError
from verefine_viz.core.settings import Session
from verefine_viz.run.answers import table_lines
from verefine_viz.run.record import FORMAT, RunRecord
from verefine_viz.run.run_file import MAGIC, decoded, framed

ENCODER = msgspec.msgpack.Encoder()


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
    assert json.loads((out / "run.json").read_text())["status"] == "incomplete"
    assert [*dict.fromkeys(row.frame for row in read_batch(out).rows)] == ["0/2", "0/3", "0/4"]
    # The same command solves what is missing, and nothing else.
    assert loop.run().is_whole
    assert loop.asked == ["0/0", "0/1"]


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


def flipped(content: bytes, at: int) -> bytes:
    """One bit is another; ``at`` from the end where it is negative."""
    changed = bytearray(content)
    changed[at] ^= 8
    return bytes(changed)


@pytest.mark.parametrize(
    ("change", "is_told"),
    [
        (lambda content: flipped(content, -9), True),
        (lambda content: content[: len(MAGIC) + 20], True),
        (lambda content: b"7,0,5,0.9", True),
        (lambda content: changed_header(content, format=FORMAT + 1), True),
        (lambda content: changed_header(content, frame="0/7"), True),
        (lambda content: content[: len(content) // 2], False),
    ],
)
def test_a_damaged_run_file_is_said_and_its_frame_solved_again(
    change: Callable[[bytes], bytes], is_told: bool, loop: Loop
) -> None:
    """One whose end is missing is as a kill leaves it, and nothing to tell."""
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


def changed_header(content: bytes, **values: object) -> bytes:
    """A run file whose header says something else, with checksums that fit."""
    header = decoded(content, "it").header
    was, now = (framed(b"H" + ENCODER.encode(one)) for one in (header, structs.replace(header, **values)))
    assert was in content
    return content.replace(was, now)


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
    changed = bytearray(content)
    changed[at] ^= 1 << data.draw(st.integers(0, 7))
    file.write_bytes(data.draw(st.sampled_from([bytes(changed), content[:at]])))
    assert runs.read("0/1") is None
    assert list(runs.records(["0/1"])) == []
    file.write_bytes(content)
    (again,) = runs.records(["0/1"])
    assert table_lines(again) == table_lines(record)


def test_every_damaged_run_file_counts_and_the_first_are_quoted(loop: Loop) -> None:
    frames = loop.frames(5)
    loop.run()
    for frame in frames:
        Runs(loop.out / "runs").path(frame).write_bytes(b"no run")
    loop.run()
    (note,) = loop.told
    assert "2 more" in note


def test_a_damaged_run_json_stops_a_repeated_batch_and_a_missing_one_is_written_again(loop: Loop) -> None:
    loop.frames(3)
    loop.run()
    (loop.out / "run.json").write_text('{"totals": {"frames": "three"}}')
    with pytest.raises(InputError, match=r"run\.json: Expected "):
        loop.run()
    (loop.out / "run.json").unlink()
    assert loop.run().is_whole
    assert loop.asked == []
    assert json.loads((loop.out / "run.json").read_text())["status"] == "finished"
