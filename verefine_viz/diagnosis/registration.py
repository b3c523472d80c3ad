"""Does the depth image lie on the colour image, and in the right unit? Told by objects whose true pose is known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

TAU_M = 0.020
"""Depths that differ by more than this do not agree at all [m]."""
REACH_PX = 40
"""Largest shift that is looked for [px]."""
PIXELS = 3000
"""Pixels of the objects that are compared."""
MEASURED = 0.3
"""With less of the objects' pixels measured, nothing is said."""
GAIN = 0.06
"""Depth is off only if putting it right raises the agreement by more than this …"""
AGREES = 0.5
"""… to more than this."""
SURELY = 0.7
"""A change of scale has to lead to more agreement than this: something flat in front could pass for it."""
SHIFT_PX = 3
"""Less shift than this is noise of poses and edges [px]."""
SCALE = 0.015
"""Less change of scale than this is noise of the sensor."""


@dataclass(frozen=True)
class Registration:
    """How the observed depth has to be changed to lie on the true one."""

    shift_px: tuple[int, int]
    """(right, down): where the depth of a pixel is found, relative to it [px]."""
    scale: float
    """Observed z over true z."""
    agreement: float
    """Mean of max(0, 1 − |Δz| / 20 mm) over the measured pixels of the objects, as it is …"""
    best_agreement: float
    """… and after shift and scale are undone."""

    @property
    def is_off(self) -> bool:
        """Whether the depth is shifted or scaled."""
        changed = max(map(abs, self.shift_px)) >= SHIFT_PX or abs(self.scale - 1) >= SCALE
        return changed and self.best_agreement > AGREES and self.best_agreement - self.agreement > GAIN

    def undone(self, depth_m: NDArray[np.float32]) -> NDArray[np.float32]:
        """The depth image (H, W) [m] put right; 0 where that leaves a pixel without any."""
        h, w = depth_m.shape
        right, down = self.shift_px
        padded = np.pad(depth_m, max(abs(right), abs(down)))
        pad = (padded.shape[0] - h) // 2
        moved = padded[pad + down : pad + down + h, pad + right : pad + right + w]
        return (moved / np.float32(self.scale)).astype(np.float32)


def registration(observed_m: NDArray[np.floating], true_m: NDArray[np.floating]) -> Registration:
    """Shift and scale that bring an observed depth image (H, W) [m] onto the true depth of the objects in it.

    Args:
        observed_m: 0 where nothing was measured.
        true_m: 0 where there is no object whose pose is known.
    """
    v, u = np.nonzero(true_m > 0)
    if len(v) == 0:
        return Registration((0, 0), 1.0, 1.0, 1.0)
    step = 1 + len(v) // PIXELS
    v, u = v[::step], u[::step]
    padded = np.pad(np.asarray(observed_m, dtype=np.float64), REACH_PX)
    true = np.asarray(true_m, dtype=np.float64)[v, u]
    z = padded[v + REACH_PX, u + REACH_PX]
    as_it_is = _agreement(z, true)
    if np.count_nonzero(z) < MEASURED * len(v):
        return Registration((0, 0), 1.0, as_it_is, as_it_is)
    scale = float(np.median(z[z > 0] / true[z > 0]))
    scaled = _agreement(z / scale, true)
    if scaled > SURELY and abs(scale - 1) >= SCALE:
        return Registration((0, 0), scale, as_it_is, scaled)

    # Where something stands in front, a shift could only seem to help.
    free = ~((z > 0) & (z < true - TAU_M))
    if np.count_nonzero(free) < MEASURED * len(v):
        return Registration((0, 0), 1.0, as_it_is, as_it_is)
    v, u, true = v[free], u[free], true[free]

    def agreement(right: int, down: int) -> float:
        return _agreement(padded[v + down + REACH_PX, u + right + REACH_PX], true)

    before = agreement(0, 0)
    shift, best = (0, 0), before
    coarse = [(x, y) for x in range(-36, 37, 4) for y in range(-36, 37, 4)]
    for x, y in sorted(coarse, key=lambda s: s[0] ** 2 + s[1] ** 2):
        if (found := agreement(x, y)) > best + 1e-9:
            shift, best = (x, y), found
    x0, y0 = shift
    for x, y in ((x0 + i, y0 + j) for i in range(-3, 4) for j in range(-3, 4)):
        if (found := agreement(x, y)) > best + 1e-9:
            shift, best = (x, y), found
    return Registration(shift, 1.0, before, best)


def _agreement(z: NDArray[np.float64], true: NDArray[np.float64]) -> float:
    """Mean fit of observed to true depths (n,) [m] over those that were measured."""
    fit = np.clip(1 - np.abs(z - true) / TAU_M, 0, None)
    return float(fit[z > 0].sum() / max(np.count_nonzero(z), MEASURED * len(z), 1))
