"""The folder of a batch: what a restart may build on, who may write, and what is read from it."""

from __future__ import annotations

import csv
import json
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from tests.batch.at_once import Loop
from tests.batch.frames import ROOT
from tests.made_runs import answer, because, finished
from verefine_viz.batch import index as index_module
from verefine_viz.batch.answer_index import INDEX, indexed_answers
from verefine_viz.batch.answer_orders import Order
from verefine_viz.batch.folder import RunFolder, first_change
from verefine_viz.batch.index import BatchIndex, RunSelection, find_runs, is_batch_folder, read_batch
from verefine_viz.batch.runs import BatchInfo, Runs, read_run
from verefine_viz.core.errors import InputError, SettingsError, UnavailableError
from verefine_viz.run.answers import COLUMNS, table_lines
from verefine_viz.run.record import Answer, RunRecord
from verefine_viz.run.run_header import failed_run
from verefine_viz.run.session_file import resolve

SESSION = resolve({"title": "a", "method": {"name": "sir"}})


def row(im_id: int, **values: Any) -> Answer:
    return answer(1, im_id, **{"diameter_mm": 100.0, **values})


def solved(im_id: int, **values: Any) -> RunRecord:
    return finished(f"1/{im_id}", [row(im_id, **values)])


def failed(frame: str) -> RunRecord:
    return failed_run(SESSION, {}, frame, "no depth")


def batch_of(folder: Path, *records: RunRecord, **run: Any) -> Path:
    """A batch folder with these records."""
    begun = RunFolder(folder, SESSION)
    for record in records:
        begun.runs.save(SESSION, record)
    begun.write_json("run.json", {"status": "finished", **run})
    begun.close()
    return folder


def test_finished_frames_are_found_again(tmp_path: Path) -> None:
    two, three = solved(2, score=1 / 3), solved(3, score=0.5)
    again = RunFolder(batch_of(tmp_path, two, three), SESSION)
    found = [*again.runs.records(["1/3", "1/4", "1/2"])]
    assert [(one.header.frame, table_lines(one)) for one in found] == [
        ("1/3", table_lines(three)), ("1/2", table_lines(two))
    ]  # fmt: skip
    assert again.runs.frames == ("1/2", "1/3")
    again.close()


def test_what_differs_first_is_named_as_in_a_session_file() -> None:
    change = {"after_iteration": 3, "settings": {"score": {"tau_m": 0.01}}}
    for here, field in (
        ({"scene": {"frames": ["0/1", "0/2"]}}, "scene.frames"),
        ({"physics": {"enabled": False}}, "physics.enabled"),
        ({"changes": [change]}, "[[changes]]"),
    ):
        assert field in (first_change(resolve({}), resolve(here)) or "")
    assert first_change(resolve({}), resolve({})) is None


@pytest.mark.parametrize(
    ("name", "content", "error", "said"),
    [
        ("session.toml", 'title = "a"\n[method]\nname = "rir"\n', SettingsError, r"method\.name"),
        ("run.json", '{"version": "0.0.1"}', SettingsError, r"0\.0\.1"),
        ("thesis.tex", "years of work", InputError, r"thesis\.tex"),
        (".lock", None, InputError, r"theirs\.txt"),
    ],
)
def test_a_folder_of_something_else_is_refused_and_left_alone(
    name: str, content: str | None, error: type[Exception], said: str, tmp_path: Path
) -> None:
    theirs, out = tmp_path / "theirs.txt", tmp_path / "out"
    theirs.write_text("years of work")
    out.mkdir()
    if name == "run.json":
        RunFolder(out, SESSION).close()
    if content is None:
        (out / name).symlink_to(theirs)
    else:
        (out / name).write_text(content)
    with pytest.raises(error, match=said):
        RunFolder(out, SESSION)
    assert (out / name).read_text() == (content or "years of work")


@pytest.mark.usefixtures("processes")
def test_half_written_files_of_killed_processes_go_and_those_of_others_stay(tmp_path: Path) -> None:
    RunFolder(tmp_path, SESSION).close()
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    gone = ["frames.csv.1-2.part", "errors/000001_000002.txt.1-2.part", f"report.html.{ended.pid}-1.part"]
    kept = ["recordings/000001_000003.rrd", f"report.html.{os.getpid()}-1.part", "mine.part"]
    for name in (*gone, *kept):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    RunFolder(tmp_path, SESSION).close()
    assert [name for name in (*gone, *kept) if (tmp_path / name).exists()] == kept


@pytest.mark.usefixtures("processes")
def test_a_killed_writer_leaves_no_lock(tmp_path: Path) -> None:
    code = (
        "import sys\nfrom pathlib import Path\nfrom tests.batch.test_folder import SESSION\n"
        "from verefine_viz.batch.folder import RunFolder\n"
        "folder = RunFolder(Path(sys.argv[1]), SESSION)\nprint('locked', flush=True)\nsys.stdin.read()\n"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code, str(tmp_path)],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=ROOT,
    ) as child:  # fmt: skip
        assert child.stdout.readline() == "locked\n"
        with pytest.raises(UnavailableError):
            RunFolder(tmp_path, SESSION)
        os.kill(child.pid, signal.SIGKILL)
    assert child.returncode == -signal.SIGKILL
    RunFolder(tmp_path, SESSION).close()


def test_run_json_is_read_back_and_a_foreign_one_is_one_clear_error(tmp_path: Path) -> None:
    for text in ("", '{"seconds": -1}'):
        (tmp_path / "run.json").write_text(text)
        with pytest.raises(InputError, match=r"run\.json: "):
            read_run(tmp_path)
    (tmp_path / "run.json").write_text(json.dumps({"seconds": 3}))
    assert read_run(tmp_path) == BatchInfo(seconds=3)
    assert read_run(tmp_path / "nowhere") == BatchInfo()


# Read again

ROWS = (
    row(1, add_s_mm=5.0, score=0.9, name="mug"),
    row(2, add_s_mm=30.0, score=0.8, findings=because("pool")),
    row(3, score=0.3),
    row(4, status="no_answer"),
    row(6, add_s_mm=30.0, diameter_mm=1000.0, score=0.1),
)


@pytest.fixture
def index(tmp_path: Path) -> BatchIndex:
    batch_of(tmp_path / "batch", *(finished(row.frame, [row]) for row in ROWS), failed("1/5"))
    assert is_batch_folder(tmp_path / "batch")
    return read_batch(tmp_path / "batch")


def test_the_worst_come_first_and_failed_frames_last(index: BatchIndex) -> None:
    expected: dict[Order, list[int]] = {
        "error": [5, 4, 2, 1, 6, 3],
        "score": [5, 4, 6, 3, 2, 1],
        "misleading": [2, 1, 3, 6, 4, 5],
        "cause": [2, 5, 4, 1, 6, 3],
        "object": [5, 4, 2, 6, 3, 1],
        "frame": [1, 2, 3, 4, 5, 6],
    }
    assert {order: [r.im_id for r in index.sorted_by(order)] for order in expected} == expected
    assert index.frames == ("1/4", "1/2", "1/1", "1/6", "1/3", "1/5")
    assert (index.session, index.run) == (SESSION, BatchInfo(status="finished"))


def test_a_folder_that_lost_runs_since_they_were_counted_is_refused(index: BatchIndex) -> None:
    run = {"status": "finished", "totals": {"frames": 6, "objects": 5}}
    (index.folder / "run.json").write_text(json.dumps(run))
    assert len(read_batch(index.folder).rows) == 6  # the failed frame's row is about no object
    Runs(index.folder / "runs").forget("1/6")
    with pytest.raises(InputError, match=r"4 objects, but run\.json counted 5"):
        read_batch(index.folder)


def test_a_batch_that_still_runs_shows_what_is_finished(tmp_path: Path) -> None:
    folder = RunFolder(tmp_path, SESSION)
    folder.write_json("run.json", {"status": "running", "totals": {"frames": 9, "frames_done": 0}})
    with pytest.raises(InputError, match=tmp_path.name):
        read_batch(tmp_path)
    for k in (10, 2):
        folder.runs.save(SESSION, solved(k))
    folder.runs.path("1/3").write_bytes(folder.runs.path("1/2").read_bytes()[:-1])
    (tmp_path / "frames.csv").write_text("nobody reads it")
    folder.close()
    for found in (tmp_path, *find_runs(tmp_path / "runs").runs):
        batch = read_batch(found)
        assert (batch.folder, [one.frame for one in batch.rows]) == (tmp_path, ["1/2", "1/10"])
        assert [note.startswith("2 of 9 ") for note in batch.notes] == [True]


def test_answers_of_a_frame_are_its_poses(tmp_path: Path) -> None:
    poses = np.eye(4), np.diag([1.0, -1.0, -1.0, 1.0])
    mine = [row(2, instance_id=k, obj_id=5, T_cam_obj=T) for k, T in enumerate(poses)]
    two = finished("1/2", [*mine, row(2, instance_id=7, status="no_answer")])
    batch = read_batch(batch_of(tmp_path, two, solved(3, instance_id=0, obj_id=5, T_cam_obj=poses[1])))
    answers = batch.answers("1/2")
    assert [*answers] == [0, 1]
    for k, T in enumerate(poses):
        np.testing.assert_array_equal(answers[k], T)
    assert batch.answers("1/9") == {}


def test_a_folder_of_run_files_is_read_as_a_batch(tmp_path: Path) -> None:
    batch = batch_of(tmp_path / "batch", *(failed(row.frame) for row in ROWS))
    loose = tmp_path / "loose"
    loose.mkdir()
    for k, path in enumerate(sorted((batch / "runs").iterdir())):
        shutil.copy(path, loose / f"drop {k}.vfrun")
    shutil.copy(loose / "drop 0.vfrun", batch / "runs" / "a copy.vfrun")
    assert is_batch_folder(loose)
    assert [row.frame for row in read_batch(loose).rows] == [row.frame for row in read_batch(batch).rows]
    assert read_batch(loose).notes == ()
    (loose / "noise.vfrun").write_bytes(b"noise")
    (note,) = read_batch(loose).notes
    assert "noise.vfrun" in note
    (loose / "noise.vfrun").unlink()
    other = resolve({"scene": {"demo": "tower"}})
    Runs(loose).save(other, failed_run(other, {}, "0/1", "no depth"))
    with pytest.raises(InputError, match="different data"):
        read_batch(loose)


def test_runs_are_found_where_they_lie_together_and_never_left_out_silently(index: BatchIndex, tmp_path: Path) -> None:
    top, deep = tmp_path / "top", tmp_path / "deep"
    for name in ("b/sir", "b/rir"):
        shutil.copytree(index.folder, top / name)
    (top / "b" / "notes").mkdir()
    runs = (top / "b/rir", top / "b/sir")
    assert find_runs(top / "b") == RunSelection(runs, "")
    (top / "again").symlink_to(top)
    further_down = find_runs(top)
    assert further_down.runs == runs
    assert str(top / "b") in further_down.note
    shutil.copytree(index.folder, top / "a" / "sir")
    with pytest.raises(InputError, match=r"a \(1 run: sir\); .*b \(2 runs: rir, sir\)$"):
        find_runs(top)
    shutil.copytree(index.folder, top / "refine")
    here = find_runs(top)
    assert here.runs == (top / "refine",)
    assert f"{top / 'a'} (1 run), {top / 'b'} (2 runs)" in here.note
    # What a run holds is none, nor is what holds nothing.
    shutil.copytree(index.folder, deep)
    shutil.copytree(index.folder, deep / "recordings" / "copy")
    assert find_runs(deep) == RunSelection((deep,), "")
    assert not is_batch_folder(top / "b" / "notes")
    for look in (find_runs, read_batch):
        with pytest.raises(InputError, match="notes"):
            look(top / "b" / "notes")


# The copy of all answers in one file


@pytest.fixture
def batch(loop: Loop) -> Path:
    loop.frames(12)
    loop.run()
    return loop.out


def test_a_batch_is_read_from_its_index_as_from_its_run_files(batch: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    indexed = indexed_answers(batch)
    assert indexed is not None
    monkeypatch.setattr(index_module, "indexed_answers", lambda folder: None)
    read = read_batch(batch).rows
    assert len({row.frame for row in read}) == 12
    assert [row.frame for row in indexed] == [row.frame for row in read]
    for column in COLUMNS:
        assert [column.cell(row) for row in indexed] == [column.cell(row) for row in read], column.name


def newer(batch: Path) -> None:
    path = Runs(batch / "runs").path("0/3")
    os.utime(path, ns=(path.stat().st_atime_ns, path.stat().st_mtime_ns + 1))


def gone(batch: Path) -> None:
    Runs(batch / "runs").path("0/3").unlink()


def cut(batch: Path) -> None:
    (batch / INDEX).write_bytes((batch / INDEX).read_bytes()[:-7])


def changed(batch: Path) -> None:
    content = bytearray((batch / INDEX).read_bytes())
    content[len(content) // 2] ^= 1
    (batch / INDEX).write_bytes(content)


@pytest.mark.parametrize("spoil", [newer, gone, cut, changed])
def test_an_index_that_is_not_of_the_run_files_does_not_count(batch: Path, spoil: Callable[[Path], None]) -> None:
    spoil(batch)
    assert indexed_answers(batch) is None


def test_the_typed_table_has_the_columns_of_the_text_and_all_digits(batch: Path) -> None:
    table, rows = pq.read_table(batch / "frames.parquet"), read_batch(batch).rows
    with (batch / "frames.csv").open(newline="") as file:
        assert table.column_names == next(csv.reader(file))
    for name in table.column_names:
        assert table.column(name).to_pylist() == [getattr(row, name) for row in rows], name
