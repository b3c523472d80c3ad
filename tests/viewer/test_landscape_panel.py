"""The tab with the score around the answer: when it is worked out, and what a click does."""

from __future__ import annotations

import re

import numpy as np
import pytest

from tests.viewer.fake_tools import FakeTools
from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import InputError
from verefine_viz.core.settings import MethodSettings, Session
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.debugger import Debugger
from verefine_viz.viewer.panels.landscape_panel import landscape_html
from verefine_viz.viewer.snapshot.build import deferred_landscape, lacks_landscape


def debugger(*commands: c.Command, frame: str = "0/1") -> Debugger:
    session = Session(title="boxes", method=MethodSettings(name="rir", iterations=2, exploration=0.1))
    return Debugger(session, None, FakeTools).carry_out([c.OpenFrame(frame), *commands])


def worked_out(d: Debugger) -> Debugger:
    """After all that the page leaves for when nothing else waits."""
    view = d.view()
    evaluator = d.workspace.branch.evaluator
    assert lacks_landscape(view, evaluator)
    for _ in deferred_landscape(view, evaluator):
        pass
    assert not lacks_landscape(d.view(), evaluator)
    return d


def test_it_is_worked_out_at_the_end_of_a_run_and_not_before() -> None:
    d = debugger(c.Step())
    assert not d.view().wants_landscape
    assert "Shown when the run is over" in landscape_html(d.view())
    d.carry_out([c.RunUntil("end")])
    assert d.view().wants_landscape
    assert "Scoring" in landscape_html(d.view())
    html = landscape_html(worked_out(d).view())
    assert "180° about 3 axes: 0.0 mm apart" in html  # The box.
    assert "undetermined within ±" in html


def test_it_can_be_asked_for_on_the_way_until_the_next_step() -> None:
    d = worked_out(debugger(c.Step(), c.ShowLandscape()))
    assert d.view().landscape is not None
    assert not d.carry_out([c.Step()]).view().wants_landscape


def test_the_curves_of_either_frame_and_any_two_axes_can_be_chosen() -> None:
    d = worked_out(debugger(c.RunUntil("end")))
    assert "shift right" in landscape_html(d.view())
    d.carry_out([c.ShowLandscape("object", across=11), c.ShowLandscape(up=1)])
    worked_out(d)
    view = d.view()
    assert view.options.slice_axes == (11, 1)
    assert view.score_slice.across.words == "turn about its z"
    assert len(re.findall(r'aria-label="(?:turn|shift|tilt)[^"]* its [xyz]"', landscape_html(view))) == 6
    with pytest.raises(InputError, match="axis"):
        d.apply(c.ShowLandscape(across=12))


def test_a_click_on_a_curve_or_the_map_edits_the_pose_there() -> None:
    d = worked_out(debugger(c.RunUntil("end")))
    view = d.view()
    around, plane = view.landscape, view.score_slice

    def edited(command: c.Command) -> Float:
        T = d.carry_out([command]).options.T_cam_obj_edited
        assert T is not None
        return T

    curve = around.curves[5]
    there = curve.axis.moved(around.T_cam_obj, float(curve.offsets[2]))
    np.testing.assert_allclose(edited(c.EditPoseOnCurve(5, 2, 0)), there, atol=1e-12)
    assert "edited" in d.view().poses
    assert d.view().landscape is around, "it stays in sight while poses are tried"
    n = len(plane.scores)
    np.testing.assert_allclose(edited(c.EditPoseInSlice(n // 2, n // 2)), around.T_cam_obj, atol=1e-9)
    np.testing.assert_allclose(edited(c.EditPoseInSlice(0, 0)), plane.pose(around.T_cam_obj, 0, n - 1), atol=1e-12)
    d.carry_out([c.EditPoseOnCurve(0, len(curve.offsets) // 4), c.EditPose(False)])
    assert d.options.edited is None


def test_a_pose_that_is_not_there_is_refused() -> None:
    d = debugger(c.Step())
    for command in (c.EditPoseOnCurve(5, 2), c.EditPoseInSlice(0, 0), c.EditOtherPose()):
        with pytest.raises(InputError, match="is not known here"):
            d.apply(command)


def test_the_whole_scene_has_none() -> None:
    d = debugger(c.RunUntil("end"), c.ShowScene(), frame="0/2")
    assert not d.view().wants_landscape
    assert "Choose an object" in landscape_html(d.view())
