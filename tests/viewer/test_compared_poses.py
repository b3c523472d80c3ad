"""Why two stages differ in score: in the sentence, in the table and beside the maps with the same digits."""

from __future__ import annotations

from dataclasses import replace

from tests.viewer.fake_tools import FakeTools
from tests.viewer.two_runs import SESSION, TWO, debugger
from verefine_viz.core.problem import Problem
from verefine_viz.core.scores import PoseScore
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.debugger import Debugger
from verefine_viz.viewer.drawing.pose_tables import score_table
from verefine_viz.viewer.panels.score_panel import maps_html
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
    assert compared(beside(worse, better)) == (
        "Refined 0.900 against simulated 0.600: 0.300 more, mostly from depth (depth +0.275, normals +0.025). "
        "The share of explained pixels went up by 30 percentage points."
    )


def test_a_near_tie_is_told_with_the_digits_that_decided_it() -> None:
    pixels = (60, 30, 5, 3, 2)
    view = beside(scored(0.32022, 0.29022, 0.35022, pixels), scored(0.32047, 0.31246, 0.32848, pixels))
    said = compared(view)
    assert said.startswith("Refined 0.32047 against simulated 0.32022: 0.00025 more, since what depth and normals ")
    assert "nearly cancels out (depth +0.01112, normals −0.01087)." in said
    shown = score_table([side.pose for side in (view.a, view.b) if side is not None])
    for score in ("0.32022", "0.32047"):
        assert f"<td>{score}</td>" in shown
        assert f"<br>{score}</td>" in maps_html(view)


def test_equal_scores_are_the_same_only_where_their_parts_are() -> None:
    pixels = (60, 30, 5, 3, 2)
    one = scored(0.5, 0.4, 0.6, pixels)
    assert compared(beside(one, scored(0.5, 0.4, 0.6, (61, 29, 5, 3, 2)))).startswith(
        "Refined 0.500 against simulated 0.500: the same."
    )
    said = compared(beside(one, scored(0.5, 0.6, 0.4, pixels)))
    assert ": the same, since what depth and normals change nearly cancels out (depth +0.100, normals −0.100)." in said


def test_a_missing_stage_is_named_and_something_else_is_shown() -> None:
    said = compared(debugger().view())
    assert said.startswith("No simulated and no refined pose here yet; shown instead: current and ground truth. ")
    assert "Ground truth 1.000 against current 0.826: 0.174 more" in said


class Perfect(FakeTools):
    """Frames whose one hypothesis is the true pose."""

    def problem(self, frame: str) -> Problem:
        problem = super().problem(frame)
        (box,) = problem.instances
        assert box.T_cam_obj_gt is not None
        known = replace(box.hypotheses[0], T_cam_obj=box.T_cam_obj_gt)
        return replace(problem, instances=(replace(box, hypotheses=(known,)),))


def test_the_same_pose_stands_twice_only_where_there_is_no_other() -> None:
    said = compared(Debugger(SESSION, None, Perfect).view())
    assert said.startswith("No simulated and no refined pose here yet; shown instead: current and best. ")
    assert "Current and best score the same: 1.000." in said


def test_with_several_objects_sentence_and_maps_say_whose_they_are() -> None:
    d = debugger().carry_out([TWO, c.RunUntil("end")])
    for focus, label in ((0, "box #0"), (1, "box #1")):
        view = d.carry_out([c.Focus(focus)]).view()
        assert compared(view).startswith(f"{label}: Best ")
        assert f'title="{label}"><span>box</span>' in maps_html(view)
    assert "box" not in maps_html(debugger().carry_out([c.Step()]).view()), "one object needs no name"
