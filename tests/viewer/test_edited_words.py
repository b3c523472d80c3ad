"""What panels say of the edited pose, as soon as it moves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from tests.viewer.fake_tools import FakeTools
from tests.viewer.test_plausibility_verdict import sunk
from verefine_viz.core.geometry import transform
from verefine_viz.core.observation import Support
from verefine_viz.core.problem import Placed
from verefine_viz.core.settings import MethodSettings, Session
from verefine_viz.physics.plausibility import Plausibility
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.debugger import Debugger
from verefine_viz.viewer.drawing.plausibility_picture import drawn_stage, plausibility_html
from verefine_viz.viewer.drawing.pose_tables import errors_table
from verefine_viz.viewer.panels.score_panel import score_html
from verefine_viz.viewer.text.pose_words import edited_score


def deep_by_x(moving: Placed, others: Sequence[Placed], support: Support) -> Plausibility:
    """Every pose sinks into the support plane, by as many millimetres as it has centimetres of x."""
    x_m = float(moving.T_cam_obj[0, 3])
    return replace(sunk(-1, 100 * x_m), polygon_cam=np.zeros((3, 3)))


def moved(x_m: float) -> c.DragPose:
    return c.DragPose(tuple(float(x) for x in transform(np.eye(3), [x_m, 0.08, 0.7]).ravel()))


@pytest.fixture
def debugger() -> Debugger:
    """After an iteration on two objects."""
    session = Session(title="boxes", method=MethodSettings(iterations=2))
    opened = Debugger(session, None, FakeTools, plausibility=deep_by_x)
    return opened.carry_out([c.OpenFrame("0/2"), c.Step()])


def test_physics_judges_the_edited_pose_beside_the_others_before_score_maps_are_drawn(debugger: Debugger) -> None:
    assert "edited</th>" not in plausibility_html(debugger.view())
    for x_m, said in ((0.071, "7.1"), (0.093, "9.3")):
        view = debugger.carry_out([c.EditPose(False), c.EditPose(), moved(x_m)]).view(deep=False)
        assert view.has_plausibility
        shown = plausibility_html(view)
        assert f"Edited: Sinks {said} mm into the support plane." in shown
        assert drawn_stage(view) == "edited"
    after = debugger.carry_out([c.EditPose(on=False)]).view()
    assert "edited</th>" not in plausibility_html(after)
    assert drawn_stage(after) != "edited"


def test_errors_and_score_show_the_edited_pose_beside_the_others(debugger: Debugger) -> None:
    assert "edited" not in errors_table(debugger.view())
    view = debugger.carry_out([c.SelectArm(1), c.EditPose(), moved(0.071)]).view()
    assert "edited" in errors_table(view)
    assert "answer" in errors_table(view)
    score = view.poses["edited"].score
    assert "edited" in score_html(view)
    assert f"{score.score:.3f}" in score_html(view)


def test_a_kept_pose_of_another_hypothesis_is_told_from_the_edited_one(debugger: Debugger) -> None:
    shown = debugger.view().shown
    same, other = shown.arm, (shown.arm + 1) % 3
    assert "of hypothesis" not in edited_score(debugger.carry_out([c.SelectArm(same), c.EditPose()]).view())
    said = edited_score(debugger.carry_out([c.SelectArm(other), c.EditPose()]).view())
    assert f"hypothesis {other + 1}" in said
    assert f"of hypothesis {same + 1}" in said
