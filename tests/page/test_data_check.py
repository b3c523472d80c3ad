"""A frame is shown before its data are checked, which happens once for all runs of it."""

from __future__ import annotations

import pytest

from tests.page.conftest import SESSION, Posted
from tests.page.fake_tools import FakeTools
from verefine_viz.core.doubt import Doubt, DoubtKind
from verefine_viz.core.problem import Problem
from verefine_viz.page import protocol as p
from verefine_viz.page.verbs import Debugger
from verefine_viz.page.workspace import Workspace


def test_doubts_come_after_the_frame_and_are_worked_out_once(posted: Posted, monkeypatch: pytest.MonkeyPatch) -> None:
    checked: list[str] = []

    def check(problem: Problem) -> tuple[Doubt, ...]:
        checked.append(problem.frame)
        return (Doubt(DoubtKind.DEPTH_SCALE, "depth that is 10 times smaller would fit"),)

    monkeypatch.setattr("verefine_viz.calibration.consistency.data_doubts", check)
    d = Debugger(Workspace(SESSION, None, FakeTools), posted)
    d.welcome(1)
    (frame,) = posted.of("frame")
    assert (frame["doubts"], checked, posted.of("doubts")) == ([], [], [])
    assert d.later()
    (message,) = posted.of("doubts")
    assert [one["kind"] for one in message["doubts"]] == ["depth_scale"]
    d.carry_out([p.Restart(d.space.work.first.index, {"method.exploration": 0.3})])
    d.welcome(2)
    assert [len(one["doubts"]) for one in posted.of("frame")[1:]] == [1, 1]
    assert len(checked) == 1
