"""What is said of a pose that sinks into another object: its name, and nothing yet while that one waits."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from tests.viewer.tools import FakeTools
from tests.viewer.two_runs import SESSION, TWO
from verefine_viz.core.observation import Support
from verefine_viz.core.problem import Placed
from verefine_viz.physics.plausibility import Plausibility
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.debugger import Debugger
from verefine_viz.viewer.panels.objects import objects_html
from verefine_viz.viewer.standing import LIGHTS, standing_html
from verefine_viz.viewer.view import View
from verefine_viz.viewer.viewing import later


def sinking(moving: Placed, others: Sequence[Placed], support: Support) -> Plausibility:
    """Every object sinks into the other one."""
    into, none = 1 - moving.instance_id, np.zeros((0, 3))
    return Plausibility(
        gap_mm=0.0, penetration_mm=9.0, penetrates=into, contact_points_cam=none, contact_normals_cam=none,
        contact_others=np.zeros(0, np.int64), polygon_cam=none, com_cam=np.zeros(3), com_on_plane_cam=np.zeros(3),
        margin_mm=5.0, is_stable=True, light="red", sentence=f"Sinks 9.0 mm into instance {into}.",
    )  # fmt: skip


@pytest.fixture
def debugger() -> Debugger:
    return Debugger(SESSION, None, FakeTools, plausibility=sinking).carry_out([TWO])


def seen(debugger: Debugger) -> View:
    """The view once everything is worked out."""
    for _ in later(debugger.view(), debugger.workspace.branch.judge):
        pass
    return debugger.view()


def test_both_lists_name_what_a_pose_sinks_into(debugger: Debugger) -> None:
    view = seen(debugger.carry_out([c.RunUntil("end")]))
    shown = standing_html(view)
    assert view.scene.object(0).label in shown + objects_html(view)
    assert "Sinks 9.0 mm into box #0." in shown
    assert "Sinks 9.0 mm into box #1." in objects_html(view)
    assert "into instance" not in shown + objects_html(view)
    assert f"rgb{LIGHTS['red']}" in shown


def test_what_sinks_into_a_waiting_object_is_not_called_impossible(debugger: Debugger) -> None:
    view = seen(debugger.carry_out([c.Step()]))
    shown = standing_html(view)
    assert "Sinks 9.0 mm into box #1, which still waits at its first pose: nothing can be said yet." in shown
    assert f"rgb{LIGHTS['red']}" not in shown
    assert f"rgb{LIGHTS['grey']}" in shown
    assert "not yet: Sinks 9.0 mm into box #1" in objects_html(view)
