"""Recorded runs of fake parts."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from tests.page.fake_tools import FakeTools
from tests.recording.runs import ending
from verefine_viz.core.problem import Problem
from verefine_viz.core.settings import MethodSettings, Session
from verefine_viz.recording.recorder import Recorder
from verefine_viz.run.run_file import SUFFIX, RunFile

SESSION = Session(method=MethodSettings(iterations=2))


class Numbered(FakeTools):
    """Frames whose number is in the problem as well, as in real data."""

    def problem(self, frame: str, **_: object) -> Problem:
        return replace(super().problem(frame), im_id=int(frame[-1]))


def record(path: Path, session: Session, frame: str = "0/2") -> Path:
    """Write a recording of a run."""
    tools = Numbered(session)
    problem = tools.problem(frame)
    recorder, file = Recorder(path, session, problem, None), RunFile(path.with_suffix(SUFFIX), session)
    run = tools.run(problem, (recorder, file))
    run.finish()
    file.finish(ending(run))
    recorder.close(file.path.read_bytes())
    file.path.unlink()
    return path
