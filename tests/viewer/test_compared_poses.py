"""Why two stages differ in score: in the sentence, in the table and beside the maps with the same digits."""

from __future__ import annotations

from dataclasses import replace

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
    for row in (("0.600", "0.900", "+0.300"), ("0.400", "0.950", "+0.550"), ("60.0%", "90.0%", "+30.0%")):
        assert "".join(f"<td>{cell}</td>" for cell in row) in shown


def test_a_near_tie_is_reported_with_the_digits_that_decided_it() -> None:
    pixels = (60, 30, 5, 3, 2)
    view = beside(scored(0.32022, 0.29022, 0.35022, pixels), scored(0.32047, 0.31246, 0.32848, pixels))
    shown = score_html(view)
    assert "<td>+0.00025</td>" in shown
    for score in ("0.32022", "0.32047"):
        assert f"<td>{score}</td>" in shown
        assert f"<span>{score}</span></div>" in maps_html(view)


def test_a_missing_stage_is_named_and_something_else_is_shown() -> None:
    said = compared(debugger().view())
    assert said.startswith("No simulated and no refined pose yet: current and ground truth instead.")
    assert "ground truth instead. The score" not in said


class Perfect(FakeTools):
    """Frames whose one hypothesis is the ground-truth pose."""

    def problem(self, frame: str) -> Problem:
        problem = super().problem(frame)
        (box,) = problem.instances
        assert box.T_cam_obj_gt is not None
        known = replace(box.hypotheses[0], T_cam_obj=box.T_cam_obj_gt)
        return replace(problem, instances=(replace(box, hypotheses=(known,)),))


def test_the_same_pose_stands_twice_only_where_there_is_no_other() -> None:
    said = compared(Debugger(SESSION, None, Perfect).view())
    assert said.startswith("No simulated and no refined pose yet: current and answer instead.")


def test_with_several_objects_sentence_and_maps_say_whose_they_are() -> None:
    d = debugger().carry_out([TWO, c.RunUntil("end")])
    for focus, label in ((0, "box #0"), (1, "box #1")):
        view = d.carry_out([c.Focus(focus)]).view()
        assert f'title="{label}"></i>' in score_html(view)
        assert f'title="{label}"></i>' in maps_html(view)
    assert "box" not in maps_html(debugger().carry_out([c.Step()]).view()), "one object needs no name"
