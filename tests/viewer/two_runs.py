"""Two runs of fake parts, side by side: what the tests of a comparison share."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from tests.viewer.fake_tools import FakeTools
from verefine_viz.core.problem import Problem
from verefine_viz.core.settings import MethodSettings, Session
from verefine_viz.recording.recorder import Recorder
from verefine_viz.recording.verify import first_difference
from verefine_viz.run.record import Answer, RunEnd
from verefine_viz.run.run_file import SUFFIX, RunFile
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.debugger import Debugger
from verefine_viz.viewer.snapshot.comparison_snapshot import ComparisonSnapshot

SESSION = Session(method=MethodSettings(iterations=2))
SIR = (("method.name", "sir"),)
TWO = c.OpenFrame("0/2")


def debugger(session: Session = SESSION) -> Debugger:
    return Debugger(session, None, FakeTools)


def sides(d: Debugger) -> ComparisonSnapshot:
    found = d.view().comparison
    assert found is not None
    return found


def same(a: Debugger, b: Debugger) -> None:
    assert a.options == b.options
    for one, other in zip(a.workspace.work.branches, b.workspace.work.branches, strict=True):
        assert (one.name, one.run.cursor) == (other.name, other.run.cursor)
        assert first_difference(one.run.iterations, other.run.iterations) is None
    assert (a.workspace.work.index, a.workspace.work.comparison) == (
        b.workspace.work.index,
        b.workspace.work.comparison,
    )


# Recordings


class Numbered(FakeTools):
    """Frames whose number is in the problem as well, as in real data."""

    def problem(self, frame: str) -> Problem:
        return replace(super().problem(frame), im_id=int(frame[-1]))


def record(path: Path, session: Session, frame: str = "0/2") -> Path:
    tools = Numbered(session)
    problem = tools.problem(frame)
    recorder, file = Recorder(path, session, problem, None), RunFile(path.with_suffix(SUFFIX), session)
    tools.run(problem, (recorder, file)).finish()
    file.finish(RunEnd(answers=(Answer(frame=frame, status="ok"),)))
    recorder.close(file.path.read_bytes())
    file.path.unlink()
    return path


def page(session: Session = SESSION) -> Debugger:
    return Debugger(session, None, Numbered)
