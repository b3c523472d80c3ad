from __future__ import annotations

import os
import subprocess
import urllib.request
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import psutil
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.fakes import box_problem
from tests.recording.runs import ends_of_messages, new_run, recorded_run, session
from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import InputError
from verefine_viz.core.records import Iteration
from verefine_viz.recording import recorder
from verefine_viz.recording.entry import Entry
from verefine_viz.recording.reader import Recorded
from verefine_viz.recording.replay import open_viewer, verdict, verify
from verefine_viz.recording.unfinished import part_path
from verefine_viz.session.engine import Run


def again(recorded: Recorded) -> Run:
    return new_run(recorded.session, box_problem(3, 2))


@pytest.mark.parametrize("name", ["refine", "pir", "sir", "rir"])
def test_the_same_run_verifies(tmp_path: Path, name: str) -> None:
    recorded_run(tmp_path / "run.rrd", session(name))
    found = verdict(tmp_path / "run.rrd", again)
    assert (found.difference, found.ends_early, found.n_compared) == (None, False, found.n_planned)
    assert found.in_words == f"no difference in {found.n_planned} iterations"


def record_changed(
    path: Path, monkeypatch: pytest.MonkeyPatch, k: int, change: Callable[[Iteration], Iteration]
) -> None:
    def changed(iteration: Iteration, errors: Float) -> Entry:
        return Entry.of(change(iteration) if iteration.index == k else iteration, errors)

    with monkeypatch.context() as patched:
        patched.setattr(recorder, "Entry", SimpleNamespace(of=changed))
        recorded_run(path, session())


def test_one_bit_of_a_pose_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def change(iteration: Iteration) -> Iteration:
        stages = list(iteration.stages)
        T = stages[2].T_cam_obj.copy()
        T[0, 3] = np.nextafter(T[0, 3], 1)
        stages[2] = replace(stages[2], T_cam_obj=T)
        return replace(iteration, stages=tuple(stages))

    record_changed(tmp_path / "run.rrd", monkeypatch, 17, change)
    found = verify(tmp_path / "run.rrd", again)
    assert found is not None
    assert found.startswith("iteration 17: stages[2].T_cam_obj")


@pytest.mark.parametrize(
    ("k", "change", "named"),
    [
        (1, lambda i: replace(i, accepted="simulated"), "accepted"),
        (30, lambda i: replace(i, best=replace(i.best, arm=7)), "best.arm"),
        (8, lambda i: replace(i, arm=2), "arm"),
    ],
)
def test_other_changes_are_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, k: int, change: Callable[[Iteration], Iteration], named: str
) -> None:
    record_changed(tmp_path / "run.rrd", monkeypatch, k, change)
    found = verify(tmp_path / "run.rrd", again)
    assert found is not None
    assert found.startswith(f"iteration {k}: {named}")


def test_a_recording_longer_than_the_run_is_found(tmp_path: Path) -> None:
    recorded_run(tmp_path / "run.rrd", session(iterations=5))
    found = verify(tmp_path / "run.rrd", lambda r: new_run(session(iterations=4), box_problem(3, 2)))
    assert found is not None
    assert found.startswith("iteration 13: ")


def test_a_recording_whose_writer_was_killed_is_said_to_end_early(tmp_path: Path) -> None:
    s, problem = session(maps=False), box_problem(3, 2)
    writer = recorder.Recorder(tmp_path / "run.rrd", s, problem)
    run = new_run(s, problem, (writer,))
    for _ in range(7):
        run.step()
    found = verdict(tmp_path / "run.rrd", again)
    run.close()
    assert found.ends_early
    assert "ended early, after 7 of 30 iterations" in found.in_words
    assert "the same up to iteration 7" in found.in_words


@given(share=st.floats(0.5, 0.99), more=st.integers(1, 15))
@settings(max_examples=10, deadline=None)
def test_a_recording_that_was_cut_is_said_to_end_early(tmp_path_factory: pytest.TempPathFactory, share, more) -> None:
    folder = tmp_path_factory.mktemp("cut")
    recorded_run(folder / "run.rrd", session(maps=False), block=3)
    content = (folder / "run.rrd").read_bytes()
    # A little into the head of a message, which rerun takes for the end, and anywhere.
    head, at = max(k for k in ends_of_messages(content) if k <= share * len(content)) + more, int(share * len(content))
    for k in (head, at):
        (folder / "cut.rrd").write_bytes(content[:k])
        found = verdict(folder / "cut.rrd", again)
        assert found.ends_early
        assert found.in_words.startswith("ended early")


def test_a_difference_matters_more_than_an_early_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    record_changed(tmp_path / "run.rrd", monkeypatch, 2, lambda i: replace(i, accepted="mixed"))
    (tmp_path / "run.rrd").rename(part_path(tmp_path / "run.rrd"))
    found = verify(tmp_path / "run.rrd", again)
    assert found is not None
    assert found.startswith("iteration 2: accepted")


def test_another_version_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recorder, "versions", lambda: {"numpy": "0.0.1"})
    record_changed(tmp_path / "run.rrd", monkeypatch, 3, lambda i: replace(i, accepted="mixed"))
    found = verify(tmp_path / "run.rrd", again)
    assert found is not None
    assert "recorded with numpy 0.0.1 (here " in found


def test_viewer_listens_on_loopback_only(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    recorded_run(tmp_path / "run.rrd")
    viewer = open_viewer(tmp_path / "run.rrd", web=True)
    process = viewer.process
    try:
        addresses = listening(process)
        assert len(addresses) == 2
        assert set(addresses) == {"127.0.0.1"}
        with urllib.request.urlopen(viewer.address, timeout=60) as page:
            assert b"<html" in page.read().lower()
    finally:
        process.kill()
        process.wait()


def listening(process: subprocess.Popen[bytes]) -> list[str]:
    """Addresses that the process listens on, once both servers are up."""
    watched = psutil.Process(process.pid)
    for _ in range(200):
        found = [c.laddr.ip for c in watched.net_connections("tcp") if c.status == psutil.CONN_LISTEN]
        if len(found) >= 2 or process.poll() is not None:
            return found
        try:
            process.wait(0.1)
        except subprocess.TimeoutExpired:
            continue
    return []


def test_viewer_refuses_what_is_no_recording(tmp_path: Path) -> None:
    (tmp_path / "x.rrd").write_bytes(os.urandom(50))
    with pytest.raises(InputError, match="not a rerun recording"):
        open_viewer(tmp_path / "x.rrd")
