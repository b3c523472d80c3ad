"""Whole batches through the real command line: files, resuming after a kill, workers, failures, Ctrl-C."""

from __future__ import annotations

import fcntl
import json
import os
import pty
import select
import signal
import subprocess
import termios
import threading
from pathlib import Path

import psutil
import pytest

from tests.batch.frames import (
    ROOT,
    batch_here,
    command,
    damaged,
    depth_file,
    make_frames,
    started_batch,
    write_session,
)
from tests.batch.killed_batches import without_times
from tests.batch.outputs import done, stop_in_the_middle
from tests.scenes.bop_folder import Made
from verefine_viz.run.session_file import load_session
from verefine_viz.scenes.results_csv import read_results

pytestmark = pytest.mark.usefixtures("processes")

N_FRAMES = 5


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Made:
    return make_frames(tmp_path_factory.mktemp("boxes"), N_FRAMES)


@pytest.fixture(scope="module")
def session(made: Made, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_session(tmp_path_factory.mktemp("session"), made, recording={"keep": "all", "maps": False})


@pytest.fixture(scope="module")
def uninterrupted(session: Path, tmp_path_factory: pytest.TempPathFactory, processes: None) -> Path:
    """A batch with one worker, run to its end."""
    out = tmp_path_factory.mktemp("uninterrupted") / "out"
    done = batch_here(session, out, "--workers", 1)
    assert (done.returncode, done.stderr.count("Traceback")) == (0, 0), done.stderr
    return out


def workers_of(child: subprocess.Popen[str]) -> list[psutil.Process]:
    children = psutil.Process(child.pid).children()
    return [p for p in children if "spawn_main" in " ".join(p.cmdline())]


def test_a_batch_leaves_these_files(uninterrupted: Path, session: Path, made: Made) -> None:
    names = {p.relative_to(uninterrupted).as_posix() for p in uninterrupted.rglob("*") if p.is_file()}
    frames = [f"{7:06d}_{i:06d}" for i in range(N_FRAMES)]
    expected = {"session.toml", "run.json", "results.csv", "frames.csv", "frames.parquet", ".answers", ".lock"}
    assert names == expected | {f"runs/{f}.vfrun" for f in frames} | {f"recordings/{f}.rrd" for f in frames}
    assert load_session(uninterrupted / "session.toml") == load_session(session)
    rows = read_results(uninterrupted / "results.csv")
    assert [(r.scene_id, r.im_id, r.obj_id) for r in rows] == [(7, i, o) for i in range(N_FRAMES) for o in (2, 5, 2)]
    _, objects = without_times(uninterrupted)
    assert [(o["im_id"], o["instance_id"], o["status"]) for o in objects] == [
        (str(i), str(k), "ok") for i in range(N_FRAMES) for k in range(3)
    ]
    run = json.loads((uninterrupted / "run.json").read_text())
    assert run["status"] == "finished"
    assert run["totals"]["frames_done"] == N_FRAMES
    assert run["totals"]["objects"] == 3 * N_FRAMES
    assert run["packages"]["pybullet"] != "missing"


def test_ctrl_c_keeps_what_is_done(uninterrupted: Path, session: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    with started_batch(session, out, "--workers", 1) as child:
        n_done = stop_in_the_middle(child, out, N_FRAMES)
        workers = workers_of(child)
        os.killpg(child.pid, signal.SIGINT)
        os.killpg(child.pid, signal.SIGCONT)
        _, errors = child.communicate(timeout=60)
    assert child.returncode == 128 + signal.SIGINT
    assert "Traceback" not in errors
    assert errors.rstrip().endswith("stopped")
    assert psutil.wait_procs(workers, timeout=30)[1] == []
    assert json.loads((out / "run.json").read_text())["status"] == "stopped"
    # The worker may have finished its frame.
    assert n_done <= len(without_times(out)[1]) // 3 <= n_done + 1
    assert batch_here(session, out, "--workers", 1).returncode == 0
    assert without_times(out) == without_times(uninterrupted)
    assert not list(out.rglob("*.part"))


def test_a_terminal_that_is_closed_ends_the_batch_tidily(session: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    ours, theirs = pty.openpty()

    def take_terminal() -> None:  # Whose end then sends SIGHUP.
        fcntl.ioctl(0, termios.TIOCSCTTY, 0)

    with subprocess.Popen(
        command("batch", session, "--out", out, "--workers", 1), stdin=theirs, stdout=theirs, stderr=theirs,
        cwd=ROOT, start_new_session=True, preexec_fn=take_terminal,
    ) as child:  # fmt: skip
        os.close(theirs)
        reading = threading.Thread(target=drain, args=(ours, out), daemon=True)
        reading.start()
        reading.join(timeout=200)
        os.close(ours)
        assert child.wait(timeout=60) == 128 + signal.SIGHUP
    assert json.loads((out / "run.json").read_text())["status"] == "stopped"
    assert len(without_times(out)[1]) >= 3


def drain(terminal: int, out: Path) -> None:
    """Reads what is written to a terminal until the batch has done a frame."""
    while not done(out):
        if select.select([terminal], [], [], 0.05)[0]:
            os.read(terminal, 4096)


def test_a_bad_frame_is_reported_and_the_others_go_on(
    uninterrupted: Path, session: Path, made: Made, tmp_path: Path
) -> None:
    out, file = tmp_path / "out", depth_file(made, 1)
    with damaged(file):
        done = batch_here(session, out, "--workers", 1)
    assert done.returncode == 1
    assert any("7/1" in line and str(file) in line for line in done.stdout.splitlines())
    assert "Traceback" not in done.stderr
    _, objects = without_times(out)
    bad = [o for o in objects if o["im_id"] == "1"]
    assert [(o["status"], o["instance_id"], o["has_truth"]) for o in bad] == [
        ("failed", str(k), "True") for k in range(3)
    ]
    assert all(str(file) in o["message"] for o in bad)
    others = [o for o in without_times(uninterrupted)[1] if o["im_id"] != "1"]
    assert [o for o in objects if o["im_id"] != "1"] == others
    # Mended, but not asked to try again: it stays as it was.
    as_it_was = batch_here(session, out, "--workers", 1)
    assert (as_it_was.returncode, "--retry-failed" in as_it_was.stdout) == (1, True)
    # Asked to: only the failed frame is solved, and all is as if nothing had happened.
    again = batch_here(session, out, "--workers", 1, "--retry-failed")
    assert again.returncode == 0
    assert f"({N_FRAMES - 1} done before)" in again.stdout
    assert without_times(out) == without_times(uninterrupted)


def test_an_object_whose_model_is_damaged_is_a_failure_until_it_is_mended(
    uninterrupted: Path, session: Path, made: Made, tmp_path: Path
) -> None:
    out, file = tmp_path / "out", made.root / "models" / "obj_000005.ply"
    with damaged(file):
        done = batch_here(session, out, "--workers", 1)
    assert done.returncode == 1
    assert str(file) in done.stdout
    assert "--retry-failed" in done.stdout.splitlines()[-1]
    assert {o["status"] for o in without_times(out)[1] if o["obj_id"] == "5"} == {"left_out"}
    # Mended, but not asked to try again: it stays as it was, and says so.
    as_it_was = batch_here(session, out, "--workers", 1)
    assert (as_it_was.returncode, as_it_was.stdout.splitlines()[-1]) == (1, done.stdout.splitlines()[-1])
    again = batch_here(session, out, "--workers", 1, "--retry-failed")
    assert again.returncode == 0
    assert without_times(out) == without_times(uninterrupted)
