"""Two runs along their iterations: moving both, swapping them, what of each is drawn."""

from __future__ import annotations

import numpy as np

from tests.viewer.fake_tools import FakeTools
from tests.viewer.two_runs import SESSION, SIR, TWO, debugger, sides
from verefine_viz.core.problem import Problem
from verefine_viz.core.settings import MethodSettings, Session
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.debugger import Debugger


def test_both_move_along_their_iterations() -> None:
    d = debugger().carry_out([TWO, c.RunUntil("end"), c.CompareRun(SIR)])
    v = sides(d)
    # Three hypotheses and K = 2: A makes six iterations an object, B two.
    assert len(v.pairs) == 12
    assert v.place == 12
    d.carry_out([c.SeekMoment(2)])
    v = sides(d)
    assert (v.place, d.workspace.run.cursor) == (2, 2)
    assert (v.pair.a, v.pair.b) == (2, 2)
    d.carry_out([c.StepMoment(1)])
    v = sides(d)
    assert (v.place, v.pair.b) == (3, None)
    d.carry_out([c.ShowSidePoses("kept")])
    v = sides(d)
    assert v.now_b.iteration == 2, "B stays where it was when A goes on alone"
    d.carry_out([c.Seek(8)])
    v = sides(d)
    assert (v.pair.a, v.pair.b) == (8, 4), "A's own slider moves both"
    d.carry_out([c.SeekMoment(0)])
    assert sides(d).place == 0
    assert d.workspace.run.cursor == 0
    assert sides(d.carry_out([c.SeekMoment(99)])).place == 12


def test_moments_that_only_b_has_can_be_reached() -> None:
    d = debugger(Session(method=MethodSettings(name="sir", iterations=1)))
    d.carry_out([TWO, c.RunUntil("end"), c.CompareRun((("method.iterations", 3),))])
    assert len(sides(d).pairs) == 6
    d.carry_out([c.SeekMoment(3)])
    v = sides(d)
    assert (v.place, v.pair.a, v.pair.b, d.workspace.run.cursor) == (3, None, 3, 1)
    assert d.view().target.instance.instance_id == 0
    d.carry_out([c.SeekMoment(6)])
    assert (sides(d).place, d.workspace.run.cursor) == (6, 2)


def test_swapping_makes_b_the_open_run_at_the_same_moment() -> None:
    d = debugger().carry_out([TWO, c.RunUntil("end"), c.CompareRun(SIR), c.SeekMoment(2)])
    before = sides(d)
    d.carry_out([c.SwapSides()])
    after = sides(d)
    assert (after.name_a, after.name_b) == (before.name_b, before.name_a) == ("sir", "rir")
    assert after.pair[:2] == before.pair[:2]
    assert d.workspace.run.method.n_iterations(d.workspace.run.state) == 4
    swapped = {"A": "B", "B": "A", "even": "even", None: None}
    assert [o.winner for o in after.outcomes] == [swapped[o.winner] for o in before.outcomes]
    for k, (T_a, T_b) in before.poses.items():
        np.testing.assert_array_equal(after.poses[k][0], T_b)
        np.testing.assert_array_equal(after.poses[k][1], T_a)
    d.carry_out([c.SwapSides()])
    assert sides(d).place == before.place


def test_stage_layers_are_put_away_and_come_back() -> None:
    d = debugger().carry_out([c.Step()])
    before = d.view().options.layers
    d.carry_out([c.CompareRun(SIR)])
    assert not d.view().options.layers & {"simulated", "refined", "accepted", "hypotheses"}
    assert {"cloud", "ground truth"} <= d.view().options.layers
    d.carry_out([c.ShowLayer("hypotheses")])
    assert "hypotheses" in d.view().options.layers
    d.carry_out([c.StopComparing()])
    assert d.view().options.layers == before
    assert d.view().comparison is None


def test_sides_can_be_hidden_and_show_best_or_kept() -> None:
    d = debugger().carry_out([c.RunUntil("end"), c.CompareRun((("method.exploration", 5.0),)), c.ShowSide("B")])
    assert sides(d).shown == {"A"}
    assert sides(d.carry_out([c.ShowSide("B")])).shown == {"A", "B"}
    d.carry_out([c.SeekMoment(3), c.ShowSidePoses("kept")])
    v = sides(d)
    T_a, T_b = v.poses[0]
    runs = [b.run for b in d.workspace.work.branches]
    np.testing.assert_array_equal(T_a, runs[0].iterations[2].accepted_stage.T_cam_obj)
    np.testing.assert_array_equal(T_b, runs[1].iterations[2].accepted_stage.T_cam_obj)
    T_a, T_b = sides(d.carry_out([c.ShowSidePoses("best")])).poses[0]
    np.testing.assert_array_equal(T_a, runs[0].iterations[2].best.T_cam_obj)
    np.testing.assert_array_equal(T_b, runs[1].iterations[2].best.T_cam_obj)


def test_a_pose_is_reported_with_the_iteration_and_the_hypothesis_that_made_it() -> None:
    d = debugger().carry_out([c.RunUntil("end"), c.CompareRun((("method.exploration", 5.0),))])
    best, last = d.workspace.run.iterations[-1].best, d.workspace.run.iterations[-1]
    assert (best.iteration, best.arm) != (last.index, last.arm), "else this proves nothing"
    now = sides(d).now_a
    assert (now.iteration, now.arm, now.stage, now.score) == (best.iteration, best.arm, best.stage, best.score.score)
    now = sides(d.carry_out([c.ShowSidePoses("kept")])).now_a
    assert (now.iteration, now.arm, now.stage) == (last.index, last.arm, last.accepted)
    d.carry_out([c.SeekMoment(0)])
    now, first = sides(d).now_a, d.workspace.run.state_at(0).best[0]
    assert (now.iteration, now.arm, now.stage) == (0, first.arm, "initial")


def test_curves_run_over_the_iterations_of_the_object_in_focus() -> None:
    d = debugger().carry_out([TWO, c.RunUntil("end"), c.CompareRun(SIR), c.Focus(0)])
    curves = sides(d).curves
    assert len(curves.score_a) == len(curves.score_b) == 7
    assert curves.score_b[2:] == (curves.score_b[2],) * 5, "a run that has ended stays where it was"
    assert curves.error_a is not None
    assert list(curves.score_a) == sorted(curves.score_a)


class Ordered(FakeTools):
    """Objects in the order of the session."""

    def problem(self, frame: str) -> Problem:
        return self.ordered(super().problem(frame))


def test_runs_in_another_order_go_forward_together_and_end_at_their_answers() -> None:
    d = Debugger(SESSION, None, Ordered).carry_out([TWO, c.RunUntil("end")])
    d.carry_out([c.CompareRun((("method.name", "vf_depth"), ("dependency.order", (("#1", "#0"),))))])
    runs = [branch.run for branch in d.workspace.work.branches]
    assert [[i.instance_id for i in run.iterations][:3] for run in runs] == [[0, 0, 0], [1, 0, 1]]
    for own, poses in sides(d).poses.items():
        for run, T_cam_obj in zip(runs, poses, strict=True):
            np.testing.assert_array_equal(T_cam_obj, run.best_at(run.length)[own].T_cam_obj)
    d.carry_out([c.SeekMoment(0), c.ShowSidePoses("kept")])
    for pair in sides(d).pairs:
        v = sides(d.carry_out([c.StepMoment(1)]))
        assert v.pair == pair
        for side, index in ((v.now_a, pair.a), (v.now_b, pair.b)):
            assert index in (None, side.iteration)
