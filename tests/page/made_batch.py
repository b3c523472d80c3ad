"""A batch of the fake frames, with run files as a real one has them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from tests.page.conftest import SESSION
from tests.page.fake_tools import FakeTools
from verefine_viz.batch.folder import RunFolder
from verefine_viz.batch.runs import Runs
from verefine_viz.batch.summary import run_end
from verefine_viz.core.settings import Session
from verefine_viz.run.engine import Run
from verefine_viz.run.run_file import RunFile


def solve(path: Path, session: Session = SESSION, frame: str = "0/1") -> Run:
    """Solve a frame and write its run file."""
    tools, file = FakeTools(session), RunFile(path, session)
    run = tools.run(tools.problem(frame), [file])
    run.finish()
    file.finish(run_end(run, session))
    return run


def make_batch(folder: Path, session: Session = SESSION, frames: Sequence[str] = ("0/1", "0/2")) -> list[Run]:
    """Write a finished batch of frames; return its runs."""
    folder.mkdir(parents=True)
    files = RunFolder(folder, session)
    runs = [solve(Runs(folder / "runs").path(frame), session, frame) for frame in frames]
    files.write_json("run.json", {"status": "finished"})
    files.close()
    return runs
