"""How far a pose was moved, as six numbers: back and forth, along the camera's axes and the object's."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import axis_angle, transform
from verefine_viz.viewer.state.edited_pose import Axes, displaced, displacement

SEEDS = st.integers(0, 10_000)
AXES = st.sampled_from(["camera", "object"])


def pose(seed: int) -> Float:
    rng = np.random.default_rng(seed)
    return transform(axis_angle(rng.normal(size=3), rng.uniform(0, 3.1)), rng.normal(size=3))


@given(one=SEEDS, other=SEEDS, axes=AXES)
def test_the_numbers_between_two_poses_lead_from_one_to_the_other(one: int, other: int, axes: Axes) -> None:
    T_from, T_to = pose(one), pose(other)
    assert displaced(T_from, *displacement(T_from, T_to, axes), axes) == pytest.approx(T_to, abs=1e-8)


@given(seed=SEEDS, axes=AXES)
def test_no_numbers_leave_the_pose_bit_for_bit(seed: int, axes: Axes) -> None:
    assert np.array_equal(displaced(pose(seed), np.zeros(3), np.zeros(3), axes), pose(seed))


def test_along_the_camera_and_along_the_object() -> None:
    T_from = transform(axis_angle([0, 0, 1], np.pi / 2), [0.1, 0.2, 0.7])
    along_camera = displaced(T_from, np.array([10.0, 0, 0]), np.array([0, 30.0, 0]), "camera")
    assert along_camera[:3, 3] == pytest.approx([0.11, 0.2, 0.7])
    assert along_camera[:3, :3] == pytest.approx(axis_angle([0, 1, 0], np.deg2rad(30)) @ T_from[:3, :3])
    along_object = displaced(T_from, np.array([10.0, 0, 0]), np.array([0, 30.0, 0]), "object")
    assert along_object[:3, 3] == pytest.approx([0.1, 0.21, 0.7])
    assert along_object[:3, :3] == pytest.approx(T_from[:3, :3] @ axis_angle([0, 1, 0], np.deg2rad(30)))
