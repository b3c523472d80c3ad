"""The depth sensor: noise that grows with z², drop-outs where a real one has them, the same bits each time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from verefine_viz.core.camera import Camera
from verefine_viz.scenes.sensor import DEPTH_UNIT_M, Sensor, sense

PERFECT = Sensor(noise_px=0.0, disparity_step_px=0.0, edge_dropout=0.0, grazing_start_deg=90.0, grazing_end_deg=91.0)
"""Measures everything, exactly (to ``DEPTH_UNIT_M``)."""
CAMERA = Camera(np.array([[570.0, 0, 159.5], [0, 570.0, 119.5], [0, 0, 1]]), 320, 240)


def wall(z_m: float) -> tuple[np.ndarray, np.ndarray]:
    """A wall square to the camera: depth and normals."""
    normals = np.zeros((*CAMERA.shape, 3), np.float32)
    normals[..., 2] = -1
    return np.full(CAMERA.shape, z_m, np.float32), normals


def slope(angle_deg: float) -> tuple[np.ndarray, np.ndarray]:
    """A plane through (0, 0, 0.8), turned about x."""
    a = np.deg2rad(angle_deg)
    normal = np.array([0, -np.sin(a), -np.cos(a)])
    rays = CAMERA.back_project(np.ones(CAMERA.shape))
    z = normal @ [0, 0, 0.8] / (rays @ normal)
    return np.where((z > 0) & (z < 5), z, 0).astype(np.float32), np.broadcast_to(normal, rays.shape).astype(np.float32)


def test_a_perfect_sensor_changes_nothing_but_the_unit() -> None:
    depth, normals = slope(50)
    np.testing.assert_allclose(sense(depth, normals, CAMERA, 0, PERFECT), depth, atol=DEPTH_UNIT_M / 2 + 1e-7)


@pytest.mark.parametrize("z_m", [0.4, 0.8, 1.6])
def test_noise_is_the_disparity_error_times_z_squared(z_m: float) -> None:
    sensor = Sensor(noise_px=0.1, noise_grain_px=0.0, disparity_step_px=0.0)
    depth, normals = wall(z_m)
    error = sense(depth, normals, CAMERA, 3, sensor).astype(np.float64) - z_m
    expected_m = z_m**2 / (CAMERA.fx * sensor.baseline_m) * 0.1
    assert error.std() == pytest.approx(expected_m, rel=0.03)
    assert abs(error.mean()) < expected_m * 0.05


def test_grain_keeps_the_size_of_the_noise_and_makes_neighbours_alike() -> None:
    depth, normals = wall(1.0)
    fine, coarse = (
        sense(depth, normals, CAMERA, 0, Sensor(noise_px=0.1, noise_grain_px=g, disparity_step_px=0)) for g in (0, 2)
    )
    assert coarse.std() == pytest.approx(fine.std(), rel=0.1)
    assert np.diff(coarse, axis=1).std() < 0.5 * np.diff(fine, axis=1).std()


def test_quantisation_steps_grow_with_z_squared() -> None:
    sensor = replace(PERFECT, disparity_step_px=1 / 4)
    depth, normals = slope(45)
    z = np.unique(sense(depth, normals, CAMERA, 0, sensor))
    z = z[z > 0].astype(np.float64)
    step = z[1:] ** 2 / (CAMERA.fx * sensor.baseline_m) / 4
    np.testing.assert_allclose(np.diff(z) / step, 1, atol=0.2)


def test_pixels_drop_out_at_jumps_and_not_on_slants() -> None:
    sensor = replace(PERFECT, edge_dropout=1.0)
    depth, normals = slope(60)
    inside = np.s_[1:-1, 1:-1]
    assert (sense(depth, normals, CAMERA, 0, sensor)[inside] > 0).all()
    near, normals = wall(0.8)
    near[:, 160:] = 0.7
    lost = sense(near, normals, CAMERA, 0, sensor) == 0
    assert lost[:, 159:161].all()
    assert not lost[:, :158].any()
    assert not lost[:, 162:].any()


def test_grazing_surfaces_are_lost() -> None:
    sensor = replace(PERFECT, grazing_start_deg=60.0, grazing_end_deg=80.0)
    shares = []
    for angle_deg in (40, 70, 85):
        depth, normals = slope(angle_deg)
        rows = np.s_[115:125]
        shares.append(float((sense(depth, normals, CAMERA, 0, sensor)[rows] > 0).mean()))
    assert shares[0] == 1.0
    assert 0.3 < shares[1] < 0.7
    assert shares[2] == 0.0


def test_the_seed_decides_every_bit() -> None:
    depth, normals = slope(30)
    first, again, other = (sense(depth, normals, CAMERA, seed) for seed in ((7, 1), (7, 1), (7, 2)))
    assert first.tobytes() == again.tobytes()
    assert first.tobytes() != other.tobytes()


def test_what_is_not_there_stays_unmeasured() -> None:
    depth, normals = wall(0.9)
    depth[:50] = 0
    assert (sense(depth, normals, CAMERA, 0)[:50] == 0).all()
