"""What is said of a pose that sinks into another object: its name, and nothing yet while that one waits."""

from __future__ import annotations

import gc
from collections.abc import Sequence
from dataclasses import replace
from weakref import ref

import numpy as np
import pytest

from tests.viewer.fake_tools import FakeTools
from tests.viewer.two_runs import SESSION, TWO
from verefine_viz.core.geometry import transform
from verefine_viz.core.observation import Support
from verefine_viz.core.problem import Placed, Problem
from verefine_viz.physics.plausibility import Plausibility
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.debugger import Debugger
from verefine_viz.viewer.drawing.plausibility_picture import LIGHTS, plausibility_html
from verefine_viz.viewer.panels.objects_panel import objects_html
from verefine_viz.viewer.snapshot.build import deferred_physics
from verefine_viz.viewer.snapshot.snapshot import Snapshot
from verefine_viz.viewer.text.plausibility_verdict import plausibility_verdict


def sunk(into: int, depth_mm: float) -> Plausibility:
    """A pose that is too deep in something."""
    none, what = np.zeros((0, 3)), f"instance {into}" if into >= 0 else "the support plane"
    return Plausibility(
        gap_mm=0.0, penetration_mm=depth_mm, penetrates=into, contact_points_cam=none, contact_normals_cam=none,
        contact_others=np.zeros(0, np.int64), polygon_cam=none, com_cam=np.zeros(3), com_on_plane_cam=np.zeros(3),
        margin_mm=5.0, is_stable=True, light="red", sentence=f"Sinks {depth_mm:.1f} mm into {what}.",
    )  # fmt: skip


def sinking(moving: Placed, others: Sequence[Placed], support: Support) -> Plausibility:
    """Every object sinks into the other one."""
    return sunk(1 - moving.instance_id, 9.0)


@pytest.fixture
def debugger() -> Debugger:
    return Debugger(SESSION, None, FakeTools, plausibility=sinking).carry_out([TWO])


def seen(debugger: Debugger) -> Snapshot:
    """The view once everything is worked out."""
    for _ in deferred_physics(debugger.view(), debugger.workspace.branch.evaluator):
        pass
    return debugger.view()


def test_both_lists_name_what_a_pose_sinks_into(debugger: Debugger) -> None:
    view = seen(debugger.carry_out([c.RunUntil("end")]))
    shown = plausibility_html(view)
    assert view.scene.object(0).label in shown + objects_html(view)
    assert "Sinks 9.0 mm into box #0." in shown
    assert "Sinks 9.0 mm into box #1." in objects_html(view)
    assert f"rgb{LIGHTS['red']}" in shown


def test_what_sinks_into_a_waiting_object_is_not_called_impossible(debugger: Debugger) -> None:
    view = seen(debugger.carry_out([c.Step()]))
    shown = plausibility_html(view)
    assert "Sinks 9.0 mm into box #1, which still waits" in shown
    assert f"rgb{LIGHTS['red']}" not in shown
    assert "not yet" in objects_html(view)


class Lowered(FakeTools):
    """The same frames, on a table that was found 8 mm too high."""

    def problem(self, frame: str) -> Problem:
        problem = super().problem(frame)
        support = problem.observation.support
        raised = replace(support, T_world_cam=transform(np.eye(3), [0, 0, -0.008]) @ support.T_world_cam)
        return replace(problem, observation=replace(problem.observation, support=raised))


def test_sinking_into_the_plane_counts_from_where_the_true_pose_is() -> None:
    for tools, depth_mm, light in ((Lowered, 12.9, "amber"), (Lowered, 13.1, "red"), (FakeTools, 5.1, "red")):
        scene = Debugger(SESSION, None, tools).view().scene
        said = plausibility_verdict(sunk(-1, depth_mm), scene.objects[0], scene)
        assert said.light == light, depth_mm
        assert f"{depth_mm:.1f} mm into the support plane" in said.sentence
        assert ("so does ground truth, by 8.0 mm" in said.sentence) == (light == "amber"), depth_mm


def test_a_frame_that_nobody_looks_at_any_more_is_not_kept() -> None:
    scene = Debugger(SESSION, None, Lowered).view().scene
    plausibility_verdict(sunk(-1, 12.9), scene.objects[0], scene)
    target = ref(scene.objects[0].target)
    del scene
    gc.collect()
    assert target() is None
