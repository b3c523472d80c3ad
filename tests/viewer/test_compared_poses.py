"""Why two stages differ in score: in the sentence, in the table and beside the maps with the same digits."""

from __future__ import annotations

from tests.changing import replace
from tests.viewer.fake_tools import FakeTools
from tests.viewer.two_runs import SESSION, TWO, debugger
from verefine_viz.core.problem import Problem
from verefine_viz.core.scores import PoseScore
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.debugger import Debugger
from verefine_viz.viewer.panels.score_panel import maps_html, score_html
from verefine_viz.viewer.snapshot.snapshot import Snapshot
from verefine_viz.viewer.text.pose_words import compared


def scored(score: float, depth: float, normal: float, counts: tuple[int, int, int, int, int]) -> PoseScore:
    return PoseScore(score, depth, normal, sum(counts), sum(counts), counts)


def beside(one: PoseScore, other: PoseScore) -> Snapshot:
    """A view that compares a simulated pose with a refined one of these scores."""
    view = debugger().carry_out([c.Step()]).view()
    assert view.a is not None
    assert view.b is not None
    a, b = (replace(s, pose=replace(s.pose, score=score)) for s, score in ((view.a, one), (view.b, other)))
    return replace(view, a=a, b=b)


def test_comparison_says_which_part_made_the_difference() -> None:
    worse, better = scored(0.6, 0.4, 0.8, (60, 30, 5, 3, 2)), scored(0.9, 0.95, 0.85, (90, 0, 5, 3, 2))
    shown = score_html(beside(worse, better))
    for difference in ("+0.300", "+0.550", "+30.0%"):
        assert difference in shown


def test_a_near_tie_is_reported_with_the_digits_that_decided_it() -> None:
    pixels = (60, 30, 5, 3, 2)
    view = beside(scored(0.32022, 0.29022, 0.35022, pixels), scored(0.32047, 0.31246, 0.32848, pixels))
    for shown in (score_html(view), maps_html(view)):
        assert "0.32022" in shown
        assert "0.32047" in shown
    assert "+0.00025" in score_html(view)


def test_a_missing_stage_is_named_and_something_else_is_shown() -> None:
    assert "current and ground truth instead" in compared(debugger().view())
    assert "current and answer instead" in compared(Debugger(SESSION, None, Perfect).view()), "there is no other pose"


class Perfect(FakeTools):
    """Frames whose one hypothesis is the ground-truth pose."""

    def problem(self, frame: str) -> Problem:
        problem = super().problem(frame)
        (box,) = problem.instances
        assert box.T_cam_obj_gt is not None
        known = replace(box.hypotheses[0], T_cam_obj=box.T_cam_obj_gt)
        return replace(problem, instances=(replace(box, hypotheses=(known,)),))


def test_with_several_objects_sentence_and_maps_say_whose_they_are() -> None:
    d = debugger().carry_out([TWO, c.RunUntil("end")])
    for focus, label in ((0, "box #0"), (1, "box #1")):
        view = d.carry_out([c.Focus(focus)]).view()
        assert label in score_html(view)
        assert label in maps_html(view)
    assert "box" not in maps_html(debugger().carry_out([c.Step()]).view()), "one object needs no name"
