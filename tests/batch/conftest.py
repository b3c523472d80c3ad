"""A batch of small frames, and what it comes to when nothing goes wrong."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.batch.at_once import Loop
from tests.batch.frames import batch_here, make_frames, write_session
from tests.scenes.bop_folder import Made

N_FRAMES = 6


@pytest.fixture
def loop(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Loop:
    return Loop(tmp_path / "out", monkeypatch)


@pytest.fixture(scope="session")
def made(tmp_path_factory: pytest.TempPathFactory) -> Made:
    return make_frames(tmp_path_factory.mktemp("boxes"), N_FRAMES)


@pytest.fixture(scope="session")
def session(made: Made, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Its session file."""
    return write_session(
        tmp_path_factory.mktemp("session"), made,
        method={"name": "pir", "iterations": 1}, recording={"keep": "all", "maps": False},
    )  # fmt: skip


@pytest.fixture(scope="session")
def whole(session: Path, tmp_path_factory: pytest.TempPathFactory, processes: None) -> Path:
    """Its folder, from one worker process of this machine."""
    out = tmp_path_factory.mktemp("whole") / "out"
    done = batch_here(session, out, "--workers", 1)
    assert (done.returncode, done.stderr.count("Traceback")) == (0, 0), done.stderr
    return out
