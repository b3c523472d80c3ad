"""Change of a pose from frame to frame: flips, jumps, frames without a pose."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from verefine_viz.core.geometry import axis_angle, transform
from verefine_viz.evaluation.pose_motion import Motion, PosedFrame, counted, motions

Z = np.array([0.0, 0, 1])
MIDDLE = np.array([0.01, 0.02, 0.03])
HALF_TURN = transform(axis_angle(Z, np.pi), MIDDLE - axis_angle(Z, np.pi) @ MIDDLE)[None]
NONE = np.zeros((0, 4, 4))


def changes(poses: list[tuple[str, np.ndarray | None]], turns: np.ndarray = HALF_TURN) -> tuple[Motion, ...]:
    return motions([PosedFrame(frame, T) for frame, T in poses], MIDDLE, turns)


def moved(degrees: float, mm: float, base: np.ndarray | None = None) -> np.ndarray:
    """A pose turned about the object's middle and shifted."""
    base = transform(np.eye(3), np.array([0, 0, 0.6])) if base is None else base
    R = axis_angle(Z, np.radians(degrees))
    return transform(np.eye(3), np.array([mm * 1e-3, 0, 0])) @ base @ transform(R, MIDDLE - R @ MIDDLE)


@given(st.floats(0, 25), st.floats(0, 45))
def test_slow_motion_is_measured_at_the_middle(degrees: float, mm: float) -> None:
    first, second = changes([("0/1", moved(0, 0)), ("0/2", moved(degrees, mm))])
    assert (first.kind, second.kind) == ("moved", "moved")
    assert second.moved_mm == pytest.approx(mm, abs=1e-6)
    assert second.turned_deg == pytest.approx(degrees, abs=1e-3)


def test_a_turn_by_a_near_symmetry_is_a_flip_and_another_one_a_jump() -> None:
    poses = [("0/1", moved(0, 0)), ("0/2", moved(178, 2)), ("0/3", moved(1, 3)), ("0/4", moved(91, 3))]
    assert [m.kind for m in changes(poses)] == ["moved", "flip", "flip", "jump"]
    assert [m.kind for m in changes(poses, NONE)] == ["moved", "jump", "jump", "jump"]
    words = counted(changes(poses)).text
    assert words == "4 frames, 2 flips (50 per 100), 1 jump."


def test_frames_without_a_pose_are_passed_over() -> None:
    poses = [("0/1", None), ("0/2", moved(0, 0)), ("0/3", None), ("0/4", moved(3, 4)), ("0/5", moved(3, 80))]
    result = changes(poses)
    assert [m.kind for m in result] == ["no pose", "moved", "no pose", "moved", "jump"]
    assert result[3].moved_mm == pytest.approx(4)
    assert "2 without a pose" in counted(result).text


@given(st.floats(0, 60), st.floats(-80, 80))
def test_an_object_at_rest_does_not_move_when_the_camera_does(degrees: float, mm: float) -> None:
    T_world_obj = moved(0, 0)
    cameras = [np.eye(4), moved(degrees, mm, base=np.eye(4))]
    poses = [PosedFrame(f"0/{k}", np.linalg.inv(T) @ T_world_obj, T, T) for k, T in enumerate(cameras)]
    _, second = motions(poses, MIDDLE, NONE)
    assert (second.reference, second.kind) == ("world", "moved")
    assert (second.moved_mm, second.turned_deg) == pytest.approx((0, 0), abs=1e-4)
    assert (second.lifted_mm, second.tilted_deg, second.drift_mm) == pytest.approx((0, 0, 0), abs=1e-4)


def test_a_table_gives_height_and_tilt_and_a_turn_on_it_is_none() -> None:
    lying = transform(axis_angle(np.array([1.0, 0, 0]), np.radians(40)), MIDDLE)
    up = np.eye(4)
    poses = [moved(0, 0), moved(25, 3), moved(25, 3) @ transform(np.eye(3), Z * 0.007), moved(25, 3) @ lying]
    _, turned, lifted, tilted = motions([PosedFrame("0/1", T, None, up) for T in poses], MIDDLE, NONE)
    assert (turned.lifted_mm, turned.tilted_deg) == pytest.approx((0, 0), abs=1e-6)
    assert turned.turned_deg == pytest.approx(25)
    assert lifted.lifted_mm == pytest.approx(7)
    assert tilted.tilted_deg == pytest.approx(40)
    assert tilted.drift_mm is None


def test_drift_adds_up_what_no_frame_shows() -> None:
    poses = [PosedFrame(f"0/{k}", moved(0, 0.4 * k), np.eye(4)) for k in range(51)]
    counts = counted(motions(poses, MIDDLE, NONE))
    assert counts.drift_mm == pytest.approx(20)
    assert counts.median_mm == pytest.approx(0.4)
    assert counts.text.endswith("median 0.4 mm and 0° a frame in the world; 20.0 mm from where it began.")


@given(st.floats(-180, 180), st.floats(0, 40))
def test_a_turn_about_a_declared_axis_is_no_motion(degrees: float, mm: float) -> None:
    around = [moved(k, 0, base=np.eye(4)) for k in range(0, 360, 5)]
    symmetries = np.array(around)
    pose = [PosedFrame("0/1", moved(0, 0), None, np.eye(4)), PosedFrame("0/2", moved(degrees, mm), None, np.eye(4))]
    _, second = motions(pose, MIDDLE, NONE, symmetries)
    assert second.kind == "moved"
    assert second.turned_deg <= 2.5 + 1e-6
    assert second.moved_mm == pytest.approx(mm, abs=1e-3)
