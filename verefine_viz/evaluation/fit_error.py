"""Estimates what a fit leaves unexplained: errors of depth and of the mesh that change slowly over the surface.

The noise of single pixels averages out over an object. What moves a fitted pose are errors that neighbouring pixels
share: a sensor that measures heights short, a mesh that is a millimetre too thick. Their size shows in the residuals:
six motions of the object take only a small part of them away, so what they leave, smoothed, is as large as what they
took, but for a factor that was measured (docs/methods.md 1.15).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from verefine_viz.core.scores import PIXEL_CLASSES, ScoreMaps

SMOOTHED = 1 / 16
"""Residuals are smoothed by a Gaussian of this share of the side of the seen surface."""
GRAIN = 1 / 8
"""Grain of the errors, as a share of the side of the seen surface."""
TAKEN = 3.2
"""Ratio of errors to what a fit leaves of them."""
WHITE = float(1 / np.sqrt(4 * np.pi))
"""Grain that white noise behaves as if it had, smoothed [px]."""
FEWEST = 50
"""Explained pixels of the maps below which nothing is known."""
EXPLAINED = PIXEL_CLASSES.index("explained") + 1


@dataclass(frozen=True)
class FitError:
    """A smooth random error of a depth image."""

    std_m: float
    grain_px: float
    """Standard deviation of the Gaussian that smooths white noise to it [px]."""

    def draw(self, shape: tuple[int, int], rng: np.random.Generator) -> NDArray[np.float32]:
        """An error (H, W) [m]."""
        if self.std_m == 0:
            return np.zeros(shape, np.float32)
        # Drawn as coarsely as it is smooth.
        step = max(1, int(self.grain_px / 2))
        rows, columns = (n // step + 2 for n in shape)
        coarse = gaussian_filter(rng.standard_normal((rows, columns)), self.grain_px / step, mode="wrap")
        coarse *= self.std_m / max(_gaussian_std(self.grain_px / step, rows, columns), 1e-9)
        rows_at, columns_at = (np.arange(n) / step for n in shape)
        return _bilinear(coarse, rows_at, columns_at)


NO_FIT_ERROR = FitError(0.0, 1.0)


def fit_error(maps: ScoreMaps | None, step_px: int, noise_m: float, grain_px: float) -> FitError:
    """The error behind the residuals of a fitted pose; none where the score is not made of pixels, or few of them are
    explained.

    Args:
        maps: of the pose, at every ``step_px``-th pixel of a window around the object.
        step_px: how far apart they are.
        noise_m: standard deviation of the pixels' noise at the object's distance, of which smoothing leaves a part.
        grain_px: its grain.
    """
    if maps is None:
        return NO_FIT_ERROR
    known = (maps.classes == EXPLAINED) & np.isfinite(maps.depth_difference_m)
    n = int(known.sum())
    if n < FEWEST:
        return NO_FIT_ERROR
    rows, columns = np.flatnonzero(known.any(axis=1)), np.flatnonzero(known.any(axis=0))
    box = np.s_[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    known = known[box]
    side = np.sqrt(n)
    residual_m = np.where(known, maps.depth_difference_m[box], 0.0)
    share = gaussian_filter(known.astype(np.float64), SMOOTHED * side, mode="constant")
    smooth_m = gaussian_filter(residual_m, SMOOTHED * side, mode="constant") / np.maximum(share, 1e-6)
    # Of noise whose neighbours are alike by exp(−(k / 2s)²) a Gaussian of σ leaves the variance s² / (s² + σ²).
    grain = max(grain_px / step_px, WHITE)
    left = noise_m**2 * grain**2 / (grain**2 + (SMOOTHED * side) ** 2)
    return FitError(TAKEN * float(np.sqrt(max(np.mean(smooth_m[known] ** 2) - left, 0.0))), GRAIN * side * step_px)


def _gaussian_std(sigma: float, rows: int, columns: int) -> float:
    """Standard deviation of white noise of variance 1 after a Gaussian that wraps around (rows, columns)."""
    impulse = np.zeros((rows, columns))
    impulse[rows // 2, columns // 2] = 1.0
    return float(np.sqrt((gaussian_filter(impulse, sigma, mode="wrap") ** 2).sum()))


def _bilinear(values: NDArray[np.float64], rows: NDArray, columns: NDArray) -> NDArray[np.float32]:
    """(R, C) values between those of a grid."""
    i, j = rows.astype(np.intp), columns.astype(np.intp)
    a, b = (rows - i)[:, None], (columns - j)[None]
    upper = (1 - b) * values[np.ix_(i, j)] + b * values[np.ix_(i, j + 1)]
    lower = (1 - b) * values[np.ix_(i + 1, j)] + b * values[np.ix_(i + 1, j + 1)]
    return ((1 - a) * upper + a * lower).astype(np.float32)
