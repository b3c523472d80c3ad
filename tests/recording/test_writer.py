"""Recordings drawn in a process of their own: the same contents, nothing lost, nothing left behind."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.fakes import FakeVerifier, box_problem
from tests.recording.runs import new_run, recorded_run, session
from tests.recording.test_killed import ROOT
from verefine_viz.core.compare import first_difference
from verefine_viz.core.errors import InputError
from verefine_viz.core.problem import Problem
from verefine_viz.recording.drawn import journal_path, part_path
from verefine_viz.recording.reader import chunks_of, read_recording
from verefine_viz.recording.recorder import Recorder
from verefine_viz.recording.replay import verify
from verefine_viz.recording.row import row_of
from verefine_viz.recording.writer import WriterProcess
from verefine_viz.session.engine import Run

BARE = session(maps=False)


@pytest.fixture(scope="module")
def writer() -> Iterator[WriterProcess]:
    with WriterProcess() as process:
        yield process


def begun(path: Path, writer: WriterProcess, problem: Problem | None = None) -> Run:
    problem = problem or box_problem(3, 2)
    return new_run(BARE, problem, (Recorder(path, BARE, problem, FakeVerifier(), block=4, writer=writer),))


def contents(path: Path) -> dict[tuple[str, str], list[Any]]:
    """Every column of every entity, without what differs from file to file."""
    found: dict[tuple[str, str], list[Any]] = {}
    for chunk in sorted(chunks_of(path), key=lambda c: c.entity_path):
        batch = chunk.to_record_batch()
        for name in batch.schema.names:
            if "rerun.controls" not in name and not name.endswith(":ms"):
                found.setdefault((chunk.entity_path, name), []).extend(batch.column(name).to_pylist())
    return found


def test_contents_are_those_of_a_recording_drawn_by_the_run(tmp_path: Path, writer: WriterProcess) -> None:
    problem = box_problem(3, 2)
    recorded_run(tmp_path / "here.rrd", BARE, problem, block=4)
    for name in ("first.rrd", "second.rrd"):
        run = begun(tmp_path / name, writer, problem)
        run.finish()
        writer.wait()
        here, there = contents(tmp_path / "here.rrd"), contents(tmp_path / name)
        assert here.keys() == there.keys()
        for key in here:
            assert repr(here[key]) == repr(there[key]), key
    assert sorted(p.name for p in tmp_path.iterdir()) == ["first.rrd", "here.rrd", "second.rrd"]


def test_a_replay_finds_no_difference(tmp_path: Path, writer: WriterProcess) -> None:
    problem = box_problem(3, 2)
    begun(tmp_path / "run.rrd", writer, problem).finish()
    writer.wait()
    assert verify(tmp_path / "run.rrd", lambda _: new_run(BARE, problem)) is None
    assert read_recording(tmp_path / "run.rrd").is_complete


def test_every_iteration_is_in_the_journal_before_the_next(tmp_path: Path, writer: WriterProcess) -> None:
    run = begun(tmp_path / "run.rrd", writer)
    while not run.is_done:
        iteration = run.step()
        if not run.is_done:
            rows = read_recording(tmp_path / "run.rrd").rows
            assert first_difference(rows[-1], row_of(iteration, rows[-1].errors)) is None
    writer.wait()


def test_a_run_that_is_left_early_keeps_what_it_had(tmp_path: Path, writer: WriterProcess) -> None:
    run = begun(tmp_path / "run.rrd", writer)
    for _ in range(6):
        run.step()
    run.close()
    writer.wait()
    assert len(read_recording(tmp_path / "run.rrd").rows) == 6


@pytest.mark.parametrize("after", [0, 7])
def test_a_killed_writer_loses_nothing(tmp_path: Path, after: int) -> None:
    with WriterProcess() as writer:
        run = begun(tmp_path / "run.rrd", writer)
        for _ in range(after):
            run.step()
        assert writer.pid is not None
        os.kill(writer.pid, signal.SIGKILL)
        run.finish()
        writer.wait()
        recorded = read_recording(tmp_path / "run.rrd")
        assert recorded.is_complete
        assert len(recorded.rows) == run.length
        begun(tmp_path / "next.rrd", writer).finish()
    assert read_recording(tmp_path / "next.rrd").is_complete
    assert sorted(p.name for p in tmp_path.iterdir()) == ["next.rrd", "run.rrd"]


def test_a_killed_run_keeps_its_iterations_and_leaves_no_writer(tmp_path: Path) -> None:
    path = tmp_path / "run.rrd"
    command = [sys.executable, "-m", "tests.recording.endless", str(path), "writer"]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        pid = int(process.stdout.readline())
        for line in process.stdout:
            if int(line) >= 120:
                process.kill()
                break
        rest = process.stdout.read().split()
    assert ended(pid)
    assert not path.exists()
    recorded = read_recording(path)
    assert not recorded.is_complete
    assert len(recorded.rows) >= max([120, *map(int, rest)])
    assert journal_path(path).exists()


def ended(pid: int) -> bool:
    """Whether a process is gone, or nothing but its exit status is left of it, within ten seconds."""
    end = time.monotonic() + 10
    while time.monotonic() < end:
        try:
            if Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] == "Z":
                return True
        except OSError:
            return True
        time.sleep(0.02)
    return False


def test_closing_ends_the_process(tmp_path: Path) -> None:
    writer = WriterProcess()
    writer.close()
    begun(tmp_path / "run.rrd", writer).finish()
    pid = writer.pid
    assert pid is not None
    writer.close()
    assert (tmp_path / "run.rrd").exists()
    assert ended(pid)
    writer.close()


def test_what_cannot_be_written_is_one_line(tmp_path: Path, writer: WriterProcess) -> None:
    path = tmp_path / "run.rrd"
    part_path(path).mkdir()
    with pytest.raises(InputError, match=r"^cannot write the recording .*run\.rrd"):
        begun(path, writer)
    part_path(path).rmdir()
    run = begun(path, writer)
    path.mkdir()
    run.finish()
    with pytest.raises(InputError, match=r"^cannot write the recording .*run\.rrd: Is a directory$"):
        writer.wait()
    begun(tmp_path / "next.rrd", writer).finish()
    writer.wait()
    assert len(read_recording(tmp_path / "next.rrd").rows) == 30


def test_models_are_told_apart(tmp_path: Path, writer: WriterProcess) -> None:
    """Frames with other models, one after the other, and the first again."""
    first, second = box_problem(3), box_problem(2)
    for k, problem in enumerate((first, second, first)):
        begun(tmp_path / f"{k}.rrd", writer, problem).finish()
        writer.wait()
        assert len(read_recording(tmp_path / f"{k}.rrd").layout.branches[0].sources) == (2 if k == 1 else 3)
    a, b = contents(tmp_path / "0.rrd"), contents(tmp_path / "2.rrd")
    meshes = [key for key in a if key[1] == "Mesh3D:vertex_positions"]
    assert meshes
    assert all(np.array_equal(repr(a[key]), repr(b[key])) for key in meshes)
