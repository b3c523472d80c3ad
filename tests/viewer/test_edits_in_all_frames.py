"""A session that moves poses by hand opens also where one of its frames does not have them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.viewer.fake_tools import DRAGGED, FakeTools
from verefine_viz.core.settings import Change, Edit, MethodSettings, Session
from verefine_viz.run.session_file import load_session
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.debugger import Debugger
from verefine_viz.viewer.export import Exporter
from verefine_viz.viewer.text.headline import headline


def session(edit: Edit) -> Session:
    return Session(title="boxes", method=MethodSettings(iterations=2), edits=(edit,))


def edit_of(instance: int, hypothesis: int = 0, frame: str = "") -> Edit:
    T = tuple(float(x) for x in np.eye(4).ravel() + 0.5 * (np.arange(16) == 11))
    return Edit(after_iteration=0, instance=instance, hypothesis=hypothesis, T_cam_obj=T, frame=frame)


def test_an_edit_of_an_object_that_the_first_frame_lacks_is_kept_for_the_frame_that_has_it() -> None:
    """Frame 0/1 has box 0, frame 0/2 boxes 0 and 1."""
    d = Debugger(session(edit_of(instance=1)), None, FakeTools)
    assert (d.workspace.frame, d.workspace.run.edits) == ("0/1", ())
    assert "hypothesis 1 of instance 1, which this frame does not have" in headline(d.view())
    assert d.workspace.session.edits == (edit_of(instance=1),)
    d.carry_out([c.OpenFrame("0/2")])
    assert d.workspace.run.edits == (edit_of(instance=1),)
    assert "Hypothesis 1 of box #1 was edited" in headline(d.view())


def test_an_edit_of_a_hypothesis_that_a_frame_lacks_does_not_keep_the_session_from_opening() -> None:
    d = Debugger(session(edit_of(instance=0, hypothesis=7)), None, FakeTools)
    assert d.workspace.run.edits == ()
    assert "hypothesis 8 of instance 0, which this frame does not have" in headline(d.view())


def test_an_edit_knows_its_frame_and_the_session_opens_there() -> None:
    d = Debugger(session(edit_of(instance=0, frame="0/2")), None, FakeTools)
    assert d.workspace.frame == "0/2"
    assert len(d.workspace.run.edits) == 1
    d.carry_out([c.OpenFrame("0/1")])
    assert d.workspace.run.edits == ()
    assert "1 edited pose belongs to frame 0/2." in headline(d.view())


def test_edits_and_changes_behind_the_end_of_the_run_are_noted() -> None:
    late = edit_of(instance=0, frame="0/1").model_copy(update={"after_iteration": 999})
    change = Change(after_iteration=10**9, settings={"method": {"exploration": 0.2}})
    d = Debugger(session(late).model_copy(update={"changes": (change,)}), None, FakeTools)
    of_pose, of_setting = d.view().notes
    assert "after iteration 999" in of_pose
    assert "after iteration 1000000000" in of_setting
    longer = Change(after_iteration=2, settings={"method": {"iterations": 5}})
    d = Debugger(session(late).model_copy(update={"changes": (longer,)}), None, FakeTools)
    assert d.view().notes == (), "a change on the way may make it longer"
    d.carry_out([c.RunUntil()])
    (of_pose,) = d.view().notes
    assert "15 iterations" in of_pose


def test_a_saved_session_keeps_the_edit_of_an_object_that_is_not_there_now(exporter: Exporter, tmp_path: Path) -> None:
    absent = edit_of(instance=5, frame="0/1")
    d = Debugger(session(absent), None, FakeTools, write=exporter)
    assert d.workspace.run.edits == ()
    assert "edit" not in headline(d.view())
    d.carry_out([c.OpenFrame("0/2"), c.SaveSession("again")])
    assert load_session(tmp_path / "again.toml").edits == (absent,)


@pytest.fixture
def exporter(tmp_path: Path) -> Exporter:
    server: Any = None  # Sessions are saved without a page.
    return Exporter(server, tmp_path)


FORK = c.Fork((("method.exploration", 0.4),), 0)
MOVE = (c.EditPose(), DRAGGED, c.ForkFromPose())
IN_EACH = (*MOVE, c.OpenFrame("0/2"), *MOVE)


def moved(path: Path) -> list[tuple[int, str]]:
    """The instance and the frame of each edit in a file."""
    return [(edit.instance, edit.frame) for edit in load_session(path).edits]


def test_a_pose_moved_on_the_page_is_of_its_frame_and_is_saved_with_those_of_the_session(
    exporter: Exporter, tmp_path: Path
) -> None:
    d = Debugger(session(edit_of(instance=1)), None, FakeTools, write=exporter)
    d.carry_out([c.SaveSession("untouched"), *MOVE, c.SaveSession("moved")])
    assert (moved(tmp_path / "untouched.toml"), moved(tmp_path / "moved.toml")) == ([(1, "")], [(0, "0/1"), (1, "")])
    again = Debugger(load_session(tmp_path / "moved.toml"), None, FakeTools)
    assert [edit.instance for edit in again.workspace.run.edits] == [0]
    assert [edit.instance for edit in again.carry_out([c.OpenFrame("0/2")]).workspace.run.edits] == [1]


def test_poses_moved_in_each_frame_are_saved_together_and_again_from_either(exporter: Exporter, tmp_path: Path) -> None:
    d = Debugger(Session(title="boxes"), None, FakeTools, write=exporter).carry_out([*IN_EACH, c.SaveSession("two")])
    assert sorted(frame for _, frame in moved(tmp_path / "two.toml")) == ["0/1", "0/2"]
    again = Debugger(load_session(tmp_path / "two.toml"), None, FakeTools)
    assert again.workspace.frame == "0/2", "the one that was shown"
    assert len(again.workspace.run.edits) == len(again.carry_out([c.OpenFrame("0/1")]).workspace.run.edits) == 1
    d.carry_out([c.OpenFrame("0/1"), c.SaveSession("two")])
    assert sorted(frame for _, frame in moved(tmp_path / "two.toml")) == ["0/1", "0/2"]


def test_what_was_changed_in_another_frame_is_named_as_not_saved(exporter: Exporter, tmp_path: Path) -> None:
    d = Debugger(Session(title="boxes"), None, FakeTools, write=exporter)
    d.carry_out([FORK, *IN_EACH, c.SaveSession("here")])
    assert "it does not hold what was done in frame 0/1" in d.message
    assert [frame for _, frame in moved(tmp_path / "here.toml")] == ["0/2"]
    d.carry_out([c.OpenFrame("0/1"), c.SaveSession("there")])
    assert "it opens frame 0/1 alone" in d.message
    assert "it does not hold what was done in frame 0/2" in d.message
    assert [frame for _, frame in moved(tmp_path / "there.toml")] == ["0/1"]


def test_a_frame_that_lets_a_pose_of_every_frame_be_is_saved_apart(exporter: Exporter, tmp_path: Path) -> None:
    late = edit_of(instance=0).model_copy(update={"after_iteration": 1})
    d = Debugger(session(late), None, FakeTools, write=exporter).carry_out([c.Fork(), c.SaveSession("let_be")])
    assert "not moved here" in d.message
    assert (load_session(tmp_path / "let_be.toml").scene.frames, moved(tmp_path / "let_be.toml")) == (("0/1",), [])


def test_a_restart_does_not_say_that_poses_of_another_frame_are_gone() -> None:
    d = Debugger(Session(title="boxes"), None, FakeTools).carry_out([*MOVE, c.OpenFrame("0/2"), c.Restart()])
    assert (d.message, [edit.frame for edit in d.workspace.session.edits]) == ("", ["0/1"])
    d.carry_out([c.Restart((("method.exploration", 0.5),))])
    assert "1 edited pose is not moved again" in d.message
    assert d.workspace.session.edits == ()
