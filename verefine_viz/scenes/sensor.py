"""A stereo depth sensor, simulated from perfect depth. Same arguments, same bits.

The error is made where such a sensor makes it, in disparity: ``disparity = focal length · baseline / z``. An error of σ
pixels becomes ``z² / (f·b) · σ`` metres, so noise and quantisation steps both grow with z².
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, maximum_filter, minimum_filter

from verefine_viz.core.arrays import Mask
from verefine_viz.core.camera import Camera

DEPTH_UNIT_M = 1e-4
"""Depth comes out in whole steps of this [m], as in 16-bit depth images."""


@dataclass(frozen=True)
class Sensor:
    """Quality of the sensor. The defaults are those of a good stereo camera that sees a table at 0.7 m."""

    baseline_m: float = 0.055
    """Baseline: the distance of its two cameras [m]."""
    noise_px: float = 0.05
    """Standard deviation of the disparity error [px]: 0.8 mm at 0.7 m with f = 570 px."""
    noise_grain_px: float = 1.2
    """Correlation length of the errors of neighbouring pixels [px]: matching uses windows."""
    disparity_step_px: float = 1 / 32
    """Quantisation of disparity [px]: 0.5 mm at 0.7 m; 0 = none."""
    edge_dropout: float = 0.6
    """Share of pixels at depth jumps that are not measured."""
    edge_jump_m: float = 0.015
    """Least depth jump within a 3 × 3 window, beyond the change by a slanted surface [m]."""
    grazing_start_deg: float = 70.0
    """Angle between ray and surface normal from which on pixels drop out …"""
    grazing_end_deg: float = 86.0
    """… and at which all of them do [deg]."""


STEREO = Sensor()


def sense(
    depth_m: NDArray[np.floating],
    normals_cam: NDArray[np.floating],
    camera: Camera,
    seed: int | Sequence[int],
    sensor: Sensor = STEREO,
) -> NDArray[np.float32]:
    """The depth image (H, W) [m] of a scene by ``sensor``; 0 where nothing was measured.

    Args:
        depth_m: true z, (H, W) [m]; 0 where there is nothing.
        normals_cam: (H, W, 3) true unit normals towards the camera.
        camera: intrinsics.
        seed: of noise and drop-outs.
        sensor: its quality.
    """
    # One stream per effect, so that switching one off leaves the others as they were.
    noise_rng, edge_rng, grazing_rng = (np.random.default_rng(s) for s in np.random.SeedSequence(seed).spawn(3))
    z = np.asarray(depth_m, dtype=np.float64)
    measured = z > 0
    z = _with_noise(z, camera, sensor, noise_rng)
    measured &= ~(_edge_mask(np.asarray(depth_m), sensor) & (edge_rng.random(z.shape) < sensor.edge_dropout))
    measured &= grazing_rng.random(z.shape) >= _grazing_dropout(normals_cam, camera, sensor)
    return np.where(measured, np.rint(z / DEPTH_UNIT_M) * DEPTH_UNIT_M, 0.0).astype(np.float32)


def _with_noise(z: NDArray, camera: Camera, sensor: Sensor, rng: np.random.Generator) -> NDArray:
    fb = camera.fx * sensor.baseline_m
    disparity = np.divide(fb, z, out=np.zeros_like(z), where=z > 0)
    noise = rng.standard_normal(z.shape)
    if sensor.noise_px > 0:
        if sensor.noise_grain_px > 0:
            noise = gaussian_filter(noise, sensor.noise_grain_px, mode="wrap")
            noise /= noise.std()
        disparity = disparity + sensor.noise_px * noise
    if sensor.disparity_step_px > 0:
        disparity = np.rint(disparity / sensor.disparity_step_px) * sensor.disparity_step_px
    return np.divide(fb, disparity, out=np.zeros_like(z), where=(z > 0) & (disparity > 0))


def _edge_mask(z: NDArray, sensor: Sensor) -> Mask:
    """Pixels within one pixel of a depth jump; a slanted plane has none, however steep its depth changes."""
    # In a plane 1/z is linear in the pixel: its second difference shows jumps, not slants.
    inv = np.divide(1.0, z, out=np.zeros(z.shape), where=z > 0)
    jump = np.zeros(z.shape, dtype=bool)
    limit = sensor.edge_jump_m * inv * inv
    jump[:, 1:-1] |= np.abs(inv[:, 2:] - 2 * inv[:, 1:-1] + inv[:, :-2]) > limit[:, 1:-1]
    jump[1:-1] |= np.abs(inv[2:] - 2 * inv[1:-1] + inv[:-2]) > limit[1:-1]
    # Where an object borders on empty pixels, 1/z falls to 0, which is an edge, too.
    missing = minimum_filter(z > 0, size=3) != maximum_filter(z > 0, size=3)
    return (jump | missing) & (z > 0)


def _grazing_dropout(normals_cam: NDArray[np.floating], camera: Camera, sensor: Sensor) -> NDArray:
    """Probability (H, W) that a pixel drops out because its surface is seen at a grazing angle."""
    rays = camera.back_project(np.ones(camera.shape))
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    cosine = np.clip(np.abs(np.einsum("hwi,hwi->hw", np.asarray(normals_cam, np.float64), rays)), 0.0, 1.0)
    angle_deg = np.rad2deg(np.arccos(cosine))
    span = sensor.grazing_end_deg - sensor.grazing_start_deg
    return np.clip((angle_deg - sensor.grazing_start_deg) / span, 0.0, 1.0)
