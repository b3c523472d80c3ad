"""Which hypothesis is said to be the best and the nearest one, before the first iteration."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.fakes import box_problem
from tests.viewer.fake_tools import FakeTools
from tests.viewer.test_words import after, debugger, off
from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import axis_angle, transform
from verefine_viz.core.problem import Problem
from verefine_viz.core.settings import MethodSettings, Session
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.debugger import Debugger
from verefine_viz.viewer.drawing.bandit_tables import arms_table
from verefine_viz.viewer.panels.bandit_panel import chosen
from verefine_viz.viewer.snapshot.snapshot import Snapshot
from verefine_viz.viewer.text.findings import findings
from verefine_viz.viewer.text.headline import headline


def moved(arm: int, turn_deg: float, mm: float, *first: c.Command) -> Snapshot:
    """Iteration 0 of a run that goes on from hypothesis ``arm`` put that far from ground truth."""
    d = debugger().carry_out([*first, c.SelectArm(arm), c.EditPose()])
    T_gt = d.view().target.instance.T_cam_obj_gt
    assert T_gt is not None
    T: Float = T_gt @ transform(axis_angle(np.array([0.0, 0, 1]), np.deg2rad(turn_deg)), [1e-3 * mm, 0, 0])
    there = c.DragPose(tuple(float(x) for x in T.ravel()))
    return d.carry_out([there, c.ForkFromPose(), c.Seek(0)]).view()


def test_the_nearest_is_named_where_another_scores_best() -> None:
    view = after()
    view = replace(view, initial_errors=(off(12, 9, 0.2), off(11, 7, 0.1), off(13, 8, 0.3)))
    said = "hypothesis 1 scores best with 0.83, hypothesis 2 is nearest, 11.0° and 7.0 mm from ground truth."
    assert said in headline(view)


def test_a_hypothesis_moved_to_where_it_is_best_is_named_with_the_error_that_it_has_there() -> None:
    said = headline(moved(2, 1.0, 1.0))
    assert "hypothesis 3 scores best with 0.9" in said
    assert "and is nearest, 1.0° and 1.0 mm from ground truth. Hypothesis 3 was edited before iteration 1" in said


def test_a_hypothesis_moved_away_no_longer_scores_best_but_its_initial_pose_may() -> None:
    said = headline(moved(0, 60.0, 80.0))
    assert "the initial pose of hypothesis 1 scores best with 0.83, hypothesis 3 is nearest, 12.0° and " in said


def test_what_is_moved_later_is_no_start() -> None:
    said = headline(moved(2, 1.0, 1.0, c.Step()))
    assert "hypothesis 1 scores best with 0.83 and is nearest, 4.0° and 3.0 mm from ground truth." in said


class FarStarts(FakeTools):
    """A box whose initial poses are all upside down."""

    def problem(self, frame: str) -> Problem:
        (instance,) = box_problem(seed=3).instances
        upside_down = transform(np.diag([-1.0, -1.0, 1.0]), [0.05, 0.05, 0.0])
        far = tuple(replace(h, T_cam_obj=h.T_cam_obj @ upside_down) for h in instance.hypotheses)
        return replace(super().problem("0/1"), instances=(replace(instance, hypotheses=far),))


def test_headline_and_finding_name_the_same_start_as_the_nearest() -> None:
    d = Debugger(Session(method=MethodSettings(iterations=2)), None, FarStarts).carry_out(
        [c.SelectArm(1), c.EditPose()]
    )
    T_gt = d.view().target.instance.T_cam_obj_gt
    assert T_gt is not None
    T: Float = T_gt @ transform(np.eye(3), [0.06, 0, 0])
    view = d.carry_out([c.DragPose(tuple(float(x) for x in T.ravel())), c.ForkFromPose()]).view()
    assert "hypothesis 2 scores best with " in headline(view)
    assert "and is nearest, 0.0° and 60.0 mm from ground truth." in headline(view)
    (said,) = (one.text for one in findings(view) if one.text.startswith("The nearest start"))
    assert said.startswith("The nearest start is off by 0° and 60 mm (hypothesis 2)")


@pytest.mark.parametrize("name", ["pir", "sir", "refine"])
def test_a_method_that_looks_at_one_hypothesis_does_not_say_that_it_scores_best(name: str) -> None:
    said = headline(after(name=name))
    assert f"box has 3 hypotheses; {name.upper()} works on hypothesis 1 alone, which scores 0.83 and is nearest" in said


def test_what_comes_first_is_reported_with_the_exploration_of_the_start() -> None:
    """A branch that explores more from iteration 1 on began as the run that it leaves."""
    wider = c.Fork((("method.exploration", 3.0),), 1)
    before, fork = after(c.Step(), c.Seek(0)), after(c.Step(), wider, c.Seek(0))
    assert fork.session.method.exploration == 3.0
    assert (chosen(fork), arms_table(fork)) == (chosen(before), arms_table(before))
    at_once = after(c.Step(), c.Fork((("method.exploration", 3.0),), 0), c.Seek(0))
    assert chosen(at_once) != chosen(before)
