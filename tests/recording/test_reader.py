from __future__ import annotations

from pathlib import Path

import msgspec
import pytest
import rerun as rr

from tests.fakes import box_problem
from tests.recording.runs import new_run, recorded_run, session
from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import InputError
from verefine_viz.core.records import Iteration
from verefine_viz.recording import recorder
from verefine_viz.recording.lossless_log import Entry
from verefine_viz.recording.reader import read_recording
from verefine_viz.recording.recorder import Recorder
from verefine_viz.recording.recording_file import part_path

pytestmark = pytest.mark.usefixtures("processes")


def error_of(path: Path) -> str:
    with pytest.raises(InputError) as caught:
        read_recording(path)
    text = str(caught.value)
    assert "\n" not in text
    assert path.name in text
    return text


def test_missing_file(tmp_path: Path) -> None:
    assert "does not exist" in error_of(tmp_path / "no.rrd")


def test_folder(tmp_path: Path) -> None:
    (tmp_path / "folder.rrd").mkdir()
    assert "is a folder, expected a file" in error_of(tmp_path / "folder.rrd")


def test_empty_file(tmp_path: Path) -> None:
    (tmp_path / "empty.rrd").touch()
    assert "is empty" in error_of(tmp_path / "empty.rrd")


@pytest.mark.parametrize("content", [b"hello", b"\x89PNG\r\n\x1a\n", b"RRF1 old", b"RR"])
def test_foreign_file(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "foreign.rrd").write_bytes(content)
    assert "is not a rerun recording" in error_of(tmp_path / "foreign.rrd")


def test_only_a_head(tmp_path: Path) -> None:
    (tmp_path / "head.rrd").write_bytes(b"RRF2")
    assert "ended early: it holds nothing of a run" in error_of(tmp_path / "head.rrd")


@pytest.mark.parametrize("length", [60, 1000, 3000])
def test_cut_before_its_run_begins(tmp_path: Path, length: int) -> None:
    recorded_run(tmp_path / "run.rrd")
    (tmp_path / "cut.rrd").write_bytes((tmp_path / "run.rrd").read_bytes()[:length])
    assert error_of(tmp_path / "cut.rrd").endswith("ended early: it holds nothing of a run; run its session again")


def test_noise_after_the_head(tmp_path: Path) -> None:
    recorded_run(tmp_path / "run.rrd")
    content = (tmp_path / "run.rrd").read_bytes()
    (tmp_path / "noise.rrd").write_bytes(content[:16] + bytes(range(256)) * 40)
    error_of(tmp_path / "noise.rrd")


def test_recording_of_another_program(tmp_path: Path) -> None:
    rec = rr.RecordingStream("another")
    rec.save(tmp_path / "other.rrd")
    rec.log("points", rr.Points3D([[0, 0, 0]]))
    rec.flush()
    rec.disconnect()
    assert "another program" in error_of(tmp_path / "other.rrd")


def test_later_schema(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as patched:
        patched.setattr("verefine_viz.recording.recorder.SCHEMA", 99)
        recorded_run(tmp_path / "later.rrd")
    assert "later version" in error_of(tmp_path / "later.rrd")


def test_unknown_settings(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as patched:
        patched.setattr("verefine_viz.core.settings.Session.model_dump_json", lambda self: '{"method": {"magic": 1}}')
        patched.setattr("verefine_viz.recording.recorder._toml", lambda settings: "")
        recorded_run(tmp_path / "odd.rrd")
    assert "settings cannot be read" in error_of(tmp_path / "odd.rrd")


def test_a_part_that_cannot_be_read_yet_is_read_from_its_journal(tmp_path: Path) -> None:
    bare, problem = session(maps=False), box_problem(3)
    run = new_run(bare, problem, (Recorder(tmp_path / "run.rrd", bare, problem),))
    for _ in range(3):
        run.step()
    whole = part_path(tmp_path / "run.rrd").read_bytes()
    part_path(tmp_path / "run.rrd").write_bytes(b"RRF2" + bytes(range(60)))
    recorded = read_recording(tmp_path / "run.rrd")
    assert [i.index for i in recorded.iterations] == [1, 2, 3]
    part_path(tmp_path / "run.rrd").write_bytes(whole)
    run.close()


@pytest.mark.parametrize("packed", [b"", b"x", msgspec.msgpack.encode([{}, [0.0]])])
def test_an_entry_that_is_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, packed: bytes) -> None:

    def broken(iteration: Iteration, errors: Float) -> Entry:
        entry = Entry(iteration, errors)
        vars(entry)["packed"] = packed
        return entry

    with monkeypatch.context() as patched:
        patched.setattr(recorder, "Entry", broken)
        recorded_run(tmp_path / "run.rrd", session(maps=False))
    assert "an iteration cannot be read" in error_of(tmp_path / "run.rrd")
