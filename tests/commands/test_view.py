"""``view``: what the page opens of a batch or several, and ``view`` and ``view --watch`` as programs."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
import time
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import psutil
import pytest

from tests.batch.killed_batches import done
from tests.fakes import box_problem
from tests.made_runs import answer, finished
from tests.run.kept_frames import box_mesh, found, kept
from verefine_viz.batch.folder import RunFolder
from verefine_viz.batch.index import read_batch
from verefine_viz.batch.runs import Runs
from verefine_viz.cli import main
from verefine_viz.page import app as page_app
from verefine_viz.run.session_file import resolve, save_session

ROOT = Path(__file__).resolve().parents[2]
PROBLEM = box_problem(n_hypotheses=2)
PATIENCE_S = 240.0


@pytest.fixture
def served(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """What the page would be opened with."""
    asked: dict[str, Any] = {}
    monkeypatch.setattr(page_app, "serve", lambda session, **given: asked.update(given, session=session))
    return asked


def batch_run(folder: Path, method: str, errors_mm: tuple[float, ...], status: str = "finished") -> None:
    """A run over frames 0/0, 0/1, … with one object each."""
    folder.mkdir(parents=True)
    run = RunFolder(folder, resolve({"method": {"name": method}, "scene": {"demo": "clutter"}}))
    for k, error_mm in enumerate(errors_mm):
        row = answer(0, k, instance_id=0, obj_id=1, add_s_mm=error_mm, diameter_mm=100.0)
        run.runs.save(run.session, finished(f"0/{k}", [row]))
    run.write_json("run.json", {"status": status})
    run.close()


def test_of_one_run_the_worst_frame_comes_first(tmp_path: Path, served: dict[str, Any]) -> None:
    batch_run(tmp_path / "rir", "rir", (5.0, 40.0, 1.0))
    assert main(["view", str(tmp_path / "rir")]) == 0
    assert served["session"].scene.frames == ("0/1", "0/0", "0/2")
    assert served["session_path"] is None
    assert served["gallery"].worst.row.im_id == 1


def test_of_several_runs_the_worst_is_opened_with_the_settings_given_and_what_is_left_out_is_named(
    tmp_path: Path, served: dict[str, Any], capsys: pytest.CaptureFixture[str]
) -> None:
    batch_run(tmp_path / "rir", "rir", (5.0, 40.0))
    batch_run(tmp_path / "sir", "sir", (70.0, 2.0), "running")
    batch_run(tmp_path / "old" / "sir", "sir", (5.0, 90.0))
    assert main(["view", str(tmp_path), "--method.exploration", "0.2"]) == 0
    session = served["session"]
    assert (session.method.name, session.method.exploration) == ("sir", 0.2)
    assert session.scene.frames == ("0/0", "0/1")
    assert served["gallery"].session("rir").method.exploration == 0.2
    assert len(served["gallery"].runs) == 2
    assert str(tmp_path / "old") in capsys.readouterr().err


@pytest.mark.usefixtures("processes")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_the_page_is_served_until_ctrl_c_or_a_signal_to_end(number: signal.Signals, tmp_path: Path) -> None:
    program = [sys.executable, str(ROOT / "app.py"), "--port", "0", "--no-open-browser"]
    child = subprocess.Popen(
        program, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=tmp_path, start_new_session=True
    )
    with child:
        line = child.stdout.readline()
        address = re.search(r"http://127\.0\.0\.1:\d+", line)
        assert address, line + child.communicate()[1]
        with urllib.request.urlopen(address.group(), timeout=60) as page:
            assert page.status == 200
            assert b"<html" in page.read().lower()
        child.send_signal(number)
        output, errors = child.communicate(timeout=120)
    assert child.returncode == (0 if number == signal.SIGINT else 128 + number), errors
    assert output == ""
    assert "Traceback" not in errors


# A folder that is watched


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
    frames: Path, tmp_path: Path, served: dict[str, Any]
) -> None:
    for words, out in (((), tmp_path / "frames-runs"), (("--out", str(tmp_path / "there")), tmp_path / "there")):
        assert main(["view", "--watch", str(frames), *words]) == 0
        assert served["watch"].out == out
        served["watch"].close()


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
