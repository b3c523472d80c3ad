"""The history of a hypothesis follows the cursor through more plays than a table can hold."""

from __future__ import annotations

import re

import pytest

from tests.viewer.fake_tools import DRAGGED, FakeTools
from verefine_viz.core.settings import MethodSettings, Session
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.debugger import Debugger
from verefine_viz.viewer.drawing.bandit_tables import arm_history

PLAYS = 24


@pytest.fixture(scope="module")
def debugger() -> Debugger:
    """A finished run with more than a dozen plays on each hypothesis."""
    session = Session(method=MethodSettings(name="even", iterations=PLAYS))
    return Debugger(session, None, FakeTools).carry_out([c.RunUntil("end")])


def test_it_shows_the_play_at_the_cursor_and_its_neighbours(debugger: Debugger) -> None:
    view = debugger.carry_out([c.SeekEnd(), c.SelectArm(1)]).view()
    own = [i.index for i in view.own_iterations if i.arm == 1]
    assert len(own) == PLAYS
    for k, index in enumerate(own):
        rows = listed(debugger.carry_out([c.SeekStage(index, "refined"), c.SelectArm(1)]))
        near = own[max(k - 2, 0) : k + 3]
        assert [r for r in rows if r in map(str, near)] == [str(i) for i in reversed(near)]
        assert rows[-1] == "0"
        assert len(rows) <= 15


def test_it_says_how_many_plays_are_left_out_and_goes_there(debugger: Debugger) -> None:
    debugger.carry_out([c.SeekEnd(), c.SelectArm(1)])
    own = [i.index for i in debugger.view().own_iterations if i.arm == 1]
    assert "later" not in arm_history(debugger.view())
    assert "12 earlier" in arm_history(debugger.view())
    middle = arm_history(debugger.carry_out([c.Seek(own[11])]).view())
    assert "6 later" in middle
    assert "6 earlier" in middle
    for there in (own[5], own[18]):
        assert f"&quot;cursor&quot;: {there}}}" in middle
    first = arm_history(debugger.carry_out([c.Seek(0)]).view())
    assert "12 later" in first
    assert "earlier" not in first


def test_a_pose_put_there_by_hand_is_a_row_below_the_play_that_went_on_from_it() -> None:
    debugger = Debugger(Session(method=MethodSettings(name="rir", iterations=2)), None, FakeTools)
    debugger.carry_out([c.Step(), c.SelectArm(2), c.EditPose(), DRAGGED, c.ForkFromPose(), c.Step(), c.SelectArm(2)])
    put = debugger.workspace.run.state.objects[0].arms[2].entries_since_edit[0]
    assert listed(debugger) == ["2", "", "0"]
    assert f"edited</td><td>{put.score.score:.3f}</td>" in arm_history(debugger.view())


def listed(debugger: Debugger) -> list[str]:
    """The first column of the table, from the top."""
    return re.findall(r"<tr[^>]*><td>([^<]*)</td>", arm_history(debugger.view()))
