"""A full disk: the line names the file that it refused, nothing is half-written, and the same command goes on."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
import psutil
import pytest

from tests.batch.at_once import Loop, failed, solved
from tests.batch.conftest import N_FRAMES
from tests.batch.frames import ROOT, PoolHere, batch_here, command, started_batch
from tests.batch.killed_batches import done, n_done, stop_in_the_middle, without_times
from tests.full_disk import file_limit
from tests.made_runs import answer, finished
from verefine_viz import cli
from verefine_viz.batch import run_batch as runner
from verefine_viz.batch import worker_pool as pool
from verefine_viz.batch.frame_work import FrameWork
from verefine_viz.batch.runs import Runs, read_run
from verefine_viz.core.errors import InputError, VerefineError
from verefine_viz.core.geometry import axis_angle, transform
from verefine_viz.run.record import RunRecord
from verefine_viz.run.run_header import failed_run

pytestmark = pytest.mark.usefixtures("processes")


def said(capsys: pytest.CaptureFixture[str]) -> str:
    (line,) = capsys.readouterr().err.splitlines()
    return line.removeprefix("verefine-viz: ")


class Answering(PoolHere):
    """Has an answer for every frame at once, the same for the same frame: some 8.5 kB in the run file, 1.6 kB in
    frames.csv, 3 kB in results.csv.
    """

    def solve(self, items: Iterable[str]) -> Iterator[RunRecord]:
        assert isinstance(self._work, FrameWork)
        return map(self._answered, items)

    def _answered(self, frame: str) -> RunRecord:
        im_id = int(frame.partition("/")[2])
        pose = transform(axis_angle(np.array([0.36, 0.48, 0.8]), 0.1 + im_id), np.array([0.1, 0.2, 0.7]) / 3)
        rows = [
            answer(7, im_id, instance_id=k, obj_id=5, score=1 / (im_id + k + 1), T_cam_obj=pose, message="long " * 10)
            for k in range(12)
        ]
        record = finished(frame, rows, seconds=0.1)
        try:
            Runs(self._work.out / "runs").save(self._work.session, record)
        except VerefineError as error:
            return failed_run(self._work.session, {}, frame, str(error))
        return record


@pytest.mark.parametrize(("n_bytes", "refused"), [(3_300, "runs/000007_000000.vfrun"), (12_000, ".answers")])
def test_a_batch_names_the_file_and_goes_on_when_there_is_room(
    n_bytes: int, refused: str, session: Path, tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.setattr(pool, "Pool", Answering)
    out, batch = tmp_path / "out", ["batch", str(session), "--workers", "1", "--out"]
    with file_limit(n_bytes):
        assert cli.main([*batch, str(out)]) == 2
    assert str(out / refused) in said(capsys)
    assert read_run(out).status == "stopped"
    assert not list(out.rglob("*.part"))
    n = n_done(out)
    assert cli.main([*batch, str(out)]) == 0
    assert (f"({n} done before)" in capsys.readouterr().out) == (n > 0)
    assert cli.main([*batch, str(tmp_path / "roomy")]) == 0
    assert without_times(out) == without_times(tmp_path / "roomy")


def test_a_disk_that_fills_in_the_middle_loses_nothing(session: Path, whole: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    with started_batch(session, out, "--workers", 1) as child:
        n_before = stop_in_the_middle(child, out, N_FRAMES)
        process = psutil.Process(child.pid)
        for one in (process, *process.children()):
            one.rlimit(psutil.RLIMIT_FSIZE, (100, one.rlimit(psutil.RLIMIT_FSIZE)[1]))
        process.resume()
        _, errors = child.communicate(timeout=120)
    assert child.returncode == 2
    (line,) = errors.splitlines()
    assert str(out / "runs" / "000007_") in line
    assert read_run(out).status == "stopped"
    n = n_done(out)
    assert n_before <= n <= n_before + 1  # The worker may have finished its frame.
    again = batch_here(session, out, "--workers", 1)
    assert again.returncode == 0, again.stderr
    assert f"({n} done before)" in again.stdout
    assert without_times(out) == without_times(whole)
    assert not list(out.rglob("*.part"))


def test_a_full_disk_ends_the_batch_instead_of_failing_every_frame(loop: Loop) -> None:
    loop.frames(3)
    loop.patch.setattr(runner, "free_bytes", lambda folder: 0)
    with pytest.raises(InputError, match="0/1"):
        loop.run(lambda f: failed(f, "cannot write it") if f == "0/1" else solved(f))
    assert done(loop.out) == ["0/0"]
    outcome = loop.run()
    assert (outcome.n_resumed, outcome.n_failed) == (1, 0)


def test_a_report_is_whole_or_not_there(whole: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run = shutil.copytree(whole, tmp_path / "run")
    assert cli.main(["report", str(run), "--workers", "1"]) == 0  # Compiles kernels, whose files may be larger.
    assert "<html" in (run / "report.html").read_text()
    capsys.readouterr()
    (run / "report.html").write_text("older")
    with file_limit(10_000):
        assert cli.main(["report", str(run), "--workers", "1"]) == 2
    assert "report.html" in said(capsys)
    assert (run / "report.html").read_text() == "older"
    assert not list(run.rglob("*.part"))


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="this system has no /dev/full")
def test_output_that_goes_to_a_full_disk() -> None:
    with Path("/dev/full").open("w") as full:
        ended = subprocess.run(
            command("datasets"), stdout=full, stderr=subprocess.PIPE, text=True, cwd=ROOT,
            env=os.environ | {"COLUMNS": "200"}, check=False,
        )  # fmt: skip
    assert ended.returncode == 2
    assert len(ended.stderr.splitlines()) == 1
