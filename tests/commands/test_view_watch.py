"""``view --watch FOLDER`` as a program: what it refuses, killed in the middle and started again, ended by Ctrl-C."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import psutil
import pytest

from tests.batch.killed_batches import done
from tests.fakes import box_problem
from tests.run.kept_frames import box_mesh, found, kept
from verefine_viz.batch.index import read_batch
from verefine_viz.batch.runs import Runs
from verefine_viz.cli import main
from verefine_viz.page import app as page_app
from verefine_viz.run.session_file import resolve, save_session

PROBLEM = box_problem(n_hypotheses=2)
PATIENCE_S = 240.0


@pytest.fixture
def frames(tmp_path: Path) -> Path:
    """A folder of ``keep_frame`` with one frame."""
    keep(tmp_path / "frames")
    return tmp_path / "frames"


def keep(folder: Path, n: int = 1) -> None:
    mesh = folder.parent / "box.stl"
    for _ in range(n):
        kept(folder, PROBLEM, [found(PROBLEM, mesh if mesh.is_file() else box_mesh(mesh))])


def test_results_go_beside_the_folder_or_where_they_are_wanted(
    frames: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: dict[str, Any] = {}
    monkeypatch.setattr(page_app, "serve", lambda session, **given: asked.update(given, session=session))
    for words, out in (((), tmp_path / "frames-runs"), (("--out", str(tmp_path / "there")), tmp_path / "there")):
        assert main(["view", "--watch", str(frames), *words]) == 0
        assert asked["watch"].out == out
        asked["watch"].close()


# The program itself


@contextmanager
def program(frames: Path) -> Iterator[subprocess.Popen[str]]:
    """The page of the folder, with a method that is done soon."""
    session = frames.parent / "quick.toml"
    save_session(resolve({"method": {"name": "refine", "iterations": 3}, "physics": {"enabled": False}}), session)
    words = ["view", str(session), "--watch", str(frames), "--port", "0", "--no-open-browser"]
    child = subprocess.Popen(
        [sys.executable, "-m", "verefine_viz.cli", *words], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    try:
        yield child
    finally:
        child.kill()
        child.communicate()


def until(child: subprocess.Popen[str], holds: Callable[[], bool]) -> None:
    end = time.monotonic() + PATIENCE_S
    while not holds():
        assert child.poll() is None, child.communicate()[0]
        assert time.monotonic() < end, "it never happened"
        time.sleep(0.05)


def test_killed_and_started_again_it_goes_on_and_ctrl_c_leaves_a_whole_batch(frames: Path, processes: None) -> None:
    run = frames.parent / "frames-runs" / "frames"

    def solved() -> list[str]:
        return done(run)

    with program(frames) as child:
        until(child, lambda: len(solved()) == 1)
        keep(frames, 3)
        until(child, lambda: len(solved()) >= 2)
        workers = psutil.Process(child.pid).children(recursive=True)
        assert workers
        child.kill()
        assert child.wait() == -signal.SIGKILL
        assert not psutil.wait_procs(workers, timeout=60)[1], "workers outlived the program"
    before = {file: file.stat().st_mtime_ns for file in map(Runs(run / "runs").path, solved())}
    with program(frames) as child:
        until(child, lambda: len(solved()) == 4)
        keep(frames)
        until(child, lambda: len(solved()) == 5)
        workers = psutil.Process(child.pid).children(recursive=True)
        child.send_signal(signal.SIGINT)
        said, _ = child.communicate(timeout=60)
        assert child.returncode == 0, said
        assert "Traceback" not in said
        assert f"watching {frames}; results in {frames.parent / 'frames-runs'}\n" in said
        assert not psutil.wait_procs(workers, timeout=60)[1], "workers outlived the program"
    assert before == {file: file.stat().st_mtime_ns for file in before}, "a frame was solved twice"
    assert not list(run.rglob("*.part"))
    assert [row.frame for row in read_batch(run).rows] == [f"1/{k}" for k in range(1, 6)]
