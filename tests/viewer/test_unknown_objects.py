"""Unknown objects of the surroundings on the page: shown, dropped, restored; and gravity beside the plane."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.fakes import box_model
from tests.viewer.fake_tools import FakeTools
from verefine_viz.core.errors import InputError, SettingsError
from verefine_viz.core.problem import Problem
from verefine_viz.core.settings import PhysicsSettings, Session
from verefine_viz.core.surroundings import SupportSurface, Surroundings, UnknownObject, unknown_id, unknown_number
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.debugger import Debugger
from verefine_viz.viewer.drawing.image_layers import contours_svg
from verefine_viz.viewer.panels.physics_panel import plane_warning, surroundings_html
from verefine_viz.viewer.text.display_names import without_model
from verefine_viz.viewer.text.findings import findings
from verefine_viz.viewer.text.plausibility_verdict import gravity_doubt

OBSERVED = Session(physics=PhysicsSettings(support="observed"))
EVERYWHERE = SupportSurface(np.array([0.0, 0.0, 1.0]), 0.0, np.zeros((0, 2)))


class WithBox(FakeTools):
    """An unknown box stands beside the object, where surroundings are observed."""

    def problem(self, frame: str) -> Problem:
        return self.surrounded(super().problem(frame))

    def surrounded(self, problem: Problem) -> Problem:
        observation, physics = problem.observation, self.session.physics
        assert observation.support is not None
        mask = np.zeros(observation.camera.shape, bool)
        mask[40:50, 60:75] = True
        unknown = UnknownObject(1, box_model(), mask, (problem.frame, 1) in physics.dropped)
        around = Surroundings("observed", EVERYWHERE, False, (), (), (unknown,))
        support = replace(observation.support, surroundings=around if physics.support == "observed" else None)
        return replace(problem, observation=replace(observation, support=support))


def test_an_unknown_object_is_dropped_and_restored_with_a_restart() -> None:
    debugger = Debugger(OBSERVED, None, WithBox)
    debugger.carry_out([c.RunUntil("end"), c.DropUnknown(1)])
    assert debugger.workspace.run.length == 0
    assert debugger.workspace.session.physics.dropped == (("0/1", 1),)
    view = debugger.view()
    assert "dropped" in surroundings_html(view)
    assert "restore" in surroundings_html(view)
    again = Debugger(debugger.workspace.session, None, WithBox)
    assert "dropped" in surroundings_html(again.view())
    debugger.carry_out([c.DropUnknown(1, False)])
    assert debugger.workspace.session.physics.dropped == ()
    assert "dropped" not in surroundings_html(debugger.view())
    with pytest.raises(InputError, match="unknown object 5"):
        debugger.apply(c.DropUnknown(5))


def test_the_world_is_changed_by_a_link_and_not_during_a_run() -> None:
    debugger = Debugger(Session(), None, WithBox)
    assert "a plane alone" in surroundings_html(debugger.view())
    debugger.carry_out([c.Restart((("physics.support", "observed"),))])
    html = surroundings_html(debugger.view())
    assert "unknown object 1, 100 × 80 × 60 mm" in html
    assert "1 surface and 0 other solids" in html
    debugger.carry_out([c.RunUntil("end")])
    with pytest.raises(SettingsError, match="makes another world"):
        debugger.apply(c.Fork((("physics.support", "plane"),)))
    debugger.carry_out([c.CompareRun((("physics.support", "plane"),))])
    b = debugger.workspace.work.branches[-1]
    assert b.run.problem.observation.support.surroundings is None


def test_an_unknown_object_is_drawn_in_the_photo() -> None:
    assert 'data-unknown="1"' in contours_svg(Debugger(OBSERVED, None, WithBox).view(), ())
    assert 'data-unknown="1"' not in contours_svg(Debugger(Session(), None, WithBox).view(), ())


def test_what_has_no_model_has_a_name() -> None:
    assert [without_model(i) for i in (None, 0, 3, -1, unknown_id(1), unknown_id(12))] == [
        "", "", "", "table", "unknown object 1", "unknown object 12",
    ]  # fmt: skip
    assert [unknown_number(unknown_id(n)) for n in range(1, 5)] == [1, 2, 3, 4]
    assert unknown_number(-1) is None


def test_gravity_and_a_plane_that_disagree_are_said() -> None:
    view = Debugger(Session(), None, FakeTools).view()
    observation = view.target.observation
    assert observation.support is not None
    for tilt_deg, is_said in ((0.0, False), (2.9, False), (3.2, True), (20.0, True)):
        normal = np.array([0.0, np.sin(np.radians(tilt_deg)), np.cos(np.radians(tilt_deg))])
        support = replace(observation.support, normal_world=normal, gravity_source="given")
        assert (f"{tilt_deg:.1f}° against gravity" in gravity_doubt(support)) == is_said, tilt_deg
        seen = replace(view, target=replace(view.target, observation=replace(observation, support=support)))
        assert bool(plane_warning(seen)) == bool(findings(seen)) == is_said, tilt_deg
