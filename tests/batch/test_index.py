"""A batch folder read again: what comes first."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.made_runs import answer, because, finished
from verefine_viz.batch.answer_orders import Order
from verefine_viz.batch.folder import RunFolder
from verefine_viz.batch.index import BatchIndex, RunSelection, find_runs, is_batch_folder, read_batch
from verefine_viz.batch.runs import BatchInfo, Runs
from verefine_viz.core.errors import InputError
from verefine_viz.run.record import Answer
from verefine_viz.run.run_header import failed_run
from verefine_viz.run.session_file import resolve

SESSION = resolve({"title": "t"})


def row(im_id: int, **values: Any) -> Answer:
    return answer(1, im_id, **{"diameter_mm": 100.0, **values})


ROWS = (
    row(1, add_s_mm=5.0, score=0.9, name="mug"),
    row(2, add_s_mm=30.0, score=0.8, findings=because("pool")),
    row(3, score=0.3),
    row(4, status="no_answer"),
    row(6, add_s_mm=30.0, diameter_mm=1000.0, score=0.1),
)


@pytest.fixture
def index(tmp_path: Path) -> BatchIndex:
    folder = RunFolder(tmp_path, SESSION)
    for record in (*(finished(row.frame, [row]) for row in ROWS), failed_run(SESSION, {}, "1/5", "no depth")):
        folder.runs.save(SESSION, record)
    folder.write_json("run.json", {"status": "finished"})
    folder.close()
    assert is_batch_folder(tmp_path)
    return read_batch(tmp_path)


@pytest.mark.parametrize(
    ("order", "expected"),
    [
        ("error", [5, 4, 2, 1, 6, 3]),
        ("score", [5, 4, 6, 3, 2, 1]),
        ("misleading", [2, 1, 3, 6, 4, 5]),
        ("cause", [2, 5, 4, 1, 6, 3]),
        ("object", [5, 4, 2, 6, 3, 1]),
        ("frame", [1, 2, 3, 4, 5, 6]),
    ],
)
def test_the_worst_come_first(index: BatchIndex, order: Order, expected: list[int]) -> None:
    assert [r.im_id for r in index.sorted_by(order)] == expected


def test_frames_that_can_be_opened_come_before_failed_ones(index: BatchIndex) -> None:
    assert index.frames == ("1/4", "1/2", "1/1", "1/6", "1/3", "1/5")
    assert index.session == SESSION
    assert index.run == BatchInfo(status="finished")


def test_a_folder_that_lost_runs_since_they_were_counted_is_refused(tmp_path: Path, index: BatchIndex) -> None:
    run = {"status": "finished", "totals": {"frames": 6, "objects": 5}}
    (tmp_path / "run.json").write_text(json.dumps(run))
    assert len(read_batch(tmp_path).rows) == 6  # the failed frame's row is about no object
    Runs(tmp_path / "runs").forget("1/6")
    with pytest.raises(InputError, match=r"runs holds 4 objects, but run\.json counted 5: it was changed or cut"):
        read_batch(tmp_path)


def test_a_batch_that_still_runs_shows_what_is_finished(tmp_path: Path) -> None:
    folder = RunFolder(tmp_path, SESSION)
    folder.write_json("run.json", {"status": "running", "totals": {"frames": 9, "frames_done": 0}})
    with pytest.raises(InputError, match="no finished frame"):
        read_batch(tmp_path)
    for k in (10, 2):
        folder.runs.save(SESSION, finished(f"1/{k}", [row(k)]))
    half = folder.runs.path("1/3")
    half.write_bytes(folder.runs.path("1/2").read_bytes()[:-1])
    (tmp_path / "frames.csv").write_text("nobody reads it")
    assert [one.frame for one in read_batch(tmp_path).rows] == ["1/2", "1/10"]
    folder.close()


def test_answers_of_a_frame_are_its_poses(tmp_path: Path) -> None:
    poses = np.eye(4), np.diag([1.0, -1.0, -1.0, 1.0])
    folder = RunFolder(tmp_path, SESSION)
    mine = [row(2, instance_id=k, obj_id=5, T_cam_obj=T) for k, T in enumerate(poses)]
    folder.runs.save(SESSION, finished("1/2", [*mine, row(2, instance_id=7, status="no_answer")]))
    folder.runs.save(SESSION, finished("1/3", [row(3, instance_id=0, obj_id=5, T_cam_obj=poses[1])]))
    folder.write_json("run.json", {"status": "finished"})
    folder.close()
    answers = read_batch(tmp_path).answers("1/2")
    assert [*answers] == [0, 1]
    for k, T in enumerate(poses):
        np.testing.assert_array_equal(answers[k], T)
    assert read_batch(tmp_path).answers("1/9") == {}


def test_another_folder_is_no_batch(tmp_path: Path) -> None:
    assert not is_batch_folder(tmp_path)
    with pytest.raises(InputError, match=r"run\.json"):
        read_batch(tmp_path)


def test_several_runs_in_a_folder_are_found_by_name(
    index: BatchIndex, tmp_path_factory: pytest.TempPathFactory
) -> None:
    several = tmp_path_factory.mktemp("several")
    for name in ("sir", "rir"):
        shutil.copytree(index.folder, several / name)
    (several / "notes").mkdir()
    assert find_runs(several) == RunSelection((several / "rir", several / "sir"), "")
    shutil.copytree(index.folder, index.folder / "recordings" / "copy", ignore=lambda *_: ["recordings"])
    assert find_runs(index.folder) == RunSelection((index.folder,), "")
    with pytest.raises(InputError, match="no folder of a batch"):
        find_runs(several / "notes")


def test_runs_further_down_are_taken_where_they_lie_together(
    index: BatchIndex, tmp_path_factory: pytest.TempPathFactory
) -> None:
    top = tmp_path_factory.mktemp("top")
    for name in ("sir", "rir"):
        shutil.copytree(index.folder, top / "may" / "sweep" / name)
    (top / "again").symlink_to(top)
    found = find_runs(top)
    assert found.runs == (top / "may/sweep/rir", top / "may/sweep/sir")
    assert str(top / "may/sweep") in found.note
    assert find_runs(top / "may" / "sweep").note == ""


def test_runs_further_down_are_never_left_out_silently(
    index: BatchIndex, tmp_path_factory: pytest.TempPathFactory
) -> None:
    top = tmp_path_factory.mktemp("top")
    for name in ("a/sir", "b/rir", "b/sir"):
        shutil.copytree(index.folder, top / name)
    with pytest.raises(InputError, match=r"a \(1 run: sir\); .*b \(2 runs: rir, sir\)$"):
        find_runs(top)
    shutil.copytree(index.folder, top / "refine")
    found = find_runs(top)
    assert found.runs == (top / "refine",)
    assert f"{top / 'a'} (1 run), {top / 'b'} (2 runs)" in found.note


def test_a_folder_of_run_files_is_read_as_a_batch(tmp_path: Path) -> None:
    batch = tmp_path / "batch"
    folder = RunFolder(batch, SESSION)
    for row in ROWS:
        folder.runs.save(SESSION, failed_run(SESSION, {}, row.frame, "no depth"))
    folder.write_json("run.json", {"status": "finished"})
    folder.close()
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
    with pytest.raises(InputError, match="holds runs on different data"):
        read_batch(loose)


def test_a_batch_that_is_half_done_says_so_also_by_its_folder_of_runs(tmp_path: Path) -> None:
    folder = RunFolder(tmp_path, SESSION)
    folder.runs.save(SESSION, failed_run(SESSION, {}, "1/1", "no depth"))
    folder.write_json("run.json", {"status": "running", "totals": {"frames": 3}})
    folder.close()
    (found,) = find_runs(tmp_path / "runs").runs
    assert found == tmp_path
    assert [note.startswith("1 of 3 ") for note in read_batch(found).notes] == [True]
