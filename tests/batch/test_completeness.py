"""What a batch has written is checked at its end and by a repeated command: frames, tables and recordings."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.batch.at_once import AtOnce, AtOnceBackend, solved
from tests.batch.test_runner import contents, frames
from verefine_viz.batch.batch_command import run_jobs
from verefine_viz.batch.jobs import Job
from verefine_viz.batch.journal import Runs

# NAMES FrameResult,read_frames_csv
from verefine_viz.batch.run_batch import Progress, run_batch
from verefine_viz.core.errors import InputError
from verefine_viz.core.settings import Session


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
def test_a_table_of_a_finished_batch_is_written_again_from_the_journal(
    table: str, damage: Callable[[Path], None], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    frames(4, monkeypatch)
    run_batch(Session(), tmp_path, AtOnceBackend())
    whole = (tmp_path / table).read_bytes()
    damage(tmp_path / table)
    again = run_batch(Session(), tmp_path, AtOnceBackend(made=AtOnce(never)))
    assert (again.was_finished, again.is_whole) == (False, True)
    assert again.notes == (f"written again, as it differed from the journal: {table}",)
    assert (tmp_path / table).read_bytes() == whole
    assert run_batch(Session(), tmp_path, AtOnceBackend()).was_finished


def never(frame: str) -> FrameResult:
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

    def answer(frame: str) -> FrameResult:
        if frame == at:
            shutil.rmtree(out)
        return solved(frame)

    job = Job(Session(), out, "")
    assert run_jobs([job], out, AtOnceBackend(made=AtOnce(answer))) == 1
    lost = [f"0/{k}" for k in range(int(at[2:]))]
    assert f"{len(lost)} frames of the session are missing ({', '.join(lost)})" in capsys.readouterr().out
    assert json.loads((out / "run.json").read_text())["status"] == "incomplete"
    assert [row.frame for row in read_batch(out).rows] == [f"0/{k}" for k in range(len(lost), 5)]
    # The same command solves what is missing, and nothing else.
    asked: list[str] = []
    again = AtOnceBackend(made=AtOnce(lambda frame: asked.append(frame) or solved(frame)))
    assert run_jobs([job], out, again) == 0
    assert asked == lost
    assert len(read_batch(out).rows) == 5


def test_recordings_that_are_gone_are_named_and_made_again_when_asked_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    frames(4, monkeypatch)
    job, backend = Job(Session(), tmp_path, ""), AtOnceBackend()
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
    session = Session.model_validate({"recording": {"keep": keep}})
    made = AtOnce()
    made.solve = lambda frames: map(solved, frames)  # type: ignore[method-assign]
    assert run_batch(session, tmp_path, AtOnceBackend(made=made)).notes == ()


def pose(value: Any) -> Callable[[dict[str, Any]], Any]:
    return lambda entry: entry["estimates"][0].update(T_cam_obj=value)


NAN_POSE = [float("nan")] + [float(k % 5 == 0) for k in range(1, 16)]


@pytest.mark.parametrize(
    ("change", "why"),
    [
        (pose(NAN_POSE), "estimates.0.T_cam_obj.0 = nan: input should be a finite number"),
        (pose([0.0, 0.0, 1.0]), "estimates.0.T_cam_obj = [0.0, 0.0, 1.0]: tuple should have at least 16 items"),
        (pose([2.0 * (k % 5 == 0) for k in range(16)]), "the pose is not rigid"),
        (pose("here"), "estimates.0.T_cam_obj = 'here'"),
        (lambda entry: entry.pop("objects"), "objects is missing"),
        (lambda entry: entry.update(objects=[]), "it holds no object"),
        (lambda entry: entry.update(objects=[], failed=True), "a failed frame has a row that says why"),
        (lambda entry: entry["objects"][0].update(score=float("inf")), "objects.0.score = inf"),
        (lambda entry: entry.update(frame="0/7"), "it is about frame 0/7"),
    ],
)
def test_a_damaged_entry_of_the_journal_is_said_and_its_frame_solved_again(
    change: Callable[[dict[str, Any]], Any], why: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    frames(3, monkeypatch)
    run_batch(Session(), tmp_path, AtOnceBackend())
    before = {name: (tmp_path / name).read_bytes() for name in ("frames.csv", "results.csv")}
    file = tmp_path / "frames" / "000000_000001.json"
    entry = json.loads(file.read_text())
    change(entry)
    file.write_text(json.dumps(entry))
    assert Runs(tmp_path / "runs").read("0/1") is None
    asked: list[str] = []
    told: list[str] = []

    def look(now: Progress) -> None:
        told.append(now.doing)

    made = AtOnce(lambda frame: asked.append(frame) or solved(frame))
    assert run_batch(Session(), tmp_path, AtOnceBackend(made=made), look).is_whole
    assert asked == ["0/1"]
    (note,) = [one for one in told if one.startswith("note: ")]
    assert note.startswith(f"note: {file} is damaged: ")
    assert note.endswith("; its frame is solved again")
    assert why in note
    assert {name: (tmp_path / name).read_bytes() for name in before} == before


@pytest.mark.parametrize("run", ['{"seconds": "x"}', '{"status": 3}', '{"totals": {"frames": "three"}}'])
def test_a_damaged_run_json_stops_a_repeated_batch_with_one_line(
    run: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    frames(3, monkeypatch)
    run_batch(Session(), tmp_path, AtOnceBackend())
    (tmp_path / "run.json").write_text(run)
    with pytest.raises(InputError, match=r"run\.json cannot be read: .*: delete it, and the same"):
        run_batch(Session(), tmp_path, AtOnceBackend())
    (tmp_path / "run.json").unlink()
    assert run_batch(Session(), tmp_path, AtOnceBackend(made=AtOnce(never))).is_whole
    assert json.loads((tmp_path / "run.json").read_text())["status"] == "finished"
