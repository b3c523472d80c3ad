"""Change of a pose from frame to frame: flips, jumps, frames without a pose."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from verefine_viz.core.geometry import axis_angle, transform
from verefine_viz.evaluation.pose_motion import motions, summary

Z = np.array([0.0, 0, 1])
MIDDLE = np.array([0.01, 0.02, 0.03])
HALF_TURN = transform(axis_angle(Z, np.pi), MIDDLE - axis_angle(Z, np.pi) @ MIDDLE)[None]
NONE = np.zeros((0, 4, 4))


def moved(degrees: float, mm: float, base: np.ndarray | None = None) -> np.ndarray:
    """A pose turned about the object's middle and shifted."""
    base = transform(np.eye(3), np.array([0, 0, 0.6])) if base is None else base
    R = axis_angle(Z, np.radians(degrees))
    return transform(np.eye(3), np.array([mm * 1e-3, 0, 0])) @ base @ transform(R, MIDDLE - R @ MIDDLE)


@given(st.floats(0, 25), st.floats(0, 45))
def test_slow_motion_is_measured_at_the_middle(degrees: float, mm: float) -> None:
    first, second = motions([("0/1", moved(0, 0)), ("0/2", moved(degrees, mm))], MIDDLE, HALF_TURN)
    assert (first.kind, second.kind) == ("moved", "moved")
    assert second.moved_mm == pytest.approx(mm, abs=1e-6)
    assert second.turned_deg == pytest.approx(degrees, abs=1e-3)


def test_a_turn_by_a_near_symmetry_is_a_flip_and_another_one_a_jump() -> None:
    poses = [("0/1", moved(0, 0)), ("0/2", moved(178, 2)), ("0/3", moved(1, 3)), ("0/4", moved(91, 3))]
    assert [m.kind for m in motions(poses, MIDDLE, HALF_TURN)] == ["moved", "flip", "flip", "jump"]
    assert [m.kind for m in motions(poses, MIDDLE, NONE)] == ["moved", "jump", "jump", "jump"]
    words = summary(motions(poses, MIDDLE, HALF_TURN))
    assert words == "4 frames, 2 flips (50 per 100), 1 jump."


def test_frames_without_a_pose_are_passed_over() -> None:
    poses = [("0/1", None), ("0/2", moved(0, 0)), ("0/3", None), ("0/4", moved(3, 4)), ("0/5", moved(3, 80))]
    found = motions(poses, MIDDLE, HALF_TURN)
    assert [m.kind for m in found] == ["no pose", "moved", "no pose", "moved", "jump"]
    assert found[3].moved_mm == pytest.approx(4)
    assert "2 without a pose" in summary(found)
