"""The verdict: one line about the run, whatever the cursor shows."""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.changing import replace
from tests.fakes import FakeRefiner, FakeSimulator, FakeVerifier
from tests.viewer.fake_tools import FakeTools
from verefine_viz.core.algorithm_settings import BreakpointSettings
from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import transform
from verefine_viz.core.problem import ANSWER, Instance, Placed, Problem, RecordedStep, Target
from verefine_viz.core.records import Best
from verefine_viz.core.scores import Scores
from verefine_viz.core.settings import MethodSettings, Session
from verefine_viz.diagnosis.causes import TITLES, Cause, Finding
from verefine_viz.diagnosis.lost_poses import Discarded, Lost
from verefine_viz.diagnosis.signs import signs
from verefine_viz.evaluation.pose_errors import PoseErrors
from verefine_viz.methods.registry import make_method
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.debugger import Debugger
from verefine_viz.viewer.panels.verdict_panel import bar_html, named_object, why_html
from verefine_viz.viewer.snapshot.snapshot import Snapshot, visit
from verefine_viz.viewer.state.page_link import PageLink
from verefine_viz.viewer.text.findings import findings
from verefine_viz.viewer.text.headline import headline
from verefine_viz.viewer.text.verdict import DATA_DOUBTED, MOST_WORDS, verdict

END = c.RunUntil("end")


TRUE: dict[bytes, Float] = {}
"""By the points of an instance, where it is: the fakes go by that, and the frames below lack it or have it wrong."""


def seen(target: Target) -> Target:
    """The target with ground truth where the object is."""
    return replace(target, instance=replace(target.instance, T_cam_obj_gt=TRUE[target.instance.points_cam.tobytes()]))


class Seeing(FakeVerifier):
    def score(self, target: Target, Ts_cam_obj: Float, placed: Sequence[Placed] = ()) -> Scores:
        return super().score(seen(target), Ts_cam_obj, placed)


class SeeingRefiner(FakeRefiner):
    def refine(self, target: Target, T_cam_obj: Float, fixed: Sequence[Placed] = ()) -> Float:
        return super().refine(seen(target), T_cam_obj, fixed)


class Blind(FakeTools):
    """Frames without ground truth."""

    def __init__(self, session: Session) -> None:
        super().__init__(session)
        self.verifier = Seeing()

    @property
    def method(self) -> Any:
        return make_method(self.session.method, FakeSimulator(), SeeingRefiner(), self.verifier, 3)

    def problem(self, frame: str) -> Problem:
        problem = super().problem(frame)
        for instance in problem.instances:
            assert instance.T_cam_obj_gt is not None
            TRUE[instance.points_cam.tobytes()] = instance.T_cam_obj_gt
        return replace(problem, instances=tuple(self.known(i) for i in problem.instances))

    def known(self, instance: Instance) -> Instance:
        return replace(instance, T_cam_obj_gt=None)


class Astray(Blind):
    """Frames whose ground truth is 100 mm beside the pose that scores best."""

    def known(self, instance: Instance) -> Instance:
        return replace(instance, T_cam_obj_gt=transform(np.eye(3), [0.1, 0, 0]) @ instance.T_cam_obj_gt)


def debugger(tools: type[FakeTools] = FakeTools, name: str = "rir", frame: str = "0/1") -> Debugger:
    d = Debugger(Session(method=MethodSettings(name=name, iterations=4)), None, tools)
    return d.carry_out([c.OpenFrame(frame)])


def with_finished(view: Snapshot, **changes: Any) -> Snapshot:
    """The same with something else known of its one object."""
    (own,) = view.finished
    return replace(view, finished=(replace(own, **changes),))


def off(mm: float, relative: float) -> PoseErrors:
    return PoseErrors(10.0, mm, mm, mm, mm, relative)


def test_before_the_run_it_says_what_there_is() -> None:
    view = debugger().view()
    it = verdict(view)
    assert (it.mark, it.number) == ("…", "ready")
    assert it.cause.startswith("3 hypotheses, best score 0.")
    assert not view.finished


def test_on_the_way_it_says_how_far_it_is() -> None:
    d = debugger().carry_out([c.Step(), c.Step()])
    it = verdict(d.view())
    assert it.line.startswith("… 2 of 12: box, hypothesis ")
    d.apply(END)
    d.tick()
    running = verdict(d.view(deep=False))
    assert running.number == "3 of 12"
    assert running.share == pytest.approx(3 / 12)


def test_a_right_answer_says_how_it_won_wherever_the_cursor_is() -> None:
    d = debugger().carry_out([END])
    view = d.view()
    assert (view.options.a, view.options.b) == ("initial", "best")
    it = verdict(view)
    assert it.mark == "✓"
    assert it.number.endswith(" mm")
    assert it.cause.startswith("score ")
    best = d.run.final_state.best[0]
    np.testing.assert_array_equal(it.pictured[1], best.T_cam_obj)
    back = verdict(d.carry_out([c.Seek(1)]).view())
    assert (back.mark, back.number, back.cause) == (it.mark, it.number, it.cause)


def test_a_wrong_answer_is_compared_with_ground_truth_until_the_user_chooses() -> None:
    d = debugger(Astray).carry_out([END])
    view = d.view()
    assert verdict(view).mark == "✗"
    assert (view.options.a, view.options.b) == ("best", "ground truth")
    d.carry_out([c.Compare(a="initial", b="best"), c.Back(), END])
    assert (d.view().options.a, d.view().options.b) == ("initial", "best")
    d.carry_out([c.Restart(), END])
    assert (d.view().options.a, d.view().options.b) == ("best", "ground truth")


def test_a_recorded_pose_that_was_no_answer_is_not_blamed_on_the_search() -> None:
    """A program was killed before it answered; its last pose is off, whatever its steps were."""
    view = debugger(Astray).carry_out([END]).view()
    (own,) = view.finished
    recorded = view.session.model_copy(update={"method": MethodSettings(name="trace")})
    for names, is_unanswered in ((("refined", "refined"), True), (("refined", ANSWER), False), ((), False)):
        steps = tuple(RecordedStep(0, np.eye(4), name) for name in names)
        target = replace(own.target, instance=replace(own.target.instance, recorded=steps))
        it = verdict(replace(with_finished(view, target=target), session=recorded))
        assert it.mark == "✗"
        assert (it.cause == "no answer was recorded: this is the last pose") == is_unanswered
    assert verdict(view).cause != "no answer was recorded: this is the last pose"


def test_without_ground_truth_the_answer_is_compared_with_the_runner_up() -> None:
    d = debugger(Blind).carry_out([END])
    view = d.view()
    it = verdict(view)
    assert it.mark == "?"
    assert it.number.startswith("score ")
    assert "hypothesis" in it.cause or "doubt" in it.cause
    assert (view.options.a, view.options.b) == ("best", "runner-up")
    assert view.b.pose.name == "runner-up"
    assert "runner-up" in view.options.layers
    (own,) = view.finished
    assert own.runner_up.pose.arm != own.answer.arm
    assert own.runner_up.lead == pytest.approx(own.answer.score.score - view.b.pose.score.score)
    assert "runner-up" not in d.carry_out([c.Back()]).view().poses


def test_without_ground_truth_an_ambiguous_answer_names_the_least_certain_axis() -> None:
    view = debugger(Blind).carry_out([END]).view()
    other: Any = SimpleNamespace(apart_mm=31.2, score=0.8, score_of_answer=0.81, noise=0.01)
    for width, words in (
        (25.0, "turn about the vertical undetermined within ±25°"),
        (0.3, "a pose 31 mm away fits as well"),
    ):
        axis = SimpleNamespace(steps=(1.5,))
        widest = SimpleNamespace(in_words=lambda words=words: words, width=width, axis=axis)
        around: Any = SimpleNamespace(least_certain=widest)
        it = verdict(with_finished(view, around=around, other_pose=other))
        assert (it.mark, it.cause) == ("?", words)


def test_a_correct_pose_that_was_given_up_is_named_with_its_margin() -> None:
    view = debugger(Astray).carry_out([END]).view()
    (own,) = view.finished
    iteration = view.at(2)
    lower = replace(own.answer.score, score=own.answer.score.score - 0.003)
    given_up = Discarded(1, 2, iteration.accepted_stage, lower, 3, own.answer)
    shown = with_finished(view, discarded=given_up, errors=off(15.7, 0.13), score_at_gt=None)
    it = verdict(shown)
    assert it.line.startswith("✗ 15.7 mm: correct at iteration 2, given up for a score 0.003 higher")
    assert it.look_at == ("iteration 3", visit(view, view.at(3)))
    first = findings(shown)[0]
    assert "Hypothesis 2 of the box was correct at iteration 2" in first.text
    assert first.red


def led_away(by_simulation: bool, inlier_share: float = 0.6, score_rose: bool = False, missed: int = 0) -> Snapshot:
    """A finished run whose answer came from a pose near ground truth."""
    view = debugger(name="pir").carry_out([END]).view()
    (own,) = view.finished
    assert view.target.observation.support is not None
    support = replace(view.target.observation.support, inlier_share=inlier_share)
    target = replace(view.target, observation=replace(view.target.observation, support=support))
    at_gt = replace(own.answer.score, score=0.97, counts=(100 - missed, missed, 0, 0, 0))
    answer = replace(own.answer, score=replace(own.answer.score, score=0.5))
    lost = Lost(
        5e-3 / target.model.diameter_m, answer.score, 1, 2, 0.2, 0.3 * by_simulation, score_rose, 2 * by_simulation
    )
    view = replace(view, target=target)
    return with_finished(view, target=target, answer=answer, errors=off(39.1, 0.2), score_at_gt=at_gt, lost=lost)


def test_what_led_a_near_pose_away_is_the_cause_and_its_evidence_comes_first() -> None:
    for view, cause, first in (
        (led_away(True), "simulation pushed it away: it tips over", "Hypothesis 1 of the box was 5.0 mm off"),
        (led_away(True, 0.26), "wrong support plane: it explains only 26% of the background", "The support plane"),
        (led_away(False, 0.26), "nearer at iteration 1, then lost in iteration 2", "Hypothesis 1 of the"),
        (led_away(False, score_rose=True), "refiner led it away: score rose while the error grew", "Hypothesis 1 of"),
    ):
        it = verdict(view)
        assert it.cause == cause
        assert it.look_at == ("iteration 2", visit(view, view.at(2))), cause
        html = why_html(view, it, findings(view))
        assert html.index(first) == min(html.index(one.text[:20]) for one in findings(view)), cause
    assert verdict(led_away(False, missed=54)).cause == "mask leaks or misses: 54% missed even at ground truth"


def test_the_pixels_that_mislead_the_score_are_named() -> None:
    view = debugger(Astray).carry_out([END]).view()
    (own,) = view.finished
    answer = replace(own.answer, score=replace(own.answer.score, score=0.956, counts=(100, 0, 0, 0, 0)))
    for missed, protruding, more in ((0, 13, ": 13% of it protruding"), (12, 0, ": 12% of it missed"), (0, 0, "")):
        explained = 100 - missed - protruding
        at_gt = replace(own.answer.score, score=0.82, counts=(explained, missed, protruding, 0, 0))
        it = verdict(with_finished(view, answer=answer, score_at_gt=at_gt, errors=off(39.1, 0.2), discarded=None))
        assert it.cause == f"score ranks a wrong pose above the ground truth, by 0.14{more}"


def test_at_a_breakpoint_it_is_paused_and_at_the_end_it_is_over() -> None:
    session = Session(
        method=MethodSettings(name="pir", iterations=3), breakpoints=BreakpointSettings(jump_mm=0.0, jump_deg=0.0)
    )
    d = Debugger(session, None, FakeTools).carry_out([c.OpenFrame("0/1"), END])
    it = verdict(d.view())
    assert (it.mark, it.number, it.look_at) == ("…", "paused", ("run on", END))
    assert it.cause.startswith("breakpoint: the pose jumped by ")
    assert d.message.startswith("Breakpoint at iteration 1: ")
    assert verdict(d.carry_out([c.Back()]).view()).number == "ready"
    d.carry_out([END, END, END])
    assert verdict(d.view()).mark in "✓✗"
    assert "Breakpoint" not in d.message


def test_a_last_pose_is_not_called_the_best() -> None:
    d = debugger(name="pir").carry_out([c.Step()])
    assert "best" not in verdict(d.view()).cause
    assert "last pose" in headline(d.carry_out([END]).view())


def test_data_in_doubt_come_before_every_cause() -> None:
    view = replace(debugger(Astray).carry_out([END]).view(), doubts=("cam_K does not fit",))
    assert verdict(view).cause == DATA_DOUBTED


def test_of_several_objects_the_worst_is_named_and_one_in_focus_has_its_own() -> None:
    d = debugger(Astray, frame="0/2").carry_out([END])
    it = verdict(d.view())
    assert (it.mark, it.number) == ("✗", "0 of 2 right")
    assert it.cause.startswith("box #")
    own = verdict(d.carry_out([c.Focus(1)]).view())
    assert own.number.endswith(" mm")
    right = verdict(debugger(frame="0/2").carry_out([END]).view())
    assert (right.mark, right.number) == ("✓", "2 of 2 right")


@pytest.mark.parametrize("tools", [FakeTools, Blind, Astray])
def test_it_is_never_longer_than_a_glance(tools: type[FakeTools]) -> None:
    for name, frame in (("refine", "0/1"), ("sir", "0/2"), ("rir", "0/1"), ("rir", "0/2"), ("vf_depth", "0/2")):
        d = debugger(tools, name, frame)
        for command in (c.Seek(0), c.Step(), END, c.Focus(0), c.Back()):
            it = verdict(d.carry_out([command]).view(deep=False))
            assert 0 < len(it.cause.replace("box #", "box").split()) <= MOST_WORDS, it.line
    assert all(len(TITLES[cause].split()) <= MOST_WORDS - 3 for cause in Cause)


def test_the_bar_escapes_names_and_links_and_counts_warnings() -> None:
    view = debugger(Astray).carry_out([END]).view()
    it = replace(verdict(view), cause="<i>mug</i>")
    html = bar_html(it, "data:image/webp;base64,AA", "<p>because</p>", 2, PageLink("0/1", run='"').text)
    assert "<i>mug" not in html
    assert "why (2)" in html
    assert "<p>because</p>" in html
    assert 'data-link="frame=0/1&amp;run=%22"' in html
    assert "data-cmd" not in bar_html(replace(it, look_at=None), "", "")


def test_the_words_and_the_picture_of_a_verdict_on_several_lead_to_the_object_that_they_name() -> None:
    d = debugger(frame="0/2").carry_out([END])
    it = verdict(d.view())
    named = named_object(d.view(), it)
    assert named is not None
    assert named == c.Focus(it.pictured[0].instance.instance_id)
    assert bar_html(replace(it, look_at=None), "", "", named=named).count("data-cmd") == 2
    assert named_object(d.carry_out([named]).view(), it) is None


def test_a_best_pose_is_no_runner_up_where_one_hypothesis_alone_is_worked_on() -> None:
    view = debugger(Blind, "sir").carry_out([END]).view()
    (own,) = view.finished
    assert isinstance(own.answer, Best)
    assert own.runner_up is None
    assert (view.options.a, view.options.b) == ("initial", "best")


def test_the_verdict_is_the_first_of_the_signs_and_why_is_all_of_them() -> None:
    for tools, name in ((Astray, "rir"), (Astray, "pir"), (Blind, "rir")):
        view = debugger(tools, name).carry_out([END]).view()
        low = with_finished(view, impossible=IMPOSSIBLE, discarded=None)
        (own,) = low.finished
        found = signs(own, low.session, low.refiner)
        it = verdict(low)
        assert found
        assert it.about == found[0].cause
        assert it.cause == found[0].title + found[0].detail
        assert [one.text for one in findings(low)] == [sign.text for sign in found]


IMPOSSIBLE = Finding(
    Cause.IMPOSSIBLE, "The box cannot lie where its answer has it. Sinks 9.0 mm into the mug.", detail=": sinks 9.0 mm"
)


def test_without_ground_truth_an_impossible_answer_of_several_is_named_first_then_the_lowest_score() -> None:
    d = debugger(Blind, frame="0/2").carry_out([END])
    view = d.view()
    lower, higher = sorted(view.finished, key=lambda o: o.score.score)
    assert verdict(view).cause.startswith(f"2 poses; lowest: {lower.label}, 0.")
    sunk = replace(view, finished=(lower, replace(higher, impossible=IMPOSSIBLE)))
    it = verdict(sunk)
    assert (it.mark, it.cause) == ("?", f"2 poses; {higher.label}: physically impossible where it is")
    assert it.pictured is not None
    assert it.pictured[0].instance.instance_id == higher.instance_id
    first = findings(sunk)[0]
    assert (first.text, first.red) == (IMPOSSIBLE.text, True)
    d.carry_out([c.Focus(higher.instance_id)])
    own = verdict(replace(d.view(), finished=sunk.finished))
    assert own.cause == "physically impossible where it is: sinks 9.0 mm"
