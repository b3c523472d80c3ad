"""Score maps as images of indices into fixed colours, for the page and for recordings.

They choose which part of the image is drawn: the page cuts whole maps, a recording asks for the pixels of small tiles.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.kernels import kernel
from verefine_viz.core.palette import (
    ANGLE,
    CLASS_PALETTE,
    CORRELATION,
    CUBE_PALETTE,
    FIT,
    Image,
    Scale,
    cube_indices,
    difference_scale,
    rgb,
)
from verefine_viz.core.scores import COLOUR_MAPS, MapName, ScoreMaps


def scales_of(depth: Scale, tau_m: float) -> dict[MapName, Scale]:
    """The scale of each map but those of classes and colours.

    Args:
        depth: scale of observed and rendered depth, which depends on the frame.
        tau_m: depth tolerance of the score [m].
    """
    return {
        "observed": depth,
        "rendered": depth,
        "difference": difference_scale(tau_m),
        "angle": ANGLE,
        "f_d": FIT,
        "f_n": FIT,
        "correlation": CORRELATION,
    }


def _palette_of(name: MapName, scales: Mapping[MapName, Scale]) -> bytes:
    """768 bytes RGB, the colour of index 0 (no value) first."""
    if name in ("observed_colour", "rendered_colour"):
        return CUBE_PALETTE
    return CLASS_PALETTE if name == "classes" else scales[name].palette


@dataclass(frozen=True, eq=False)
class MapImages:
    """The maps of one pose, (H, W) each."""

    maps: ScoreMaps
    observed_m: NDArray[np.float32]
    """Measured depth at the same pixels [m]; 0 = none."""
    scales: Mapping[MapName, Scale]
    """Made by :func:`scales_of`."""

    def indices(self, name: MapName) -> NDArray[np.uint8]:
        """(H, W) indices into :func:`_palette_of`: 0 = no value, 1 … 255 from the scale's low to its high end."""
        maps = self.maps
        if name == "classes":
            return maps.classes
        if name in COLOUR_MAPS:
            return self._colour_indices(name)
        scale = self.scales[name]
        if name in ("observed", "rendered"):
            return depth_indices(self.observed_m if name == "observed" else maps.rendered_m, scale)
        if name == "difference":
            return scaled_indices(maps.depth_difference_m, 1e3, scale.low, scale.high)
        if name == "angle":
            return scaled_indices(maps.angle_rad, math.degrees(1), scale.low, scale.high)
        fit = np.where(maps.counted, maps.f_d if name == "f_d" else maps.f_n, np.nan)
        return scaled_indices(fit, 1.0, scale.low, scale.high)

    def _colour_indices(self, name: MapName) -> NDArray[np.uint8]:
        maps, nothing = self.maps, np.zeros(self.maps.classes.shape, np.uint8)
        if maps.observed_rgb is None or maps.rendered_rgb is None or maps.correlation is None:
            return nothing
        if name == "correlation":
            return scaled_indices(maps.correlation, 1.0, CORRELATION.low, CORRELATION.high)
        if name == "observed_colour":
            return cube_indices(maps.observed_rgb)
        return np.where(maps.rendered_m > 0, cube_indices(maps.rendered_rgb), nothing)

    def rgb(self, name: MapName) -> Image:
        """(H, W, 3) colours."""
        return rgb(self.indices(name), _palette_of(name, self.scales))


def depth_indices(depth_m: NDArray[np.float32], scale: Scale) -> NDArray[np.uint8]:
    """(H, W) indices into the scale's palette of a depth image, in which 0 m is no value."""
    return scaled_indices(np.where(depth_m > 0, depth_m, np.nan), 1.0, scale.low, scale.high)


@kernel()
def scaled_indices(values: NDArray[np.float32], factor: float, low: float, high: float) -> NDArray[np.uint8]:
    """As ``Scale.shades`` of ``factor * values`` (H, W), in a tenth of the time."""
    out = np.zeros(values.shape, np.uint8)
    for y in range(values.shape[0]):
        for x in range(values.shape[1]):
            value = factor * np.float64(values[y, x])
            if np.isfinite(value):
                out[y, x] = 1 + np.uint8(min(max(np.rint(254 * (value - low) / (high - low)), 0.0), 254.0))
    return out
