"""Which poses stand for all that the image allows."""

from __future__ import annotations

import numpy as np
import pytest

from verefine_viz.core.arrays import Float
from verefine_viz.core.causes import Cause
from verefine_viz.core.geometry import axis_angle, transform
from verefine_viz.evaluation.allowed_poses import AlikePose, AllowedPoses, Axis, Extent, SixMotions, SmallMotions
from verefine_viz.page.views.allowed_ghosts import MOST, allowed_ghosts
from verefine_viz.page.wire import pose_numbers

ANSWER = transform(np.eye(3), np.array([0.0, 0.0, 0.6]))
RADIUS_MM = 80.0
UP = np.array([0.0, 0.0, 1.0])
NONE = np.zeros((0, 4, 4))


def turned(deg: float) -> Float:
    return ANSWER @ transform(axis_angle(UP, np.deg2rad(deg)), np.zeros(3))


def apart_mm(T: Float) -> float:
    """Distance that a point at half the radius is moved."""
    point = np.array([RADIUS_MM / 2, 0.0, 0.0, 1e3])
    return float(np.linalg.norm((T - ANSWER) @ point))


def extent(kind, letter: str, low: float, high: float, poses: Float = NONE, offsets: Float | None = None) -> Extent:
    axis = Axis(kind, "table", letter, UP, ANSWER[:3, 3], f"{kind} {letter}")  # pyright: ignore[reportArgumentType]
    return Extent(axis, low, high, np.zeros(0) if offsets is None else offsets, poses)


def allowed(low: float, high: float, alike: tuple[AlikePose, ...] = (), score: float = 0.9) -> AllowedPoses:
    """A turn about z from ``low`` to ``high`` [deg], and shifts of no more than noise."""
    offsets = np.linspace(low, high, 9)
    turn = extent("turn", "z", low, high, np.array([turned(x) for x in offsets]), offsets)
    six = SixMotions(ANSWER, ANSWER[:3, 3], np.eye(3), np.ones(6))
    small = SmallMotions(six, np.zeros(6), np.eye(6))
    extents = (extent("shift", "x", -0.3, 0.3), extent("shift", "y", -0.3, 0.3), turn)
    return AllowedPoses(ANSWER, score, ANSWER, small, extents, alike, None, RADIUS_MM)


def test_the_ends_of_the_widest_motion_are_drawn_then_poses_that_look_alike():
    flips = tuple(AlikePose(turned(180 + k), 0.9, 0.9, 0.01, 50.0) for k in range(9))
    ghosts = allowed_ghosts(allowed(-60.0, 45.0, flips), apart_mm, (), 0.6)
    assert ghosts is not None
    assert len(ghosts.poses) == MOST
    drawn = np.array(ghosts.poses).reshape(-1, 4, 4)
    for end in (-60.0, 45.0):
        assert np.abs(drawn - turned(end)).max(axis=(1, 2)).min() == pytest.approx(0, abs=1e-12)
    # The answer itself lies in between and is no ghost of itself.
    assert min(apart_mm(T) for T in drawn) > 0.02 * 2 * RADIUS_MM
    assert [list(T) for T in ghosts.poses].count(list(pose_numbers(flips[0].T_cam_obj))) == 1
    assert ghosts.words.startswith("turn z undetermined within")


@pytest.mark.parametrize(
    ("low", "high", "causes", "score", "unasked"),
    [
        (-60.0, 45.0, (), 0.9, True),
        (-12.0, 12.0, (), 0.9, False),
        (-12.0, 12.0, (Cause.AMBIGUOUS,), 0.9, True),
        (-170.0, 170.0, (), 0.4, False),
    ],
    ids=["far", "near", "ambiguous", "misfit"],
)
def test_they_are_drawn_unasked_where_the_image_cannot_tell(low, high, causes, score, unasked):
    ghosts = allowed_ghosts(allowed(low, high, score=score), apart_mm, causes, 0.6)
    assert ghosts is not None
    assert ghosts.unasked is unasked


def test_a_turn_that_cannot_be_seen_draws_nothing():
    assert allowed_ghosts(allowed(-180.0, 180.0), lambda T: 0.0, (), 0.6) is None
