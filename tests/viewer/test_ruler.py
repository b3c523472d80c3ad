"""The ruler between two pixels, and how far the view in 3D is cut open."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
import viser

from tests.viewer.two_runs import debugger
from verefine_viz.core.errors import InputError
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.drawing.ruler import ruler_of
from verefine_viz.viewer.panels.image_panel import pane_html
from verefine_viz.viewer.scene3d.scene_view import UNCUT_NEAR_M, Cut


def test_the_ruler_is_as_long_as_the_observed_points_are_apart() -> None:
    d = debugger()
    observation = d.view().problem.observation
    points, measured = observation.camera.back_project(observation.depth_m), np.argwhere(observation.depth_m > 0)
    rng = np.random.default_rng(4)
    for (v0, u0), (v1, u1) in rng.choice(measured, (20, 2)):
        if (v0, u0) == (v1, u1):
            continue
        d.carry_out([c.ProbePixel(int(u0), int(v0)), c.PlaceRuler(), c.ProbePixel(int(u1), int(v1))])
        ruler = ruler_of(observation, d.options)
        apart = points[v1, u1] - points[v0, u0]
        assert np.allclose(ruler.points_cam[1] - ruler.points_cam[0], apart, atol=1e-6)
        assert ruler.label == f"{1000 * np.linalg.norm(apart):.1f} mm, depth {1000 * apart[2]:+.1f}"
        assert ruler.label in pane_html(d.view(), ())
        d.apply(c.PlaceRuler())
        assert ruler_of(observation, d.options) is None, "the second time it is taken away"


def test_without_depth_the_ruler_counts_pixels() -> None:
    d = debugger()
    observation = d.view().problem.observation
    v, u = (int(x) for x in np.argwhere(observation.depth_m <= 0)[0])
    d.carry_out([c.ProbePixel(u, v), c.PlaceRuler(), c.ProbePixel(u + 3, v + 4)])
    ruler = ruler_of(observation, d.options)
    assert ruler.points_cam is None
    assert ruler.label == "5 px, no depth"


def test_a_ruler_needs_a_marked_pixel_and_a_cut_a_share() -> None:
    d = debugger()
    with pytest.raises(InputError, match="no pixel is marked; click where the ruler is to start"):
        d.apply(c.PlaceRuler())
    with pytest.raises(InputError, match="101 % cannot be cut off, expected 0 to 100"):
        d.apply(c.CutView(101))


def test_a_cut_goes_through_the_ball_square_to_the_view() -> None:
    rng = np.random.default_rng(0)
    eye, centre = rng.normal(size=3), rng.normal(size=3)
    ahead = centre - eye + 0.1 * rng.normal(size=3)
    camera = SimpleNamespace(position=eye, look_at=eye + ahead, near=0.1)
    seen = []
    for percent in (0, 1, 50, 100):
        Cut(centre, 0.2, percent).show(cast(viser.CameraHandle, camera))
        seen.append(camera.near)
    depth_m = (centre - eye) @ ahead / np.linalg.norm(ahead)
    assert seen == pytest.approx([UNCUT_NEAR_M, depth_m - 0.098, depth_m, depth_m + 0.1])


def test_from_within_the_ball_nothing_behind_the_eye_is_cut() -> None:
    camera = SimpleNamespace(position=np.zeros(3), look_at=np.array([0.0, 0, 1]), near=0.1)
    Cut(np.zeros(3), 0.2, 10).show(cast(viser.CameraHandle, camera))
    assert camera.near == UNCUT_NEAR_M
