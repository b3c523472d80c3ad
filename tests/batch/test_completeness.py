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

from tests.batch.at_once import AtOnce, AtOnceBackend, solved
from tests.batch.test_runner import contents, frames
from tests.made_runs import written
from verefine_viz.batch.batch_command import run_jobs
from verefine_viz.batch.index import read_batch
from verefine_viz.batch.jobs import BatchJob
from verefine_viz.batch.run_batch import BatchStatus, run_batch
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


def empty(file: Path) -> None:
    file.write_bytes(b"")


def lengthen(file: Path) -> None:
    file.write_bytes(file.read_bytes() * 2)


def put_a_folder(file: Path) -> None:
    file.unlink()
    file.mkdir()


@pytest.mark.parametrize("table", ["frames.csv", "results.csv"])
@pytest.mark.parametrize("damage", [cut, empty, lengthen, Path.unlink])
def test_a_table_of_a_finished_batch_is_written_again_from_the_run_files(
    table: str, damage: Callable[[Path], None], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    frames(4, monkeypatch)
    run_batch(Session(), tmp_path, AtOnceBackend())
    whole = (tmp_path / table).read_bytes()
    damage(tmp_path / table)
    again = run_batch(Session(), tmp_path, AtOnceBackend(made=AtOnce(never)))
    assert (again.was_finished, again.is_whole) == (False, True)
    assert again.notes == (f"written again, as it differed from the run files: {table}",)
    assert (tmp_path / table).read_bytes() == whole
    assert run_batch(Session(), tmp_path, AtOnceBackend()).was_finished


def never(frame: str) -> RunRecord:
    raise AssertionError(f"{frame} was solved again")


def test_a_folder_in_place_of_a_table_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    frames(2, monkeypatch)
    run_batch(Session(), tmp_path, AtOnceBackend())
    put_a_folder(tmp_path / "results.csv")
    with pytest.raises(InputError, match=r"cannot write .*results\.csv: .*results\.csv is a folder"):
        run_batch(Session(), tmp_path, AtOnceBackend())


@pytest.mark.parametrize("at", ["0/2", "0/4"])
def test_frames_that_are_lost_while_the_batch_runs_are_no_success(
    at: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    frames(5, monkeypatch)
    out = tmp_path / "out"

    def answer(frame: str) -> RunRecord:
        if frame == at:
            shutil.rmtree(out)
        return solved(frame)

    job = BatchJob(Session(), out, "")
    assert run_jobs([job], out, AtOnceBackend(made=AtOnce(answer))) == 1
    lost = [f"0/{k}" for k in range(int(at[2:]))]
    assert f"{len(lost)} frames of the session are missing ({', '.join(lost)})" in capsys.readouterr().out
    assert json.loads((out / "run.json").read_text())["status"] == "incomplete"
    assert [*dict.fromkeys(row.frame for row in read_batch(out).rows)] == [f"0/{k}" for k in range(len(lost), 5)]
    # The same command solves what is missing, and nothing else.
    asked: list[str] = []
    again = AtOnceBackend(made=AtOnce(lambda frame: asked.append(frame) or solved(frame)))
    assert run_jobs([job], out, again) == 0
    assert asked == lost
    assert len(read_batch(out).frames) == 5


def test_recordings_that_are_gone_are_named_and_made_again_when_asked_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    frames(4, monkeypatch)
    job, backend = BatchJob(Session(), tmp_path, ""), AtOnceBackend()
    assert run_jobs([job], tmp_path, backend) == 0
    assert "note:" not in capsys.readouterr().out
    for k in (1, 3):
        (tmp_path / "recordings" / f"000000_00000{k}.rrd").unlink()
    before = contents(tmp_path)
    assert run_jobs([job], tmp_path, backend) == 0
    said = "note: recordings of 2 frames are missing (0/1, 0/3); the same command with --retry-failed makes them again"
    assert said in capsys.readouterr().out
    assert contents(tmp_path) == before
    assert run_jobs([job], tmp_path, backend, retry_failed=True) == 0
    assert len(list((tmp_path / "recordings").iterdir())) == 4
    assert "note:" not in capsys.readouterr().out


@pytest.mark.parametrize("keep", ["none", "failures"])
def test_recordings_that_were_not_asked_for_are_not_missed(
    keep: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    frames(3, monkeypatch)
    session = msgspec.convert({"recording": {"keep": keep}}, Session)
    made = AtOnce(leaves_recordings=False)
    assert run_batch(session, tmp_path, AtOnceBackend(made=made)).notes == ()


def flipped(content: bytes, at: int) -> bytes:
    """One bit is another; ``at`` from the end where it is negative."""
    changed = bytearray(content)
    changed[at] ^= 8
    return bytes(changed)


@pytest.mark.parametrize(
    ("change", "why"),
    [
        (lambda content: flipped(content, -9), "is damaged: the run ended early (bytes in the middle are damaged)"),
        (lambda content: flipped(content, len(MAGIC) + 12), "holds nothing of a run"),
        (lambda content: flipped(content, 0), "is no run file"),
        (lambda content: b"", "is empty"),
        (lambda content: b"7,0,5,0.9", "is no run file"),
        (lambda content: content[: len(MAGIC) + 20], "holds nothing of a run"),
        (lambda content: changed_header(content, format=FORMAT + 1), "was written by a later version"),
        (lambda content: changed_header(content, frame="0/7"), "is damaged: it is about frame 0/7"),
        (lambda content: changed_header(content, frame="here"), "is damaged: 'here' is no frame"),
        (lambda content: content[:-1], None),
        (lambda content: content[: len(content) // 2], None),
    ],
)
def test_a_damaged_run_file_is_said_and_its_frame_solved_again(
    change: Callable[[bytes], bytes], why: str | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One whose end is missing is as a kill leaves it, and nothing to tell."""
    frames(3, monkeypatch)
    run_batch(Session(), tmp_path, AtOnceBackend())
    before = {name: (tmp_path / name).read_bytes() for name in ("frames.csv", "results.csv")}
    file = Runs(tmp_path / "runs").path("0/1")
    file.write_bytes(change(file.read_bytes()))
    assert Runs(tmp_path / "runs").read("0/1") is None
    asked: list[str] = []
    told: list[str] = []

    def look(now: BatchStatus) -> None:
        told.append(now.doing)

    made = AtOnce(lambda frame: asked.append(frame) or solved(frame))
    assert run_batch(Session(), tmp_path, AtOnceBackend(made=made), look).is_whole
    assert asked == ["0/1"]
    notes = [one for one in told if one.startswith("note: ")]
    assert len(notes) == (why is not None)
    for note in notes:
        assert str(file) in note
        assert why in note
        assert note.endswith("; its frame is solved again")
        assert "\n" not in note
    assert {name: (tmp_path / name).read_bytes() for name in before} == before


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


def test_every_damaged_run_file_counts_and_the_first_are_quoted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    names = frames(5, monkeypatch)
    run_batch(Session(), tmp_path, AtOnceBackend())
    for frame in names:
        Runs(tmp_path / "runs").path(frame).write_bytes(b"no run")
    told: list[str] = []
    run_batch(Session(), tmp_path, AtOnceBackend(), lambda now: told.append(now.doing))
    (note,) = filter(None, told)
    assert note.count("is no run file") == 3
    assert note.endswith(" and 2 more; these frames are solved again")


@pytest.mark.parametrize("run", ['{"seconds": "x"}', '{"status": 3}', '{"totals": {"frames": "three"}}'])
def test_a_damaged_run_json_stops_a_repeated_batch_with_one_line(
    run: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    frames(3, monkeypatch)
    run_batch(Session(), tmp_path, AtOnceBackend())
    (tmp_path / "run.json").write_text(run)
    with pytest.raises(InputError, match=r"run\.json: Expected "):
        run_batch(Session(), tmp_path, AtOnceBackend())
    (tmp_path / "run.json").unlink()
    assert run_batch(Session(), tmp_path, AtOnceBackend(made=AtOnce(never))).is_whole
    assert json.loads((tmp_path / "run.json").read_text())["status"] == "finished"
