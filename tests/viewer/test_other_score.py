"""A run whose score changed on the way: what is looked at is judged by the settings of its own iteration."""

from __future__ import annotations

from dataclasses import dataclass, replace

from tests.fakes import FakeVerifier
from tests.viewer.fake_tools import FakeTools
from verefine_viz.core.settings import MethodSettings, ScoreSettings, Session
from verefine_viz.recording.verify import first_difference
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.debugger import Debugger
from verefine_viz.viewer.drawing.bandit_tables import arm_history
from verefine_viz.viewer.drawing.pose_tables import branches_table, last_of_old_scale, one_scale_note, other_scale_sign
from verefine_viz.viewer.panels.bandit_panel import score_lines
from verefine_viz.viewer.snapshot.snapshot import Snapshot


@dataclass(frozen=True)
class ByTolerance(FakeVerifier):
    """A smaller tolerance gives smaller scores."""

    def score(self, target, Ts_cam_obj, placed=()):  # type: ignore[no-untyped-def]
        found = super().score(target, Ts_cam_obj, placed)
        return replace(found, score=found.score * self.settings.tau_m / 0.02)


class Tools(FakeTools):
    def __init__(self, session: Session) -> None:
        super().__init__(session)
        self.verifier = ByTolerance(session.score)


def debugger(session: Session | None = None) -> Debugger:
    return Debugger(session or Session(method=MethodSettings(iterations=3)), None, Tools)


STRICTER = (("score.tau_m", 0.005),)


def scored_anew(view: Snapshot) -> tuple[float, float]:
    """What the record says of the accepted pose, and what the page finds for the same pose."""
    shown = view.shown
    kept = shown.accepted_stage
    edited = view.poses["edited"]
    return kept.score.score, edited.score.score


def test_a_pose_that_was_not_moved_scores_what_it_scored() -> None:
    d = debugger().carry_out([c.Step(), c.Step(), c.Fork(STRICTER), c.Step(), c.Step()])
    for k in (1, 2, 3, 4):
        view = d.carry_out([c.Seek(k), c.EditPose()]).view()
        recorded, found = scored_anew(view)
        assert found == recorded
        assert (recorded <= 0.25) == (k > 2)
        d.carry_out([c.EditPose(False)])


def test_nothing_of_the_old_score_is_weighed_after_it() -> None:
    d = debugger().carry_out([c.RunUntil("end"), c.Fork(STRICTER, 4, run=True)])
    run = d.workspace.run
    assert run.state_at(4).objects[0].best.score.score <= 0.25
    for iteration in run.iterations[4:]:
        assert iteration.best.score.score <= 0.25
        assert max(iteration.choice.mean) <= 0.25


def test_the_session_of_such_a_run_opens_as_it_was() -> None:
    d = debugger().carry_out([c.Step(), c.Step(), c.Fork(STRICTER, 2, run=True)])
    again = debugger(d.workspace.session).carry_out([c.RunUntil("end")])
    assert first_difference(again.workspace.run.iterations, d.workspace.run.iterations) is None
    # A fork of either, with another setting that is not the score's, goes on alike.
    for one in (d, again):
        one.carry_out([c.Fork((("method.exploration", 3.0),), 4, run=True)])
    assert first_difference(again.workspace.run.iterations, d.workspace.run.iterations) is None
    for k in (1, 2, 3, 5):
        recorded, found = scored_anew(again.carry_out([c.Seek(k), c.EditPose()]).view())
        assert found == recorded
        again.carry_out([c.EditPose(False)])


def test_a_fork_at_the_start_is_judged_by_the_new_score_alone() -> None:
    d = debugger().carry_out([c.RunUntil("end"), c.Fork(STRICTER, 0, run=True)])
    alone = debugger(Session(method=MethodSettings(iterations=3), score=ScoreSettings(tau_m=0.005)))
    alone.carry_out([c.RunUntil("end")])
    assert first_difference(d.workspace.run.iterations, alone.workspace.run.iterations) is None
    target = d.view().target
    starts = [d.workspace.branch.evaluator.score(target, h.T_cam_obj).score for h in target.instance.hypotheses]
    assert max(starts) <= 0.25


def test_numbers_of_two_scales_are_reported_apart() -> None:
    d = debugger().carry_out([c.Step(), c.Step(), c.Fork(STRICTER)])
    assert "changed after iteration" not in arm_history(d.view())
    assert "earlier settings" in one_scale_note(d.view())
    view = d.carry_out([c.Step()]).view()
    assert last_of_old_scale(view) == 2
    for said in (arm_history(view), other_scale_sign(view), one_scale_note(view)):
        assert "changed after iteration 2" in said
    assert "later settings" in one_scale_note(view)
    view = d.carry_out([c.Seek(2)]).view()
    assert "changed after iteration" not in arm_history(view)
    assert other_scale_sign(view) == ""
    assert one_scale_note(d.carry_out([c.Seek(1)]).view()) == ""
    same = debugger().carry_out([c.Step(), c.Fork((("method.exploration", 0.3),)), c.Step()])
    assert last_of_old_scale(same.view()) is None


def scales_of(view: Snapshot) -> set[bool]:
    """Whether what is shown in one place scores as little as the stricter settings allow: poses, initial poses."""
    assert view.ground_truth is not None
    scores = [pose.score for pose in (*view.poses.values(), view.ground_truth)]
    firsts = [arm.entries[0].score.score for arm in view.state.arms]
    known = [s.score for s in scores if s is not None] + [s.score for s in view.state.initial] + firsts
    return {score <= 0.25 for score in known}


def test_what_is_shown_at_once_is_of_one_scale() -> None:
    d = debugger().carry_out([c.Step(), c.Step(), c.Fork(STRICTER)])
    assert scales_of(d.view()) == {False}, "the fork shows the iteration that it leaves from, as that was scored"
    assert scales_of(d.carry_out([c.Step()]).view()) == {True}
    assert scales_of(d.carry_out([c.Back()]).view()) == {False}
    ended = debugger().carry_out([c.RunUntil("end"), c.Fork(STRICTER)])
    assert scales_of(ended.view()) == {True}, "the answer is scored by the settings that it was chosen by"


def test_an_object_that_was_worked_on_before_the_score_changed_is_reported_by_the_later_score() -> None:
    d = debugger(Session(method=MethodSettings(name="rir", iterations=1))).carry_out([c.OpenFrame("0/2")])
    first = d.carry_out([c.Step()]).view().target.instance.instance_id
    while d.carry_out([c.Step()]).view().target.instance.instance_id == first:
        pass
    view = d.carry_out([c.Fork(STRICTER), c.Step(), c.Focus(first)]).view()
    assert view.shown.index < view.cursor
    assert "accepted" in view.poses
    assert scales_of(view) == {True}


def test_a_pose_moved_where_the_score_changes_is_reported_by_the_earlier_score() -> None:
    T_cam_obj = tuple(debugger().view().target.instance.hypotheses[1].T_cam_obj.ravel())
    by_hand = [c.EditPose(), c.DragPose(T_cam_obj), c.ForkFromPose()]
    d = debugger().carry_out([c.Step(), c.Step(), *by_hand, c.Fork(STRICTER)])
    view = d.view()
    assert view.state.edited_arms
    assert scales_of(view) == {False}


def test_what_an_object_began_with_keeps_its_score_in_the_history_and_in_the_curves() -> None:
    d = debugger().carry_out([c.Step(), c.Step()])
    before = d.view()
    view = d.carry_out([c.Fork(STRICTER), c.Step()]).view()
    began, begins = (score_lines(v, v.n_arms) for v in (before, view))
    assert [line.values[0] for line in began] == [line.values[0] for line in begins]
    first = before.state.arms[view.arm].entries[0].score.score
    assert f"{first:.3f}" in arm_history(view)


def test_branches_of_another_score_are_marked() -> None:
    d = debugger().carry_out([c.Step(), c.Step(), c.Fork((("method.exploration", 0.3),))])
    assert "⚠" not in branches_table(d.view())
    assert "⚠" in branches_table(d.carry_out([c.Fork(STRICTER)]).view())
    assert "⚠" in branches_table(d.carry_out([c.ShowBranch(0)]).view()), "seen from an earlier one"
