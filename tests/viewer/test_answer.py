"""The end of a finished run shows the answer; the iteration tried last can be asked for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from tests.fakes import FakeRefiner, FakeSimulator
from tests.viewer.fake_tools import FakeTools
from tests.viewer.test_read_changes import Clustered
from verefine_viz.core.algorithm_settings import MctsSettings
from verefine_viz.core.observation import Observation
from verefine_viz.core.problem import DependencyGraph, Placed, Problem
from verefine_viz.core.settings import MethodSettings, Session
from verefine_viz.methods.physim_mcts import make_physim_mcts
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.debugger import Debugger
from verefine_viz.viewer.drawing.markup import carries
from verefine_viz.viewer.drawing.pose_tables import errors_table
from verefine_viz.viewer.panels.run_panel import of_the_end
from verefine_viz.viewer.panels.timeline_panel import strip
from verefine_viz.viewer.snapshot.compared_poses import INITIAL_POSES
from verefine_viz.viewer.snapshot.snapshot import visit
from verefine_viz.viewer.state.view_options import OF_ITERATION
from verefine_viz.viewer.text.headline import headline

TWO, END = c.OpenFrame("0/2"), c.RunUntil("end")


class FarCost:
    """Unexplained pixels of a scene: the farther from the camera, the more."""

    def unexplained_px(self, observation: Observation, scene: Sequence[Placed]) -> int:
        return int(1e6 * sum(float(np.abs(p.T_cam_obj[:3, 3]).sum()) for p in scene))


class SearchTools(FakeTools):
    """A tree search for two objects that have to do with each other."""

    def problem(self, frame: str) -> Problem:
        clusters = (tuple(range(int(frame[-1]))),)
        return replace(super().problem(frame), dependencies=DependencyGraph((), clusters, (), "given"))

    @property
    def method(self) -> Any:
        return make_physim_mcts(
            MctsSettings(expansions=6), FakeSimulator(), FakeRefiner(), self.verifier, FarCost(), 3
        )  # fmt: skip


def debugger(name: str = "rir", n: int = 2, tools: type[FakeTools] = FakeTools) -> Debugger:
    d = Debugger(Session(method=MethodSettings(name=name, iterations=2)), None, tools)
    return d.carry_out([c.OpenFrame(f"0/{n}")])


def test_every_object_stands_at_its_answer_and_is_done() -> None:
    for name, tools in (("rir", FakeTools), ("vf_depth", FakeTools), ("physim_mcts", SearchTools)):
        d = debugger(name, tools=tools).carry_out([END])
        view = d.view()
        assert view.is_answer, name
        objects = sorted(view.scene.objects, key=lambda o: o.instance_id)
        for o, best in zip(objects, d.workspace.run.state.best, strict=True):
            np.testing.assert_array_equal(o.T_cam_obj, best.T_cam_obj)
            assert o.phase == "done", name
        own = view.scene.object(view.target.instance.instance_id)
        np.testing.assert_array_equal(view.poses["best"].T_cam_obj, own.answer.T_cam_obj)
        assert view.arm == own.answer.arm, name


def test_the_branch_tried_last_is_shown_with_its_iteration_only() -> None:
    d = debugger("physim_mcts", tools=SearchTools).carry_out([END])
    last = d.workspace.run.iterations[-1]
    tried = {p.instance_id: p.T_cam_obj for p in (*last.placed, *last.tree.rollout)}
    tried[last.instance_id] = last.accepted_stage.T_cam_obj
    answers = {o.instance_id: o.T_cam_obj for o in d.view().scene.objects if o.T_cam_obj is not None}
    assert any(not np.array_equal(tried[k], answers[k]) for k in tried), "else this shows nothing"
    view = d.carry_out([visit(d.view(), last)]).view()
    assert not view.is_answer
    assert view.cursor == last.index
    for o in view.scene.objects:
        assert o.T_cam_obj is not None
        np.testing.assert_array_equal(o.T_cam_obj, tried[o.instance_id])
    assert view.scene.object(last.instance_id).phase == "working"
    assert d.carry_out([c.SeekEnd()]).view().is_answer


def test_the_answer_is_shown_wherever_the_end_is_reached_from_and_nowhere_else() -> None:
    d = debugger(n=1).carry_out([END])
    n = d.workspace.run.length
    assert d.view().is_answer
    assert not d.carry_out([c.Back()]).view().is_answer
    assert d.carry_out([c.Step()]).view().is_answer
    assert not d.carry_out([c.Seek(0)]).view().is_answer
    assert d.carry_out([c.Seek(n)]).view().is_answer
    assert not debugger(n=1).carry_out([c.RunTo(n - 1)]).view().is_answer, "the end of what was made is not the end"


def test_the_words_tell_of_the_answer_and_lead_to_the_iteration() -> None:
    d = debugger(n=1).carry_out([END])
    view = d.view()
    assert "answer" in headline(view)
    to_last = carries(visit(view, view.iterations[-1]))
    assert to_last in of_the_end(view)
    assert to_last in strip(view), "its cell on the timeline goes there as well"
    view = d.carry_out([visit(view, view.iterations[-1])]).view()
    assert f"Iteration {view.cursor}" in headline(view)
    assert of_the_end(view) != ""
    assert of_the_end(d.carry_out([c.Back()]).view()) == ""


def test_several_objects_are_summed_up() -> None:
    d = debugger("vf_depth").carry_out([END])
    assert "2 of 2 objects" in headline(d.view())
    assert "2 of 2 objects" in headline(d.carry_out([c.Focus(1)]).view())
    tree = debugger("physim_mcts", tools=SearchTools).carry_out([END])
    found = [i.index for i in tree.workspace.run.iterations if any(e.kind == "new_best_scene" for e in i.events)]
    assert f"iteration {found[-1]} " in headline(tree.view())


def test_the_answer_is_compared_with_where_it_started() -> None:
    d = debugger(n=1).carry_out([END])
    view = d.view()
    assert (view.options.a, view.options.b) == ("initial", "best")
    assert not OF_ITERATION & (set(view.poses) | view.options.layers)
    assert d.options.b == "refined", "what was chosen is kept"
    assert d.carry_out([c.Back()]).view().options.b == "refined"
    scene = debugger().carry_out([END, c.ShowScene()]).view()
    assert scene.a.pose.name == INITIAL_POSES
    start = debugger().carry_out([c.ShowScene()]).view()
    np.testing.assert_array_equal(scene.a.pose.T_cam_obj, start.a.pose.T_cam_obj)


def test_asking_for_something_of_the_last_iteration_shows_it() -> None:
    for command in (
        c.ShowLayer("refined", True), c.ShowLayer("simulated"), c.ShowLayer("best", False), c.Compare(b="refined")
    ):  # fmt: skip
        d = debugger(n=1).carry_out([END, command])
        view = d.view()
        assert not view.is_answer, command
        assert {"current", "simulated", "refined", "accepted"} <= set(view.poses), command
        if isinstance(command, c.ShowLayer):
            assert (command.name in view.options.layers) == (command.visible is not False), command
        again = debugger(n=1).carry_out(d.log)
        assert again.options == d.options, command
        assert d.carry_out([c.SeekEnd()]).view().is_answer, command


def test_ground_truth_beside_the_answer_leaves_it_and_an_edited_pose_does_not() -> None:
    view = debugger(n=1).carry_out([END, c.ScoreGroundTruth()]).view()
    assert view.is_answer
    assert (view.options.a, view.options.b) == ("best", "ground truth")
    for command in (c.EditPose(), c.PlayPath()):
        assert not debugger(n=1).carry_out([END, command]).view().is_answer, command


def test_it_has_one_name_on_the_way_and_at_the_end() -> None:
    tools: tuple[tuple[str, type[FakeTools]], ...]
    tools = (("vf_depth", Clustered), ("physim_mcts", SearchTools), ("rir", Clustered))
    for name, made in tools:
        d = Debugger(Session(method=MethodSettings(name=name, iterations=2)), None, made)
        for commands in ([c.OpenFrame("0/2"), c.Compare(a="initial", b="best")], [c.RunTo(3)], [c.RunUntil("end")]):
            view = d.carry_out(commands).view()
            assert view.poses["best"].label == "answer", (name, commands)
            assert "best<" not in errors_table(view), (name, commands)
