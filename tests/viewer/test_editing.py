"""What the page says when a person goes on from a pose moved by hand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.viewer.fake_tools import DRAGGED, FakeTools
from verefine_viz.core.errors import InputError
from verefine_viz.core.geometry import axis_angle, transform
from verefine_viz.core.settings import MethodSettings, Session
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.debugger import Debugger
from verefine_viz.viewer.drawing.bandit_tables import arms_table
from verefine_viz.viewer.export import Exporter
from verefine_viz.viewer.handlers.edit_handlers import Unconfirmed
from verefine_viz.viewer.panels.bandit_panel import chosen
from verefine_viz.viewer.text.headline import headline
from verefine_viz.viewer.text.pose_words import shift_mm


def debugger(method: str = "rir", frame: str = "0/1") -> Debugger:
    session = Session(title="boxes", method=MethodSettings(name=method, iterations=2, exploration=0.1))
    return Debugger(session, None, FakeTools).carry_out([c.OpenFrame(frame)])


def test_the_page_says_that_the_moved_hypothesis_is_next_and_then_why_it_was_taken() -> None:
    for method in ("rir", "even", "expl", "vf_breadth", "vf_depth"):
        d = debugger(method).carry_out([c.Step(), c.SelectArm(2), c.EditPose(), DRAGGED, c.ForkFromPose()])
        assert d.message.startswith("Hypothesis 3 goes on"), method
        assert "refined next" in d.message, method
        view = d.carry_out([c.Step()]).view(deep=False)
        assert view.at(2).arm == 2, method
        assert "Iteration 2 took hypothesis 3" in chosen(view), method
        assert "hypothesis 3 of 3 (its pose was edited" in headline(view), method


def test_before_the_first_iteration_the_moved_hypothesis_is_named_as_the_next() -> None:
    view = debugger().carry_out([c.SelectArm(2), c.EditPose(), DRAGGED, c.ForkFromPose()]).view()
    assert "First comes hypothesis 3" in chosen(view)
    assert "3 ◂" in arms_table(view)


def test_where_objects_take_turns_it_says_when() -> None:
    d = debugger("vf_depth", "0/2").carry_out([c.Focus(1), c.EditPose(), DRAGGED, c.ForkFromPose()])
    assert d.message.startswith("Hypothesis 1 of box #1 ")
    assert "as soon as box #1 is next in turn" in d.message


def test_a_pose_without_iterations_left_is_scored_and_not_gone_on_from_although_the_run_goes_on() -> None:
    d = debugger("rir", "0/2").carry_out([c.RunTo(7), c.Focus(0), c.EditPose(), DRAGGED])
    assert "No iteration is left here" in d.message
    with pytest.raises(InputError, match=r"is left for box #0 at iteration 7, so .*; press “Cancel”, go back on the"):
        d.apply(c.ForkFromPose())
    assert not d.workspace.run.is_done
    assert d.options.edited is not None
    assert len(d.workspace.work.branches) == 1
    d.carry_out([c.EditPose(on=False), c.Seek(1), c.EditPose(), DRAGGED, c.ForkFromPose()])
    assert d.message.startswith("Hypothesis ")


def test_nothing_goes_on_from_a_pose_at_the_end_of_a_run() -> None:
    for method in ("rir", "even", "expl", "vf_breadth", "vf_depth"):
        d = debugger(method).carry_out([c.RunUntil("end"), c.EditPose()])
        assert "No iteration is left here" in d.message, method
        with pytest.raises(InputError, match="no iteration is left for box"):
            d.apply(c.ForkFromPose())
        assert len(d.workspace.work.branches) == 1, method


def test_a_pose_that_was_not_moved_is_not_gone_on_from() -> None:
    d = debugger(frame="0/2").carry_out([c.Step(), c.SelectArm(2), c.EditPose()])
    for again in (False, True):
        with pytest.raises(InputError, match=r"the pose was not moved yet; drag .* or press “Cancel”"):
            d.apply(c.ForkFromPose())
        assert d.options.edited is not None
        assert (len(d.workspace.work.branches), d.workspace.session.edits) == (1, ())
        if not again:  # Moved and put back: as if nobody had touched it.
            assert d.options.edited_from is not None
            d.carry_out([DRAGGED, c.DragPose(d.options.edited_from)])
    d.carry_out([DRAGGED, c.ForkFromPose()])
    assert (len(d.workspace.work.branches), len(d.workspace.session.edits)) == (2, 1)


def test_a_session_that_moves_poses_says_so_when_it_is_opened() -> None:
    d = debugger(frame="0/2").carry_out([c.Focus(1), c.SelectArm(2)])
    first = d.view().problem.instances[1].hypotheses[2].T_cam_obj
    put = first @ transform(axis_angle([0, 1, 0], np.deg2rad(20)), [0.012, 0, 0])
    drag = c.DragPose(tuple(float(x) for x in put.ravel()))
    d.carry_out([c.EditPose(), drag, c.ForkFromPose()])
    shift = shift_mm(first, put, d.view().target.model.points)
    where = f"{shift:.1f} mm and 20.0° from its initial pose."
    early = d.workspace.session
    assert f"before iteration 1, {where}" in headline(opened(early).view())
    late = early.model_copy(update={"edits": (early.edits[0].model_copy(update={"after_iteration": 2}),)})
    assert f"after iteration 2, {where}" in headline(opened(late).view())
    many = early.model_copy(update={"edits": 5 * early.edits})
    assert "2 more are edited" in headline(opened(many).view())


def test_a_moved_pose_is_not_lost_before_a_person_says_so() -> None:
    for command in (
        c.Step(), c.StepStage(), c.RunUntil("end"), c.RunTo(3), c.TogglePause(), c.Back(), c.Seek(0), c.SeekEnd(),
        c.Focus(0), c.ShowScene(), c.SelectArm(1), c.EditPose(), c.Restart(), c.Fork(), c.OpenFrame("0/2"),
        c.ShowBranch(0),
    ):  # fmt: skip
        d = debugger().carry_out([c.Step(), c.EditPose(), DRAGGED])
        with pytest.raises(Unconfirmed, match="pose that you moved would be lost") as refused:
            d.apply(command)
        at = (d.options.edited, d.workspace.frame, d.workspace.run.length)
        assert at == (DRAGGED.T_cam_obj, "0/1", 1), command
        d.carry_out([refused.value.command])  # The link goes on from it.
        assert d.workspace.run.edits[0].T_cam_obj == DRAGGED.T_cam_obj, command
        d.carry_out([command])


def test_a_pose_that_was_not_moved_or_is_let_go_keeps_nobody_from_stepping() -> None:
    d = debugger().carry_out([c.EditPose(), c.Step()])
    assert d.options.edited is None
    d.carry_out([c.EditPose(), DRAGGED, c.EditPose(on=False), c.Step()])
    assert (d.workspace.run.length, d.workspace.run.edits) == (2, ())


def test_a_moved_pose_that_nothing_can_go_on_from_is_let_go_by_a_link() -> None:
    d = debugger().carry_out([c.RunUntil("end"), c.EditPose(), DRAGGED, c.ColorCloud()])
    with pytest.raises(Unconfirmed, match="pose that you moved would be lost") as refused:
        d.apply(c.Back())
    assert refused.value.command == c.EditPose(on=False)
    d.carry_out([refused.value.command, c.Back()])
    assert d.workspace.run.cursor == d.workspace.run.length - 1


def test_saving_says_that_the_edited_pose_is_not_in_the_file(tmp_path: Path) -> None:
    exporter = Exporter(None, tmp_path)  # pyright: ignore[reportArgumentType]
    d = Debugger(Session(title="boxes"), None, FakeTools, write=exporter).carry_out([c.EditPose(), c.SaveSession("a")])
    assert d.message.endswith("a.toml")
    d.carry_out([DRAGGED, c.SaveSession("b")])
    assert "not the edited pose" in d.message


class TwoBoxes(FakeTools):
    """The second frame alone."""

    @property
    def frames(self) -> tuple[str, ...]:
        return ("0/2",)


def opened(session: Session) -> Debugger:
    """The debugger on a session that was read from a file."""
    return Debugger(Session.model_validate(session.model_dump()), None, TwoBoxes)
