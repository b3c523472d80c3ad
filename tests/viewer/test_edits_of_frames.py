"""A session that moves poses by hand opens also where one of its frames does not have them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tests.viewer.tools import FakeTools
from verefine_viz.core.settings import Edit, MethodSettings, Session
from verefine_viz.session.files import load_session
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.debugger import Debugger
from verefine_viz.viewer.headline import headline
from verefine_viz.viewer.keeping import Keeping
from verefine_viz.viewer.panels.session import opened


def session(edit: Edit) -> Session:
    return Session(title="boxes", method=MethodSettings(iterations=2), edits=(edit,))


def edit_of(instance: int, hypothesis: int = 0, frame: str = "") -> Edit:
    T = tuple(float(x) for x in np.eye(4).ravel() + 0.5 * (np.arange(16) == 11))
    return Edit(after_iteration=0, instance=instance, hypothesis=hypothesis, T_cam_obj=T, frame=frame)


def test_an_edit_of_an_object_that_the_first_frame_lacks_is_kept_for_the_frame_that_has_it() -> None:
    """Frame 0/1 has box 0, frame 0/2 boxes 0 and 1."""
    d = Debugger(session(edit_of(instance=1)), None, FakeTools)
    assert (d.workspace.frame, d.workspace.run.edits) == ("0/1", ())
    assert "The session moves hypothesis 1 of instance 1 by hand, which this frame does not have" in headline(d.view())
    assert "moved by hand" not in opened(d.view())
    assert d.workspace.session.edits == (edit_of(instance=1),)
    d.carry_out([c.OpenFrame("0/2")])
    assert d.workspace.run.edits == (edit_of(instance=1),)
    assert "Hypothesis 1 of box #1 was moved by hand before iteration 1" in headline(d.view())
    assert "1 pose moved by hand" in opened(d.view())


def test_an_edit_of_a_hypothesis_that_a_frame_lacks_does_not_keep_the_session_from_opening() -> None:
    d = Debugger(session(edit_of(instance=0, hypothesis=7)), None, FakeTools)
    assert d.workspace.run.edits == ()
    assert "hypothesis 8 of instance 0 by hand, which this frame does not have" in headline(d.view())


def test_an_edit_knows_its_frame_and_the_session_opens_there() -> None:
    d = Debugger(session(edit_of(instance=0, frame="0/2")), None, FakeTools)
    assert d.workspace.frame == "0/2"
    assert len(d.workspace.run.edits) == 1
    d.carry_out([c.OpenFrame("0/1")])
    assert d.workspace.run.edits == ()
    assert "1 pose moved by hand belongs to frame 0/2." in headline(d.view())


def test_a_pose_moved_on_the_page_is_of_its_frame_and_is_saved_with_it_alone(tmp_path: Path) -> None:
    keeping = Keeping(None, tmp_path)  # pyright: ignore[reportArgumentType]
    d = Debugger(session(edit_of(instance=1)), None, FakeTools, keep=keeping)
    d.carry_out([c.SaveSession("untouched"), c.EditPose(), c.ForkFromPose(), c.SaveSession("moved")])
    untouched, moved = (Debugger(load_session(tmp_path / f"{k}.toml"), None, FakeTools) for k in ("untouched", "moved"))
    assert [e.instance for e in untouched.workspace.session.edits] == [1]
    assert [(e.instance, e.frame) for e in moved.workspace.session.edits] == [(0, "0/1")]
    assert moved.workspace.run.edits == moved.workspace.session.edits
