"""Group laws of rigid transforms, sampled uniformly, near the identity and near half turns."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from verefine_viz.core.errors import ShapeError
from verefine_viz.core.geometry import (
    ORTHONORMAL_TOLERANCE,
    angle_between,
    apply,
    as_rigid,
    axis_angle,
    inverse,
    nearest_rotation,
    quat_wxyz,
    rotation_of_quat_wxyz,
    rotation_vector,
    transform,
)

axes = st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda v: np.linalg.norm(v) > 1e-3)
angles = st.one_of(st.floats(0, np.pi), st.floats(0, 1e-6), st.floats(np.pi - 1e-6, np.pi))
poses = st.builds(lambda a, w, t: transform(axis_angle(a, w), t), axes, angles, st.tuples(*[st.floats(-5, 5)] * 3))


@given(poses, poses)
def test_inverse_and_chain(T_a_b, T_b_c) -> None:  # type: ignore[no-untyped-def]
    assert np.allclose(inverse(T_a_b) @ T_a_b, np.eye(4), atol=1e-12)
    assert np.allclose(inverse(T_a_b @ T_b_c), inverse(T_b_c) @ inverse(T_a_b), atol=1e-12)
    points = np.array([[1.0, 2, 3], [0, 0, 0]])
    assert np.allclose(apply(T_a_b @ T_b_c, points), apply(T_a_b, apply(T_b_c, points)), atol=1e-12)
    assert np.allclose(inverse(np.stack([T_a_b, T_b_c]))[1], inverse(T_b_c))


@given(axes, angles)
def test_axis_angle_agrees_with_scipy_and_comes_back(axis, angle) -> None:  # type: ignore[no-untyped-def]
    unit = np.asarray(axis) / np.linalg.norm(axis)
    R = axis_angle(axis, angle)
    assert np.allclose(R, Rotation.from_rotvec(unit * angle).as_matrix(), atol=1e-12)
    assert np.allclose(axis_angle(unit, np.linalg.norm(rotation_vector(R))) if angle < 3 else R, R, atol=1e-9)
    assert abs(np.linalg.norm(rotation_vector(R)) - angle) < 1e-7
    assert abs(angle_between(np.eye(3), R) - angle) < 1e-7


@given(poses)
def test_quaternions_agree_with_scipy_up_to_sign(T) -> None:  # type: ignore[no-untyped-def]
    R = T[:3, :3]
    w, x, y, z = quat_wxyz(R)
    theirs = Rotation.from_matrix(R).as_quat()
    assert abs(abs(np.dot([x, y, z, w], theirs)) - 1) < 1e-9
    assert np.allclose(rotation_of_quat_wxyz(quat_wxyz(R)), R, atol=1e-9)
    assert np.allclose(rotation_of_quat_wxyz(-2 * quat_wxyz(R)), R, atol=1e-9)


@given(poses)
def test_checking_a_pose_twice_keeps_its_bits(T) -> None:  # type: ignore[no-untyped-def]
    once = as_rigid(T, "pose")
    assert np.array_equal(once, T)
    assert np.array_equal(as_rigid(once, "pose"), once)
    rounded = as_rigid(np.round(T, 5), "pose")
    assert np.allclose(rounded[:3, :3].T @ rounded[:3, :3], np.eye(3), atol=ORTHONORMAL_TOLERANCE * 1.01)
    assert np.array_equal(as_rigid(rounded, "pose"), rounded)


@given(poses)
def test_the_nearest_rotation_is_a_rotation_and_leaves_one_alone(T) -> None:  # type: ignore[no-untyped-def]
    rng = np.random.default_rng(0)
    noisy = nearest_rotation(T[:3, :3] + rng.normal(size=(3, 3)) * 0.1)
    assert np.allclose(noisy.T @ noisy, np.eye(3), atol=1e-12)
    assert abs(np.linalg.det(noisy) - 1) < 1e-12
    assert np.allclose(nearest_rotation(T[:3, :3]), T[:3, :3], atol=1e-12)


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (np.eye(3), r"pose has shape \(3, 3\), expected 4×4"),
        (np.full((4, 4), np.nan), "pose holds NaN or infinity"),
        (np.diag([1.0, 1, -1, 1]), r"det\(R\) = -1.000, it is a mirror image; expected a rotation"),
        (np.diag([1.0, 1, 1.03, 1]), r"det\(R\) = 1.030, RᵀR is 0.061 from the identity; .* off by 0.05 at most"),
        (np.zeros((4, 4)), r"det\(R\) = 0.000, RᵀR is 1 from the identity"),
        (np.diag([2.0, 2, 2, 1]), r"det\(R\) = 8.000"),
        (np.vstack([np.eye(4)[:3], [0, 0, 1, 1]]), "last row"),
        ("pose", "is no array of numbers"),
    ],
)
def test_what_is_not_a_pose_is_said(value, expected) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(ShapeError, match=expected):
        as_rigid(value, "pose")
