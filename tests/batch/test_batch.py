"""Whole batches through the real command line: files, damage, Ctrl-C, kills; every end is that of one left alone."""

from __future__ import annotations

import fcntl
import json
import os
import pty
import random
import select
import signal
import subprocess
import termios
import threading
from functools import partial
from pathlib import Path

import psutil
import pytest

from tests.batch.conftest import N_FRAMES
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
from tests.batch.killed_batches import done, killed_until_done, n_done, stop_in_the_middle, without_times, workers_of
from tests.light_frames import write_light_frames
from tests.scenes.bop_folder import Made
from verefine_viz.batch.index import read_batch
from verefine_viz.run.session_file import load_session
from verefine_viz.scenes.results_csv import read_results

pytestmark = pytest.mark.usefixtures("processes")

N_KILLS = 2


def test_a_batch_leaves_these_files(whole: Path, session: Path) -> None:
    names = {p.relative_to(whole).as_posix() for p in whole.rglob("*") if p.is_file()}
    frames = [f"{7:06d}_{i:06d}" for i in range(N_FRAMES)]
    expected = {"session.toml", "run.json", "results.csv", "frames.csv", "frames.parquet", ".answers", ".lock"}
    assert names == expected | {f"runs/{f}.vfrun" for f in frames} | {f"recordings/{f}.rrd" for f in frames}
    assert load_session(whole / "session.toml") == load_session(session)
    rows = read_results(whole / "results.csv")
    assert [(r.scene_id, r.im_id, r.obj_id) for r in rows] == [(7, i, o) for i in range(N_FRAMES) for o in (2, 5, 2)]
    _, objects = without_times(whole)
    assert [(o["im_id"], o["instance_id"], o["status"]) for o in objects] == [
        (str(i), str(k), "ok") for i in range(N_FRAMES) for k in range(3)
    ]
    run = json.loads((whole / "run.json").read_text())
    assert run["status"] == "finished"
    assert (run["totals"]["frames_done"], run["totals"]["objects"]) == (N_FRAMES, 3 * N_FRAMES)
    assert run["packages"]["pybullet"] != "missing"


def test_ctrl_c_keeps_what_is_done(whole: Path, session: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    with started_batch(session, out, "--workers", 1) as child:
        n_stopped = stop_in_the_middle(child, out, N_FRAMES)
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
    assert n_stopped <= len(without_times(out)[1]) // 3 <= n_stopped + 1
    assert batch_here(session, out, "--workers", 1).returncode == 0
    assert without_times(out) == without_times(whole)
    assert not list(out.rglob("*.part"))


def test_a_terminal_that_is_closed_ends_the_batch_tidily(session: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    ours, theirs = pty.openpty()

    def take_terminal() -> None:  # Whose end then sends SIGHUP.
        fcntl.ioctl(0, termios.TIOCSCTTY, 0)

    def drain() -> None:
        """Reads what is written to the terminal until the batch has done a frame."""
        while not done(out):
            if select.select([ours], [], [], 0.05)[0]:
                os.read(ours, 4096)

    with subprocess.Popen(
        command("batch", session, "--out", out, "--workers", 1), stdin=theirs, stdout=theirs, stderr=theirs,
        cwd=ROOT, start_new_session=True, preexec_fn=take_terminal,
    ) as child:  # fmt: skip
        os.close(theirs)
        reading = threading.Thread(target=drain, daemon=True)
        reading.start()
        reading.join(timeout=200)
        os.close(ours)
        assert child.wait(timeout=60) == 128 + signal.SIGHUP
    assert json.loads((out / "run.json").read_text())["status"] == "stopped"
    assert len(without_times(out)[1]) >= 3


@pytest.mark.parametrize(("part", "status", "n_kept"), [("depth", "failed", N_FRAMES - 1), ("model", "left_out", 0)])
def test_a_damaged_file_costs_its_frame_or_object_alone_until_it_is_mended(
    part: str, status: str, n_kept: int, made: Made, session: Path, whole: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    file = depth_file(made, 1) if part == "depth" else made.root / "models" / "obj_000005.ply"
    with damaged(file):
        first = batch_here(session, out, "--workers", 1)
    assert first.returncode == 1
    assert str(file) in first.stdout
    assert "Traceback" not in first.stderr
    hit = [o for o in without_times(out)[1] if (o["im_id"] == "1" if part == "depth" else o["obj_id"] == "5")]
    assert [(o["status"], o["has_truth"], str(file) in o["message"]) for o in hit] == [(status, "True", True)] * len(
        hit
    )
    assert len(hit) == (3 if part == "depth" else N_FRAMES)
    if part == "depth":
        others = [o for o in without_times(whole)[1] if o["im_id"] != "1"]
        assert [o for o in without_times(out)[1] if o["im_id"] != "1"] == others
    # Mended, but not asked to try again: it stays as it was, and says so.
    as_it_was = batch_here(session, out, "--workers", 1)
    last = as_it_was.stdout.splitlines()[-1]
    assert (as_it_was.returncode, last) == (1, first.stdout.splitlines()[-1])
    assert "--retry-failed" in last
    again = batch_here(session, out, "--workers", 1, "--retry-failed")
    assert again.returncode == 0
    assert (f"({n_kept} done before)" in again.stdout) == (n_kept > 0)
    assert without_times(out) == without_times(whole)


def test_kills_at_random_moments_change_nothing(tmp_path: Path) -> None:
    """bench/kills.py does it 20 times."""
    session = write_light_frames(tmp_path, 15)
    assert batch_here(session, tmp_path / "whole", "--workers", 1).returncode == 0
    expected, n_kills, k = without_times(tmp_path / "whole"), 0, 0
    while n_kills < N_KILLS:  # on a fast machine a batch may be done before it is killed often enough
        out = tmp_path / f"killed-{k}"
        again = command("batch", session, "--out", out, "--workers", 2)
        n_kills += killed_until_done(again, partial(n_done, out), N_KILLS - n_kills, random.Random(k)).kills
        assert without_times(out) == expected
        assert not list(out.rglob("*.part"))
        k += 1


def test_grasps_are_the_same_for_any_number_of_workers(tmp_path: Path) -> None:
    poses = {"rotation_deg": 0.0, "translation_mm": 0.0, "max_per_object": 1}
    method = {"name": "refine", "refiner": "identity", "iterations": 1}
    session = write_session(tmp_path, make_frames(tmp_path / "data", 2), hypotheses=poses, method=method)
    for n in (1, 2):
        ended = batch_here(session, tmp_path / str(n), "--grasp", "--workers", n)
        assert ended.returncode == 0, ended.stderr
    one, two = (
        [(r.frame, r.instance_id, r.grasp, r.grasp_ground_truth) for r in read_batch(tmp_path / n).rows] for n in "12"
    )
    assert one == two
    # The answers are the ground truth.
    assert all(grasp == ground_truth != "" for _, _, grasp, ground_truth in one)
    assert load_session(tmp_path / "1" / "session.toml").grasp.answers
