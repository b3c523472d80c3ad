"""Overlap of two boxes against what can be worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from tests.fakes import BOX_M, box_model
from verefine_viz.core.geometry import apply, axis_angle, inverse, transform
from verefine_viz.core.problem import Placed
from verefine_viz.physics.proximity import Surfaces, overlap

MODEL = box_model()


def box(instance_id: int, x_m: float = 0.0, y_m: float = 0.0, z_m: float = 0.5, turn_deg: float = 0.0) -> Placed:
    return Placed(instance_id, MODEL, transform(axis_angle([0, 1, 0], np.deg2rad(turn_deg)), [x_m, y_m, z_m]))


def test_depth_is_how_far_one_is_pushed_into_the_other_and_none_where_they_only_touch() -> None:
    for depth_mm in (2.0, 5.0, 12.0):
        # Smaller than the face it is pushed into and turned, so that its corners are what is deepest.
        found = overlap(box(4), box(7, y_m=BOX_M[1] - depth_mm / 1e3, turn_deg=20))
        assert (found.first, found.second) == (4, 7), depth_mm
        assert found.depth_mm == pytest.approx(depth_mm, abs=0.05), depth_mm
    for gap_mm in (0.0, 0.5, 30.0):
        assert overlap(box(1), box(2, y_m=BOX_M[1] + gap_mm / 1e3)) is None


def test_points_lie_where_both_are() -> None:
    a, b = box(1), box(2, y_m=BOX_M[1] - 0.01, x_m=0.02)
    found = overlap(a, b)
    assert len(found.points_cam) > 0
    for placed in (a, b):
        inside = apply(inverse(placed.T_cam_obj), found.points_cam)
        assert (np.abs(inside) <= BOX_M / 2 + 1e-6).all()


def test_order_does_not_matter_and_surfaces_can_be_kept() -> None:
    surfaces = Surfaces()
    a, b = box(1), box(2, y_m=BOX_M[1] - 0.004, turn_deg=33)
    one, other = overlap(a, b, surfaces), overlap(b, a, surfaces)
    assert one.depth_mm == pytest.approx(other.depth_mm)
    assert surfaces(MODEL) is surfaces(MODEL)
