"""Frames that arrive in a folder: listed at once, solved one after another, be they half written, gone or killed."""

from __future__ import annotations

import json
import shutil
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.fakes import box_problem
from tests.made_runs import answer, finished
from tests.run.kept_frames import box_mesh, found, kept
from tests.scenes.test_trace import write_box, write_trace
from verefine_viz.batch import watch as watching
from verefine_viz.batch.folder import RunFolder
from verefine_viz.batch.index import BatchIndex, read_batch
from verefine_viz.batch.runs import Runs
from verefine_viz.batch.watch import TRIES, Watch, data_folders
from verefine_viz.core.errors import InputError, UnavailableError
from verefine_viz.core.settings import Session
from verefine_viz.run.record import WAITING, RunRecord
from verefine_viz.run.session_file import load_session, resolve

QUICK = resolve({"method": {"name": "refine", "refiner": "identity"}, "physics": {"enabled": False}})
"""A method that is done at once."""
PROBLEM = box_problem(n_hypotheses=2)
PATIENCE_S = 100.0


@pytest.fixture
def mesh(tmp_path: Path) -> Path:
    return box_mesh(tmp_path / "box.stl")


def watch_of(tmp_path: Path, base: Session | None = QUICK) -> Watch:
    return Watch(tmp_path / "frames", tmp_path / "runs", base)


def keep(folder: Path, mesh: Path, n: int = 1) -> None:
    for _ in range(n):
        kept(folder, PROBLEM, [found(PROBLEM, mesh)])


def shown(watch: Watch) -> list[tuple[str, str, str]]:
    """Run, frame and state of each row."""
    return [
        (index.folder.name, row.frame, WAITING if row.message == WAITING else row.status)
        for index in watch.latest[0]
        for row in index.rows
    ]


def index(watch: Watch) -> BatchIndex:
    (only,) = watch.latest[0]
    return only


@contextmanager
def at_work(watch: Watch) -> Iterator[Callable[[Callable[[], object]], None]]:
    """The watch on a thread of its own; gives what waits until something holds after a change."""
    changed = threading.Event()
    thread = threading.Thread(target=watch.work, args=(changed.set,))
    thread.start()

    def until(holds: Callable[[], object]) -> None:
        end = time.monotonic() + PATIENCE_S
        while not holds():
            assert time.monotonic() < end, f"it never happened: {shown(watch)}, {watch.latest[1]}"
            changed.wait(0.2)
            changed.clear()

    try:
        yield until
    finally:
        watch.stop()
        thread.join(60)
        assert not thread.is_alive()
        watch.close()


@contextmanager
def looked(tmp_path: Path, base: Session | None = QUICK, overrides: dict[str, Any] | None = None) -> Iterator[Watch]:
    """A watch that has looked once."""
    with closing(Watch(tmp_path / "frames", tmp_path / "runs", base, overrides)) as watch:
        watch.look()
        yield watch


# What is there


def test_frames_are_listed_as_they_arrive_and_go(tmp_path: Path, mesh: Path) -> None:
    folder = tmp_path / "frames"
    folder.mkdir()
    watch = watch_of(tmp_path)
    assert not watch.look()
    assert watch.latest == ((), "")
    keep(folder, mesh)
    assert watch.look()
    assert not watch.look()
    assert shown(watch) == [("frames", "1/1", WAITING)]
    keep(folder, mesh, 2)
    assert watch.look()
    assert [frame for _, frame, _ in shown(watch)] == ["1/1", "1/2", "1/3"]
    cameras = folder / "test" / "000001" / "scene_camera.json"
    cameras.write_text(json.dumps({k: v for k, v in json.loads(cameras.read_text()).items() if k != "2"}))
    assert watch.look()
    left = [("frames", "1/1", WAITING), ("frames", "1/3", WAITING)]
    assert shown(watch) == left
    # A list that is half written is read again.
    whole = cameras.read_text()
    cameras.write_text(whole[:20])
    assert watch.look()
    assert "scene_camera.json" in watch.latest[1]
    assert "\n" not in watch.latest[1]
    assert shown(watch) == left
    cameras.write_text(whole)
    assert watch.look()
    assert watch.latest[1] == ""
    folder.rename(tmp_path / "away")
    assert watch.look()
    assert shown(watch) == []
    watch.close()


def test_a_folder_may_hold_several_each_with_a_run_of_its_own(tmp_path: Path, mesh: Path) -> None:
    keep(tmp_path / "frames" / "left", mesh)
    keep(tmp_path / "frames" / "right", mesh, 2)
    (tmp_path / "frames" / "notes").mkdir()
    with looked(tmp_path) as watch:
        assert [row[:2] for row in shown(watch)] == [("left", "1/1"), ("right", "1/1"), ("right", "1/2")]
        assert [i.folder for i in watch.latest[0]] == [tmp_path / "runs" / "left", tmp_path / "runs" / "right"]
    assert data_folders(tmp_path / "frames" / "left") == (tmp_path / "frames" / "left",)


def test_method_and_data_come_from_the_session_and_the_folder(tmp_path: Path, mesh: Path) -> None:
    kept(tmp_path / "frames", PROBLEM, [found(PROBLEM, mesh, with_truth=True)])
    file, sir = tmp_path / "frames" / "session.toml", {"method": {"name": "sir"}}
    with looked(tmp_path, QUICK, sir) as watch:
        session, own = index(watch).session, load_session(file)
        assert (session.scene, session.hypotheses, session.method) == (own.scene, own.hypotheses, QUICK.method)
    with looked(tmp_path, None, sir) as watch:
        assert index(watch).session.method.name == "sir"
    file.unlink()
    shutil.rmtree(tmp_path / "runs")
    with looked(tmp_path, None) as watch:
        assert index(watch).session.hypotheses.source == "perturb"


def test_what_cannot_be_watched_is_refused_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="frames"):
        watch_of(tmp_path)
    (tmp_path / "frames").write_text("")
    with pytest.raises(InputError, match="frames"):
        watch_of(tmp_path)
    (tmp_path / "frames").unlink()
    (tmp_path / "frames").mkdir()
    with closing(watch_of(tmp_path)), pytest.raises(UnavailableError, match="runs"):
        watch_of(tmp_path)
    watch_of(tmp_path).close()


# What is solved


def test_frames_kept_one_after_another_are_solved_and_leave_a_batch(
    tmp_path: Path, mesh: Path, processes: None
) -> None:
    folder = tmp_path / "frames"
    keep(folder, mesh)
    watch = watch_of(tmp_path)
    with at_work(watch) as until:
        until(lambda: shown(watch) == [("frames", "1/1", "ok")])
        keep(folder, mesh)
        until(lambda: ("frames", "1/2", "ok") in shown(watch))
        # A further estimator, more poses per object: the run goes on.
        more = found(PROBLEM, mesh)
        poses = np.array([h.T_cam_obj for h in PROBLEM.instances[0].hypotheses] * 4)
        more["poses"]["another"] = poses
        kept(folder, PROBLEM, [more], gravity_cam=(0, 1, 0))
        until(lambda: ("frames", "1/3", "ok") in shown(watch))
        assert index(watch).answers("1/3")
        # The tables follow when nothing else is to be solved.
        until(lambda: (tmp_path / "runs" / "frames" / "frames.csv").read_text().count("\n") == 4)
    assert watch.latest[1] == ""
    run = read_batch(tmp_path / "runs" / "frames")
    assert [row.frame for row in run.rows] == ["1/1", "1/2", "1/3"]
    assert [row.n_hypotheses for row in run.rows] == [2, 2, 4]
    assert not list((tmp_path / "runs").rglob("*.part"))


def test_a_data_set_that_comes_while_another_is_solved_is_solved_too(
    tmp_path: Path, mesh: Path, processes: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    keep(tmp_path / "frames" / "left", mesh)
    keep(tmp_path / "elsewhere", mesh)
    watch = watch_of(tmp_path)
    take = watching.WatchedDataset.take

    def taken(self: watching.WatchedDataset, runs: Runs, result: RunRecord) -> None:
        take(self, runs, result)
        if not (tmp_path / "frames" / "right").exists():
            shutil.copytree(tmp_path / "elsewhere", tmp_path / "frames" / "right")

    monkeypatch.setattr(watching.WatchedDataset, "take", taken)
    with at_work(watch) as until:
        until(lambda: shown(watch) == [("left", "1/1", "ok"), ("right", "1/1", "ok")])


def test_a_frame_that_cannot_be_read_is_tried_again_and_then_shown_as_failed(
    tmp_path: Path, mesh: Path, processes: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(watching, "RETRY_S", 0.2)
    folder = tmp_path / "frames"
    keep(folder, mesh, 3)
    whole = {}
    for number in (2, 3):
        depth = folder / "test" / "000001" / "depth" / f"{number:06d}.png"
        whole[number] = depth.read_bytes()
        depth.write_bytes(whole[number][:100])
    watch = watch_of(tmp_path)
    tried: list[str] = []
    take = watching.WatchedDataset.take

    def taken(self: watching.WatchedDataset, runs: Runs, result: RunRecord) -> None:
        take(self, runs, result)
        tried.append(result.header.frame)
        if tried.count("1/3") == 1:  # Now it is whole.
            (folder / "test" / "000001" / "depth" / "000003.png").write_bytes(whole[3])

    monkeypatch.setattr(watching.WatchedDataset, "take", taken)
    with at_work(watch) as until:
        until(lambda: ("frames", "1/2", "failed") in shown(watch) and ("frames", "1/3", "ok") in shown(watch))
    assert ("frames", "1/1", "ok") in shown(watch)
    (failed,) = [row for row in index(watch).rows if row.status == "failed"]
    assert "000002.png" in failed.message
    assert tried.count("1/2") == TRIES


def test_a_session_that_cannot_be_run_is_said_and_frames_still_arrive(
    tmp_path: Path, mesh: Path, processes: None
) -> None:
    keep(tmp_path / "frames", mesh)
    other = resolve({"scene": {"demo": "mug"}})
    RunFolder(tmp_path / "runs" / "frames", other).close()
    watch = watch_of(tmp_path)
    with at_work(watch) as until:
        until(lambda: "holds a run of another session" in watch.latest[1])
        keep(tmp_path / "frames", mesh)
        until(lambda: len(shown(watch)) == 2)
    assert load_session(tmp_path / "runs" / "frames" / "session.toml") == other


# Traces


def test_a_trace_counts_once_it_is_whole_and_is_solved_again_once_it_grew(tmp_path: Path) -> None:
    write_trace(tmp_path / "t1", write_box(tmp_path / "box.obj"))
    copy, watch = tmp_path / "frames" / "t1", None
    copy.mkdir(parents=True)
    shutil.copy(tmp_path / "t1" / "calls.jsonl", copy)
    watch = watch_of(tmp_path, None)
    watch.look()
    assert watch.latest == ((), "")
    shutil.copytree(tmp_path / "t1", copy, dirs_exist_ok=True)
    assert watch.look()
    assert shown(watch) == [("frames", "0/1", WAITING)]
    runs = Runs(tmp_path / "runs" / "frames" / "runs")
    runs.save(Session(), finished("0/1", [answer(0, 1, method="trace")]))
    assert watch.look()
    assert shown(watch) == [("frames", "0/1", "ok")]
    lines = (copy / "calls.jsonl").read_bytes().splitlines(keepends=True)
    (copy / "calls.jsonl").write_bytes(b"".join([*lines[:-1], lines[-2], lines[-1]]))
    assert watch.look()
    assert shown(watch) == [("frames", "0/1", WAITING)]
    watch.close()
