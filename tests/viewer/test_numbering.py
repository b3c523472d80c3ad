"""Iterations are numbered 1, 2, … without a gap, whatever was done to a run: marks and links count on it."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.viewer.fake_tools import DRAGGED, FakeTools
from tests.viewer.test_answer import SearchTools
from tests.viewer.two_runs import SESSION, SIR, TWO, page, record
from verefine_viz.core.settings import MethodSettings, Session
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.debugger import Debugger
from verefine_viz.viewer.snapshot.snapshot import visit

END = c.RunUntil("end")
WIDER = (("method.exploration", 2.0),)


def check(d: Debugger) -> None:
    for branch in range(len(d.workspace.work.branches)):
        view = d.carry_out([c.ShowBranch(branch)]).view()
        assert [i.index for i in view.iterations] == list(range(1, len(view.iterations) + 1))
        assert all(view.at(mark.iteration).index == mark.iteration for mark in view.marks)
        for iteration in view.iterations:
            assert d.carry_out([visit(view, iteration)]).workspace.run.iteration is iteration


@pytest.mark.parametrize(("name", "tools"), [("rir", FakeTools), ("vf_depth", FakeTools), ("physim_mcts", SearchTools)])
def test_after_going_back_forking_comparing_and_restarting(name: str, tools: type[FakeTools]) -> None:
    session = Session(method=MethodSettings(name=name, iterations=2))
    d = Debugger(session, None, tools).carry_out([TWO, c.RunTo(3), c.Back(), c.Back(), c.Step(), c.Fork(), END])
    by_hand = [c.Seek(1), c.EditPose(), DRAGGED, c.ForkFromPose()]
    check(d.carry_out([*by_hand, c.ShowBranch(0), END, c.Fork(WIDER, 1, run=True)]))
    if tools is FakeTools:
        check(d.carry_out([c.CompareRun(SIR), c.SwapSides()]))
    check(d.carry_out([c.Restart(), c.Step(), c.OpenFrame("0/1"), END]))


@pytest.mark.usefixtures("processes")
def test_of_a_recording(tmp_path: Path) -> None:
    check(page().carry_out([c.OpenRecording(str(record(tmp_path / "rir.rrd", SESSION)))]))
