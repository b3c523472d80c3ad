"""Stage by stage nothing tells what the later stages come to; the end says of which iteration its answer is."""

from __future__ import annotations

import numpy as np

from tests.viewer.two_runs import TWO, debugger
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.drawing.bandit_tables import arm_history
from verefine_viz.viewer.drawing.pose_tables import changes_table
from verefine_viz.viewer.panels.bandit_panel import chosen
from verefine_viz.viewer.panels.physics_panel import physics_words
from verefine_viz.viewer.panels.run_panel import event_lines, of_the_end
from verefine_viz.viewer.panels.timeline_panel import strip, timeline_words
from verefine_viz.viewer.text.headline import headline
from verefine_viz.viewer.text.pose_words import beside_answer

STAGE = c.StepStage()


def test_before_its_last_stage_an_iteration_has_no_result() -> None:
    d = debugger().carry_out([STAGE])
    before = debugger().view()
    for name in ("current", "simulated", "mixed"):
        view = d.view()
        assert view.options.stage == name
        assert view.is_partial
        assert event_lines(view) == ""
        assert " accepted" not in headline(view) + strip(view)
        assert view.iterations == view.marks == view.own_iterations == view.error_series == ()
        assert (view.state.best.iteration, view.state.best.score.score) == (0, before.state.best.score.score)
        assert "refined" not in changes_table(view) + arm_history(view)
        assert (changes_table(view) == "") == (name == "current")
        d.carry_out([STAGE])
    view = d.view()
    assert (view.options.stage, view.is_partial) == ("refined", False)
    assert len(view.iterations) == 1
    assert view.state.best.iteration == 1
    assert event_lines(view) != ""


def test_an_object_stands_where_the_stage_has_it() -> None:
    d = debugger().carry_out([TWO, STAGE, STAGE])
    iteration = d.workspace.run.iteration
    simulated = iteration.stage("simulated")
    now = d.view().scene.object(iteration.instance_id)
    assert now.T_cam_obj is not None
    np.testing.assert_array_equal(now.T_cam_obj, simulated.T_cam_obj)
    assert now.answer.iteration == 0


def test_what_comes_after_a_stage_looked_at_again_stays_on_the_timeline() -> None:
    d = debugger().carry_out([c.RunUntil("end"), c.SeekStage(2, "simulated")])
    view = d.view()
    assert view.is_partial
    assert len(view.iterations) == d.workspace.run.length
    assert 2 not in {m.iteration for m in view.marks}
    assert view.state.best.iteration < 2


def test_the_last_iteration_asked_for_is_reported_whole() -> None:
    d = debugger().carry_out([c.RunUntil("end"), c.ShowLayer("refined", True)])
    assert not d.view().is_partial
    assert len(d.view().iterations) == d.workspace.run.length


def test_the_end_says_of_which_iteration_the_answer_is() -> None:
    d = debugger().carry_out([c.RunUntil("end")])
    view, best, last = d.view(), d.workspace.run.state.best[0], d.workspace.run.iterations[-1]
    assert best.iteration != last.index, "else nothing contradicts"
    told = beside_answer(view)
    assert f"iteration {best.iteration}" in told
    assert f"iteration {last.index}" in told
    assert chosen(view).startswith(told)
    assert physics_words(view).startswith(told)
    assert f"of iteration {best.iteration}" in timeline_words(view, view.marks)
    assert f"iteration {best.iteration}" in of_the_end(view)
    assert beside_answer(d.carry_out([c.Back()]).view()) == ""


def test_a_step_within_an_iteration_goes_to_its_end() -> None:
    d = debugger().carry_out([STAGE, STAGE])
    assert (d.workspace.run.cursor, d.view().is_partial) == (1, True)
    d.carry_out([c.Step()])
    assert (d.workspace.run.cursor, d.view().is_partial) == (1, False)
    d.carry_out([c.Step()])
    assert (d.workspace.run.cursor, d.view().is_partial) == (2, False)
