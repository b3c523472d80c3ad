"""Measures the noise of a depth image in the image itself, and how it changes the score of a pose.

A stereo or structured-light sensor errs in disparity, so the noise of inverse depth 1/z is about the same everywhere,
and the noise of z grows with z² (Khoshelham and Elberink 2012; simulated by :mod:`verefine_viz.scenes.sensor`). Planes
are linear in 1/z: their residuals in small blocks of the frame give the size of the noise, and how far neighbouring
pixels share it. The noise is then resampled, normals are estimated again, and the response of the score to both is
taken as linear: a pose costs one set of score maps instead of one score for every resampled image.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter
from scipy.special import erf

from verefine_viz.core.arrays import Float
from verefine_viz.core.camera import Camera
from verefine_viz.core.geometry import apply, axis_angle, transform
from verefine_viz.core.observation import Observation
from verefine_viz.core.problem import Placed, Target
from verefine_viz.core.protocols import Verifier
from verefine_viz.core.scores import PixelGrid
from verefine_viz.evaluation.fit_error import NO_FIT_ERROR, fit_error
from verefine_viz.observation.normals import estimate_normals

BLOCK_PX = 15
"""Side of the blocks in which a plane is fitted."""
FEWEST_BLOCKS = 12
"""Least number of blocks with complete depth; with fewer, the noise of a usual sensor is assumed."""
USUAL_PER_M, USUAL_GRAIN_PX = 1.6e-3, 1.2
"""Noise of 1/z [1/m] (0.8 mm at 0.7 m) and its grain, where a frame does not show its own."""
GRAINS_PX = (0.0, 0.6, 0.8, 1.0, 1.2, 1.5, 1.8, 2.2, 2.6, 3.0)
"""Grains that are distinguished: the residuals of noise finer than 0.6 px are those of white noise."""
N_DRAWS = 12
"""How often the noise is resampled: a standard deviation is known to 20 %."""
MOST_CELLS = 2500
"""Most cells of pixels in which the response of the score to noise is computed."""
SAMPLED = 2
"""Rows, and columns, of a cell in which normals are estimated."""
JITTER_MM, JITTERS = 0.03, 3
"""Step by which a pose is moved, and turned [deg], to measure how finely its score resolves; and steps to each side."""
MARGIN_PX = 12
"""Margin around the object: the reach of a normal's window."""


@dataclass(frozen=True)
class DepthNoise:
    """Noise of a depth image."""

    per_m: float
    """Standard deviation of 1/z [1/m]."""
    grain_px: float
    """Standard deviation of the Gaussian that makes such noise from white noise [px]; 0 = white."""

    def at_m(self, z_m: Float) -> Float:
        """Standard deviation of z [m] at distances ``z_m`` [m]."""
        return self.per_m * z_m * z_m


_measured: WeakKeyDictionary[Observation, DepthNoise] = WeakKeyDictionary()


def depth_noise(observation: Observation) -> DepthNoise:
    """The noise of a frame; measured once."""
    if observation not in _measured:
        _measured[observation] = _measure(observation.depth_m)
    return _measured[observation]


def _measure(depth_m: NDArray[np.float32]) -> DepthNoise:
    rows, columns = (n // BLOCK_PX for n in depth_m.shape)
    z = depth_m[: rows * BLOCK_PX, : columns * BLOCK_PX].astype(np.float64)
    blocks = z.reshape(rows, BLOCK_PX, columns, BLOCK_PX).swapaxes(1, 2).reshape(-1, BLOCK_PX**2)
    blocks = blocks[(blocks > 0).all(axis=1)]
    if len(blocks) < FEWEST_BLOCKS:
        return DepthNoise(USUAL_PER_M, USUAL_GRAIN_PX)
    inverse = 1.0 / blocks
    rest = inverse - (inverse @ _PLANE) @ _PLANE.T
    variance = (rest * rest).mean(axis=1)
    # Half of the blocks may hold edges and curved surfaces without changing the median by much.
    typical = float(np.median(variance))
    smooth = rest[variance <= typical].reshape(-1, BLOCK_PX, BLOCK_PX)
    shared = float((smooth[:, :, 2:] * smooth[:, :, :-2]).mean() / max(float((smooth * smooth).mean()), 1e-30))
    # Expected residuals for noise of each grain: a plane also fits some of coarse noise.
    left, expected = _residuals()
    grain_px = float(np.interp(shared, expected, GRAINS_PX))
    return DepthNoise(float(np.sqrt(typical / np.interp(grain_px, GRAINS_PX, left))), grain_px)


_V, _U = np.mgrid[:BLOCK_PX, :BLOCK_PX].reshape(2, -1)
_PLANE = np.linalg.qr(np.stack([np.ones(BLOCK_PX**2), _U, _V], axis=1))[0]


@cache
def _residuals() -> tuple[Float, Float]:
    """For each of the ``GRAINS_PX``: the share of the noise's variance that remains after a plane fit, and the
    correlation of residuals two pixels apart in a row.
    """
    square = (_U[:, None] - _U) ** 2 + (_V[:, None] - _V) ** 2
    i, j = np.nonzero((_U[:, None] + 2 == _U) & (_V[:, None] == _V))
    every = np.arange(BLOCK_PX**2)
    left, shared = [], []
    for grain_px in GRAINS_PX:
        # Correlation of noise smoothed by a Gaussian: exp(−(k / 2σ)²) at a distance of k pixels.
        alike = np.exp(-square / (4 * max(grain_px, 0.1) ** 2))
        by_plane = alike @ _PLANE
        within = _PLANE.T @ by_plane

        def rest_covariance(
            a: NDArray, b: NDArray, alike: Float = alike, x: Float = by_plane, y: Float = within
        ) -> float:
            taken = (_PLANE[a] * x[b]).sum(axis=1) + (x[a] * _PLANE[b]).sum(axis=1)
            return float((alike[a, b] - taken + ((_PLANE[a] @ y) * _PLANE[b]).sum(axis=1)).mean())

        left.append(rest_covariance(every, every))
        shared.append(rest_covariance(i, j) / left[-1])
    return np.array(left), np.array(shared)


def resampled(depth_m: NDArray[np.floating], noise: DepthNoise, rng: np.random.Generator) -> NDArray[np.float32]:
    """The depth image (H, W) [m] with further noise of this kind; 0 stays 0."""
    # Uniform, which is faster to draw: only the variance and the grain of the noise matter.
    grain = (rng.random(depth_m.shape, dtype=np.float32) - np.float32(0.5)) * np.float32(np.sqrt(12))
    if noise.grain_px > 0:
        # Divided by the norm of the filter, so that the noise has variance 1 again.
        grain = gaussian_filter(grain, noise.grain_px, mode="wrap", truncate=3) * _gain(noise.grain_px)
    # 1 / (1/z + ε) = z / (1 + ε z)
    return (depth_m / np.maximum(1 + np.float32(noise.per_m) * grain * depth_m, np.float32(0.1))).astype(np.float32)


@cache
def _gain(grain_px: float) -> float:
    impulse = np.zeros(2 * int(4 * grain_px + 2) + 1)
    impulse[len(impulse) // 2] = 1.0
    return float(1.0 / (gaussian_filter(impulse, grain_px, truncate=3) ** 2).sum())


class ScoreNoise:
    """Noise of the difference between the scores of two poses of one object.

    Noise that changes both scores alike does not count. The resolution of the score does: it counts whole pixels, and
    which pixels at the outline count changes with hundredths of a millimetre.

    Args:
        verifier: the verifier of the scores.
        target: the object in its frame.
        T_cam_obj: (4, 4) the reference pose, which others are compared with.
        placed: other objects that may hide parts.
        free: motions that were free when the pose was fitted, each as the poses (4, 4) at its two ends. The residual of
            the fit then shows errors of depth and mesh (:mod:`verefine_viz.evaluation.fit_error`) beside the noise of
            the pixels; and noise that these motions can undo does not count.
    """

    def __init__(
        self,
        verifier: Verifier,
        target: Target,
        T_cam_obj: Float,
        placed: Sequence[Placed] = (),
        free: Sequence[tuple[Float, Float]] = (),
    ) -> None:
        self._verifier, self._target, self._placed = verifier, target, tuple(placed)
        observation = target.observation
        noise = depth_noise(observation)
        top, left, rows, columns, step = _window(target, T_cam_obj)
        self._step = step
        self._grid = PixelGrid(
            top + step // 2 + step * np.arange(rows, dtype=np.int64),
            left + step // 2 + step * np.arange(columns, dtype=np.int64),
        )
        error = NO_FIT_ERROR
        if free:
            at_object_m = float(noise.at_m(np.asarray(apply(T_cam_obj, target.model.middle_m[None])[0, 2])))
            maps = verifier.maps(target, T_cam_obj, self._placed, self._grid)
            error = fit_error(maps, step, at_object_m, noise.grain_px)
        here = np.s_[top : top + rows * step, left : left + columns * step]
        depth_m, camera = observation.depth_m[here], observation.camera
        K = np.array([[camera.fx, 0, camera.cx - left], [0, camera.fy, camera.cy - top], [0, 0, 1]])
        part = Camera(K, depth_m.shape[1], depth_m.shape[0])
        centre_m = depth_m[np.ix_(self._grid.rows - top, self._grid.columns - left)].astype(np.float64)
        self._spread_m = np.maximum(np.hypot(noise.at_m(centre_m), error.std_m), 1e-9)
        # A cell represents all of its pixels. Their normals share most of their windows, so a few pixels are enough.
        own = np.unique(np.linspace(0, step - 1, SAMPLED + 2).round().astype(np.int64)[1:-1])
        sampled = PixelGrid(*((step * np.arange(n)[:, None] + own).ravel() for n in (rows, columns)))

        def cell_means(values: NDArray[np.float32]) -> NDArray[np.float32]:
            """The mean of each cell, from the values of some of its pixels."""
            n = len(values) // rows
            by_row = values.reshape(rows, n, *values.shape[1:]).sum(axis=1)
            return by_row.reshape(rows, columns, n, *values.shape[2:]).sum(axis=2) / n**2

        rng = np.random.default_rng(0)
        before = estimate_normals(depth_m, part, at=sampled)
        changes = np.empty((N_DRAWS, rows, columns, 4), np.float32)
        for change in changes:
            drawn_m = resampled(depth_m, noise, rng)
            drawn_m = np.where(drawn_m > 0, drawn_m + error.draw(depth_m.shape, rng), 0).astype(np.float32)
            change[..., 0] = cell_means(drawn_m - depth_m)
            change[..., 1:] = cell_means(estimate_normals(drawn_m, part, at=sampled) - before)
        self._changes = changes.reshape(N_DRAWS, -1)
        self._scores = verifier.settings
        scores = verifier.score(target, _jittered(T_cam_obj), placed)
        # Relative to both neighbours, so that a steady rise or fall is not taken for a jump.
        jumps = np.diff(scores.score, 2)
        self._resolution = float(np.sqrt(np.mean(jumps**2) / 6))
        self.score = float(scores.score[JITTERS])
        """Score of the reference pose."""
        self.least = float(np.sqrt(2) * self._resolution)
        """The noise of a difference to a pose that looks the same: how finely the score resolves."""
        slope = self._slope_of(T_cam_obj, int(scores.n_pixels[JITTERS]))
        # Without maps the images are scored one by one, and scores of two poses are taken as independent.
        self._drawn = None if slope is not None else self._spread_of_images(T_cam_obj, noise)
        self._slope = np.zeros(0, np.float32) if slope is None else slope
        spread = self._spread(self._slope) if self._drawn is None else self._drawn
        self.most = 2.0 * float(np.hypot(spread, self._resolution))
        """About the largest noise of a difference: that of two poses with independent scores."""
        self.gradient: Float | None = None
        """(draws, n) the noise of the difference between the two ends of each free motion; None where there are none,
        or the score is not made of pixels."""
        self._motions: Float | None = None
        if free and slope is not None:
            n_pixels = int(scores.n_pixels[JITTERS])
            ends = [[self._slope_of(end, n_pixels) for end in pair] for pair in free]
            self._undo(np.array([there - back for there, back in ends if there is not None and back is not None]))

    def of(self, T_cam_obj: Float, n_pixels: int) -> float:
        """Standard deviation of the score of ``T_cam_obj`` (4, 4) minus that of the reference pose; ``n_pixels``: N of
        the score.
        """
        return float(np.hypot(self.of_depth(T_cam_obj, n_pixels), self.least))

    def of_depth(self, T_cam_obj: Float, n_pixels: int) -> float:
        """The part of this deviation that is due to the noise of the depth image."""
        slope = None if self._drawn is not None else self._slope_of(T_cam_obj, n_pixels)
        if slope is None:
            return np.sqrt(2) * (self._drawn or 0.0)
        apart = slope - self._slope
        if self._motions is not None:
            own = (apart * self._unit).astype(np.float64)
            rest = own - self._motions @ (self._motions.T @ own)
            apart = (rest / self._unit).astype(np.float32)
        return self._spread(apart)

    def _undo(self, slopes: NDArray[np.float32]) -> None:
        """Take into account free motions by ``slopes`` (n, cells · 4), the difference between the two ends of each."""
        self.gradient = np.einsum("ki,ni->kn", self._changes, slopes).astype(np.float64)
        # In units of each cell's noise, so that cells count by their share of it.
        self._unit = np.sqrt(np.mean(self._changes**2, axis=0)) + np.float32(1e-12)
        self._motions = np.linalg.qr((slopes * self._unit).T.astype(np.float64))[0]

    def _spread_of_images(self, T_cam_obj: Float, noise: DepthNoise) -> float:
        """Standard deviation of a pose's score over resampled images."""
        observation, rng = self._target.observation, np.random.default_rng(0)
        scores: list[float] = []
        for _ in range(N_DRAWS):
            drawn = replace(observation, depth_m=resampled(observation.depth_m, noise, rng))
            target = replace(self._target, observation=drawn)
            scores.append(float(self._verifier.score(target, T_cam_obj[None], self._placed).score[0]))
        return float(np.std(scores))

    def _spread(self, slope: NDArray[np.float32]) -> float:
        # Not by BLAS, whose bits depend on the number of threads.
        return float(np.sqrt(np.mean(np.einsum("ki,i->k", self._changes, slope) ** 2)))

    def _slope_of(self, T_cam_obj: Float, n_pixels: int) -> NDArray[np.float32] | None:
        """(cells · 4,) how the score changes with depth [1/m] and the three parts of the normal in each cell; None
        where the score is not made of pixels.
        """
        s = self._scores
        maps = self._verifier.maps(self._target, T_cam_obj, self._placed, self._grid)
        if maps is None:
            return None
        off_m = np.nan_to_num(maps.depth_difference_m.astype(np.float64))
        # Eq. 1: f_d = 1 − |d − d̂| / τ; |x| of a noisy x has the slope erf(x / √2σ) on average.
        by_depth = -erf(off_m / (np.sqrt(2) * self._spread_m)) / s.tau_m * (maps.f_d > 0)
        has_normal = np.isfinite(maps.angle_rad)
        # Where no normal was observed, f_d counts in its place (docs/methods.md 1.8.26).
        by_depth = np.where(has_normal | (s.pixels == "published"), by_depth, 2 * by_depth)
        # Eq. 1: f_n = 1 − (1 − n·n̂) / α.
        by_normal = maps.rendered_normals * ((maps.f_n > 0) & has_normal)[..., None] / s.alpha
        slope = np.dstack([by_depth, by_normal]).ravel() * (self._step**2 / (2.0 * max(n_pixels, 1)))
        return slope.astype(np.float32)


def _jittered(T_cam_obj: Float) -> Float:
    """(2 · JITTERS + 1, 4, 4) the pose in the middle of others on a line on which it moves and turns by a little."""
    along, about = np.array([1.0, 1, 1]) / np.sqrt(3), np.array([1.0, 1, -1]) / np.sqrt(3)
    Ts: list[Float] = []
    for k in range(-JITTERS, JITTERS + 1):
        R = axis_angle(about, k * np.deg2rad(JITTER_MM)) @ T_cam_obj[:3, :3]
        Ts.append(transform(R, T_cam_obj[:3, 3] + k * 1e-3 * JITTER_MM * along))
    Ts[JITTERS] = T_cam_obj
    return np.array(Ts)


def _window(target: Target, T_cam_obj: Float) -> tuple[int, int, int, int, int]:
    """Top, left, rows and columns of cells, and side of a cell [px], around the object's mask and its model."""
    camera, mask = target.observation.camera, target.instance.mask
    v, u = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    points_cam = apply(T_cam_obj, target.model.points)
    pixels = [camera.project(points_cam[points_cam[:, 2] > 0.01])]
    if len(v):
        pixels.append(np.array([[u[0], v[0]], [u[-1], v[-1]]], np.float64))
    limits = np.array([camera.width, camera.height], np.float64)
    around = np.clip(np.concatenate(pixels), 0, limits)
    around = around if len(around) else np.array([[0.0, 0.0], limits])
    low = np.clip(np.floor(around.min(axis=0)) - MARGIN_PX, 0, limits - 1).astype(int)
    high = np.clip(np.ceil(around.max(axis=0)) + MARGIN_PX, 1, limits).astype(int)
    size = np.maximum(high - low, 1)
    step = max(1, int(np.ceil(np.sqrt(size[0] * size[1] / MOST_CELLS))))
    columns, rows = np.maximum(size // step, 1)
    return int(low[1]), int(low[0]), int(rows), int(columns), step
