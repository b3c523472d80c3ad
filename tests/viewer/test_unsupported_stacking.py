"""What the page says of objects that stand on others, where every object is settled on the support plane alone."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.made_runs import answer
from tests.viewer.fake_tools import FakeTools
from verefine_viz.batch.index import BatchIndex
from verefine_viz.batch.runs import BatchInfo
from verefine_viz.core.problem import DependencyGraph, Edge, EdgeState, Problem
from verefine_viz.core.settings import MethodSettings, PhysicsSettings, Session
from verefine_viz.core.surroundings import SupportSurface, Surroundings
from verefine_viz.evaluation.pose_errors import PoseErrors
from verefine_viz.run.record import DATA_FIRST
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.debugger import Debugger
from verefine_viz.viewer.panels.objects_panel import objects_html
from verefine_viz.viewer.snapshot.snapshot import Snapshot
from verefine_viz.viewer.state.batch_gallery import Gallery
from verefine_viz.viewer.text.findings import findings
from verefine_viz.viewer.text.plausibility_verdict import (
    RAISED_M,
    height_above_plane_m,
    unsupported_stacking,
    unsupported_stacking_warning,
)


def view_of(problem_of: type[FakeTools], name: str = "rir", physics: bool = True) -> Snapshot:
    session = Session(method=MethodSettings(name=name, iterations=1), physics=PhysicsSettings(enabled=physics))
    return Debugger(session, None, problem_of).carry_out([c.OpenFrame("0/2")]).view()


def stacked(state: EdgeState = "used") -> type[FakeTools]:
    class Stacked(FakeTools):
        def problem(self, frame: str) -> Problem:
            edge = Edge("support", 0, 1, 0.9, "64% of its footprint", state)
            problem = super().problem(frame)
            graph = DependencyGraph((edge,), ((0, 1),), (), "recommended")
            return replace(problem, dependencies=graph.only([i.instance_id for i in problem.instances]))

    return Stacked


def raised(by_m: float) -> type[FakeTools]:
    """Ground truth of the second box has its lowest point so high above the plane; there is no dependency graph."""

    class Raised(FakeTools):
        def problem(self, frame: str) -> Problem:
            problem = super().problem(frame)
            support, target = problem.observation.support, problem.targets[-1]
            truth, height_m = target.instance.T_cam_obj_gt, height_above_plane_m(target)
            assert height_m is not None
            lifted = truth.copy()
            lifted[:3, 3] += (by_m - height_m) * support.T_world_cam[:3, :3].T @ support.normal_world
            instances = (*problem.instances[:-1], replace(problem.instances[-1], T_cam_obj_gt=lifted))
            return replace(problem, instances=instances, dependencies=None)

    return Raised


def test_what_stands_on_another_object_is_warned_of_with_the_way_out() -> None:
    view = view_of(stacked())
    said = unsupported_stacking_warning(view)
    assert "box #1 stands on box #0" in said
    (finding,) = [f for f in findings(view) if f.text == said]
    assert not finding.calm
    assert finding.command == c.Restart((("method.name", "vf_breadth"),))
    assert unsupported_stacking(view) == {1: "stands on box #0"}
    assert "⤓" in objects_html(view)


def test_the_warning_is_calm_once_all_that_stands_on_others_came_out_right() -> None:
    session = Session(method=MethodSettings(name="rir", iterations=2))
    view = Debugger(session, None, stacked()).carry_out([c.OpenFrame("0/2"), c.RunUntil("end")]).view()
    assert all(o.errors is not None and o.errors.relative < 0.1 for o in view.scene.objects)
    (finding,) = [f for f in findings(view) if f.text == unsupported_stacking_warning(view)]
    assert finding.calm
    off = PoseErrors(40.0, 30.0, 30.0, 30.0, 30.0, 0.3)
    wrong = tuple(replace(o, errors=off) if o.instance_id == 1 else o for o in view.scene.objects)
    (finding,) = [f for f in findings(replace(view, scene=replace(view.scene, objects=wrong))) if "settles" in f.text]
    assert not finding.calm


def test_methods_that_know_of_it_or_do_not_simulate_say_nothing() -> None:
    for name in ("vf_breadth", "vf_depth", "refine"):
        view = view_of(stacked(), name)
        assert unsupported_stacking_warning(view) == "", name
        assert "⤓" not in objects_html(view), name
    assert unsupported_stacking_warning(view_of(stacked(), physics=False)) == ""
    assert unsupported_stacking_warning(view_of(stacked("cut"))) == ""
    assert unsupported_stacking_warning(view_of(FakeTools)) == ""


def test_nothing_is_said_while_the_data_are_in_doubt() -> None:
    for view in (view_of(stacked()), view_of(raised(0.08))):
        assert unsupported_stacking(view)
        doubted = replace(view, doubts=("measured depth is 10% larger: check depth_scale",))
        assert unsupported_stacking(doubted) == {}
        assert unsupported_stacking_warning(doubted) == ""


def test_nothing_is_said_where_a_batch_doubts_the_frame_by_another_object(tmp_path: Path) -> None:
    rows = tuple(
        answer(scene_id=0, im_id=2, instance_id=k, obj_id=1, name="box", status="ok", evidence=evidence)
        for k, evidence in enumerate((f"{DATA_FIRST} objects appear larger: check cam_K.", ""))
    )
    session = Session(method=MethodSettings(name="rir", iterations=1))
    batch = Gallery([BatchIndex(tmp_path, session, BatchInfo(), rows)])
    debugger = Debugger(session, None, stacked(), batch=batch)
    for entry in batch.entries:
        view = debugger.carry_out([batch.opens(entry)]).view()
        assert not view.doubts
        assert findings(view)[0].text == f"{DATA_FIRST} objects appear larger: check cam_K."
        assert unsupported_stacking(view) == {}


def test_ground_truth_above_the_table_says_so_where_no_graph_does() -> None:
    for by_m in (RAISED_M + 0.005, 0.08):
        view = view_of(raised(by_m))
        assert height_above_plane_m(view.problem.targets[-1]) == pytest.approx(by_m)
        assert f"box #1 stands {by_m * 1e3:.0f} mm above the table" in unsupported_stacking_warning(view)


def test_surroundings_support_what_stands_above_the_table() -> None:
    view = view_of(raised(0.08))
    support = view.problem.observation.support
    assert support is not None
    floor = SupportSurface(np.array([0.0, 0.0, 1.0]), 0.0, np.zeros((0, 2)))
    support = replace(support, surroundings=Surroundings("observed", floor, False, (), ()))
    observation = replace(view.problem.observation, support=support)
    assert unsupported_stacking(replace(view, problem=replace(view.problem, observation=observation))) == {}


def test_an_object_near_the_table_stands_on_it() -> None:
    assert unsupported_stacking(view_of(raised(RAISED_M - 0.001))) == {}
    blind = view_of(raised(0.08))
    instances = tuple(replace(i, T_cam_obj_gt=None) for i in blind.problem.instances)
    assert unsupported_stacking(replace(blind, problem=replace(blind.problem, instances=instances))) == {}


def test_height_is_that_of_the_lowest_vertex() -> None:
    target = view_of(raised(0.05)).problem.targets[-1]
    support, truth = target.observation.support, target.instance.T_cam_obj_gt
    T_world_obj = support.T_world_cam @ truth
    heights = [(T_world_obj @ np.append(point, 1.0))[:3] @ support.normal_world for point in target.model.vertices]
    assert height_above_plane_m(target) == pytest.approx(min(heights))
