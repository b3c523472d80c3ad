"""A rotation apart into tilt and turn: how the two are put together again, and what they are of."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from tests.fakes import box_model
from tests.made_up_frames import model
from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import angle_between, axis_angle, transform
from verefine_viz.evaluation.rotation_errors import rotation_error_deg, turning, turning_of

ANGLES = st.floats(0.0, 179.0)
SEEDS = st.integers(0, 10_000)
EXACT_DEG = 1e-5


def across(axis: Float, seed: int) -> Float:
    """A unit vector at right angles to ``axis``."""
    found = np.cross(axis, np.random.default_rng(seed).normal(size=3))
    return found / np.linalg.norm(found)


def some_axis(seed: int) -> Float:
    axis = np.random.default_rng(seed + 1).normal(size=3)
    return axis / np.linalg.norm(axis)


@given(tilt=ANGLES, turn=ANGLES, sign=st.sampled_from([-1, 1]), seed=SEEDS)
def test_a_tilt_of_a_turn_is_taken_apart_into_both(tilt: float, turn: float, sign: int, seed: int) -> None:
    axis = some_axis(seed)
    R = axis_angle(across(axis, seed), np.radians(tilt)) @ axis_angle(axis, sign * np.radians(turn))
    found = turning_of(R, axis)
    assert (found.tilt_deg, found.turn_deg) == pytest.approx((tilt, turn), abs=EXACT_DEG)
    whole = np.degrees(angle_between(np.eye(3), R))
    assert max(found.tilt_deg, found.turn_deg) <= whole + EXACT_DEG
    assert whole <= found.tilt_deg + found.turn_deg + EXACT_DEG
    halves = [np.cos(np.radians(x) / 2) for x in (whole, found.tilt_deg, found.turn_deg)]
    assert halves[0] == pytest.approx(halves[1] * halves[2], abs=1e-9)


@given(angle=ANGLES, seed=SEEDS)
def test_the_tilt_is_where_the_axis_goes(angle: float, seed: int) -> None:
    axis = some_axis(seed)
    R = axis_angle(some_axis(seed + 7), np.radians(angle))
    assert turning_of(R, axis).tilt_deg == pytest.approx(
        np.degrees(np.arccos(np.clip(axis @ R @ axis, -1, 1))), abs=1e-4
    )
    same = turning_of(R, -axis)
    assert (same.tilt_deg, same.turn_deg) == pytest.approx(
        (turning_of(R, axis).tilt_deg, turning_of(R, axis).turn_deg), abs=EXACT_DEG
    )


@given(tilt=st.floats(0.0, 40.0), turn=st.floats(0.0, 40.0), k=st.integers(0, 3), seed=SEEDS)
def test_a_turn_that_looks_the_same_is_none(tilt: float, turn: float, k: int, seed: int) -> None:
    """A box that looks the same after quarters of a turn about z, standing on a table whose normal is z of its own."""
    assume(np.hypot(tilt, turn) < 44)
    quarters = np.stack([transform(axis_angle([0, 0, 1], q * np.pi / 2), np.zeros(3)) for q in range(4)])
    model = replace(box_model(), symmetries=quarters)
    T_gt = transform(axis_angle(some_axis(seed), 1.0), [0.1, 0.2, 0.7])
    up_cam = T_gt[:3, 2]
    error = axis_angle(across(up_cam, seed), np.radians(tilt)) @ axis_angle(up_cam, np.radians(turn))
    T_est = transform(error @ T_gt[:3, :3] @ quarters[k][:3, :3], [0.1, 0.2, 0.8])
    found = turning(model, T_est, T_gt, up_cam)
    assert (found.tilt_deg, found.turn_deg) == pytest.approx((tilt, turn), abs=EXACT_DEG)
    whole = np.cos(np.radians(rotation_error_deg(model, T_est, T_gt)) / 2)
    assert whole == pytest.approx(np.cos(np.radians(tilt) / 2) * np.cos(np.radians(turn) / 2), abs=1e-9)


def test_a_lying_can_rolls_and_a_standing_one_tilts() -> None:
    can, up = model("can", symmetric=False), np.array([0.0, 0.0, 1.0])
    lying = transform(axis_angle(np.array([1.0, 0, 0]), np.pi / 2), np.zeros(3))
    along = transform(axis_angle(np.array([0, 1.0, 0]), np.deg2rad(40.0)), np.zeros(3))  # The can's axis, as it lies.
    assert turning(can, along @ lying, lying, up).describe(0) == "all of it roll on the table"
    assert turning(can, along, np.eye(4), up).describe(0) == "all of it tilt against the table"
    block = model("cereal", symmetric=False)
    assert turning(block, along @ lying, lying, up).describe(0) == "all of it tilt against the table"
