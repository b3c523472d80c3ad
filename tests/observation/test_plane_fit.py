"""The plane through most points: right for any plane, and blind to what lies off it."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from verefine_viz.core.geometry import axis_angle
from verefine_viz.observation.support_plane import Plane, fitted

TOLERANCE_M = 0.01
tilts = st.floats(-1.2, 1.2)


def spread(seed: int, plane: Plane, noise_m: float) -> np.ndarray:
    """Points (500, 3) around the plane, within 0.4 m of its point nearest to the camera."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(-0.4, 0.4, (500, 3))
    points -= np.outer(points @ plane.normal, plane.normal)
    return points + (rng.normal(0, noise_m, (500, 1)) - plane.offset_m) * plane.normal


def tilted(x: float, y: float, offset_m: float) -> Plane:
    return Plane.towards_camera(axis_angle([1, 0, 0], x) @ axis_angle([0, 1, 0], y) @ [0.0, 0.0, -1.0], offset_m)


@given(tilts, tilts, st.floats(0.3, 2.0), st.integers(0, 99))
def test_finds_a_plane_again_from_one_a_little_beside_it(x: float, y: float, offset_m: float, seed: int) -> None:
    true = tilted(x, y, offset_m)
    points = spread(seed, true, 0.0)
    found = fitted(Plane(tilted(x + 0.005, y, offset_m).normal, true.offset_m + 0.002), points, TOLERANCE_M)
    np.testing.assert_allclose(found.normal, true.normal, atol=1e-7)
    np.testing.assert_allclose(found.offset_m, true.offset_m, atol=1e-7)
    assert found.touches(points, 1e-6).all()


@given(tilts, tilts, st.integers(0, 99))
def test_is_the_least_squares_plane_of_the_points_on_it(x: float, y: float, seed: int) -> None:
    """As numpy's singular values have it; what lies off the plane does not count."""
    true = tilted(x, y, 0.8)
    points = spread(seed, true, 0.0004)
    above = points[:200] + 0.1 * true.normal
    found = fitted(true, np.concatenate([points, above]), TOLERANCE_M)
    centre = points.mean(axis=0)
    normal = np.linalg.svd(points - centre)[2][2]
    assert abs(float(normal @ found.normal)) > 1 - 1e-12
    np.testing.assert_allclose(found.heights(centre[None]), 0.0, atol=1e-12)
    assert not found.touches(above, TOLERANCE_M).any()


@given(tilts, tilts, st.floats(0.006, 0.009), st.integers(0, 99))
def test_what_lies_flat_on_one_side_of_it_does_not_tilt_it(x: float, y: float, height_m: float, seed: int) -> None:
    """A cloth, a book, a keyboard: thinner than the tolerance."""
    true = tilted(x, y, 0.8)
    points = spread(seed, true, 0.001)
    side = points @ axis_angle([1, 0, 0], x)[:, 0]
    on_cloth = np.argsort(side)[:60]
    points[on_cloth] += height_m * true.normal
    found = fitted(true, points, TOLERANCE_M)
    assert np.degrees(np.arccos(min(1.0, found.normal @ true.normal))) < 0.15
    assert abs(found.heights(-true.offset_m * true.normal[None])[0]) < 0.0005


@given(tilts, tilts, st.floats(0.0, 0.007), st.integers(0, 99))
def test_holds_in_noise(x: float, y: float, noise_m: float, seed: int) -> None:
    """Also in noise that is wider than what is to be left out."""
    true = tilted(x, y, 0.8)
    found = fitted(true, spread(seed, true, noise_m), TOLERANCE_M)
    assert np.degrees(np.arccos(min(1.0, found.normal @ true.normal))) < 0.6
    assert abs(found.heights(-true.offset_m * true.normal[None])[0]) < 0.0015


def test_points_all_beside_the_plane_leave_it_between_them() -> None:
    """Where depth comes in steps no point is near."""
    true = Plane(np.array([0.0, 0.0, -1.0]), 0.8)
    points = spread(0, true, 0.0)
    step = 0.004 * true.normal
    points = np.concatenate([points + step, points - step])
    found = fitted(true, points, TOLERANCE_M)
    np.testing.assert_allclose([*found.normal, found.offset_m], [0.0, 0.0, -1.0, 0.8], atol=1e-9)


@given(tilts, tilts, st.floats(0.1, 3.0), st.floats(0.1, 10.0))
def test_the_camera_is_above_it(x: float, y: float, offset_m: float, scale: float) -> None:
    plane = tilted(x, y, offset_m)
    for sign in (scale, -scale):
        same = Plane.towards_camera(sign * plane.normal, sign * plane.offset_m)
        np.testing.assert_allclose([*same.normal, same.offset_m], [*plane.normal, plane.offset_m], atol=1e-12)
        assert same.heights(np.zeros((1, 3)))[0] > 0
