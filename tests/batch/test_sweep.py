"""Sweeps through the real command line: the same bits as single runs, resumed, failures listed."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.batch.frames import batch_here, damaged, depth_file, make_frames, write_session
from tests.batch.killed_batches import without_times
from tests.scenes.bop_folder import Made

pytestmark = pytest.mark.usefixtures("processes")

SWEEP = ("--methods", "pir", "rir", "--seeds", 2)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Made:
    return make_frames(tmp_path_factory.mktemp("boxes"), 3)


@pytest.fixture(scope="module")
def session(made: Made, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_session(tmp_path_factory.mktemp("session"), made)


@pytest.fixture(scope="module")
def swept(session: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("swept") / "out"
    done = batch_here(session, out, *SWEEP, "--workers", 2)
    assert (done.returncode, done.stderr.count("Traceback")) == (0, 0), done.stderr
    assert sorted(path.name for path in out.iterdir()) == ["pir-0", "pir-1", "rir-0", "rir-1"]
    table = [line.split()[:2] for line in done.stdout.splitlines()]
    assert ["pir", "2"] in table
    assert ["rir", "2"] in table
    assert f"verefine-viz report {out}" in done.stdout
    return out


def test_a_run_of_a_sweep_has_the_bits_of_a_single_run(swept: Path, session: Path, tmp_path: Path) -> None:
    single = batch_here(
        session, tmp_path / "rir", "--method.name", "rir", "--method.seed", 1, "--hypotheses.seed", 1, "--workers", 1
    )
    assert single.returncode == 0, single.stderr
    assert without_times(tmp_path / "rir") == without_times(swept / "rir-1")
    assert without_times(swept / "rir-0") != without_times(swept / "rir-1")


def test_a_sweep_goes_on_where_it_was(swept: Path, session: Path) -> None:
    before = {path: without_times(path) for path in sorted(swept.iterdir())}
    for lost in ("rir-0/runs/000007_000001.vfrun", "pir-1/runs/000007_000002.vfrun"):
        (swept / lost).unlink()
    done = batch_here(session, swept, *SWEEP, "--workers", 1)
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("3 frames (2 done before)") == 2
    assert done.stdout.count("3 frames (3 done before)") == 2
    unchanged = [line.split(":")[0] for line in done.stdout.splitlines() if line.endswith("; nothing was left to do")]
    assert unchanged == ["pir-0", "rir-1"]
    assert {path: without_times(path) for path in before} == before


def test_frames_that_fail_are_listed_by_run(session: Path, made: Made, tmp_path: Path) -> None:
    with damaged(depth_file(made, 1)):
        done = batch_here(session, tmp_path / "out", *SWEEP, "--workers", 1)
    assert done.returncode == 1
    assert done.stdout.count("frame 7/1 failed: ") == 4
    assert "4 frames failed; the same command with --retry-failed" in done.stdout
