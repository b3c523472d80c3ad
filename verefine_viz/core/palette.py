"""Colours that mean something, the same on the page, in maps, recordings and reports."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.scores import PIXEL_CLASSES

RGB = tuple[int, int, int]

STAGE_COLORS: dict[str, RGB] = {
    "initial": (120, 120, 120),
    "current": (160, 160, 160),
    "simulated": (255, 140, 0),
    "mixed": (240, 210, 40),
    "refined": (50, 110, 255),
    "flipped": (235, 60, 200),
    "accepted": (40, 200, 80),
    "best": (0, 170, 120),
    "runner-up": (255, 105, 180),
    "edited": (190, 90, 220),
    "ground truth": (255, 255, 255),
}

CLASS_COLORS: dict[str, RGB] = {
    "explained": (60, 180, 75),
    "missed": (220, 50, 47),
    "protruding": (211, 54, 180),
    "hidden": (96, 125, 139),
    "unknown": (200, 200, 200),
}

ARM_COLORS: tuple[RGB, ...] = (
    (140, 140, 240),
    (205, 165, 110),
    (165, 70, 110),
    (120, 212, 228),
    (140, 130, 35),
    (238, 150, 165),
    (70, 95, 170),
    (190, 215, 140),
    (130, 82, 55),
    (60, 140, 150),
)
"""Arm j is drawn in ``ARM_COLORS[j % 10]``: softer than the colours that mean something, and distinct without red and
green."""

OBJECT_COLORS: tuple[RGB, ...] = (
    (102, 194, 255),
    (255, 179, 90),
    (186, 150, 255),
    (140, 214, 120),
    (255, 140, 170),
    (245, 224, 110),
    (70, 214, 205),
    (214, 160, 120),
    (240, 140, 240),
    (170, 190, 215),
)
"""The k-th instance of a frame, in the order of ``Problem.instances``, is drawn in ``OBJECT_COLORS[k % 10]``."""

SIDE_COLORS: dict[str, RGB] = {"A": (0, 190, 205), "B": (205, 255, 70)}
"""Two runs that are compared: A is drawn solid, B as an outline and dashed."""

GRASP_COLORS: dict[str, RGB] = {"free": (40, 200, 80), "blocked": (190, 80, 70), "chosen": (255, 210, 60)}
"""Colours of grasps: the approach meets nothing, meets something, is the one that is carried out."""
EVENT_COLORS: dict[str, RGB] = {
    "kept_simulated": (255, 140, 0),
    "kept_refined": (50, 110, 255),
    "flipped": (235, 60, 200),
    "score_fell": (220, 50, 47),
    "new_best": (40, 200, 80),
    "arm_switched": (50, 110, 255),
    "unstable": (220, 50, 47),
    "physics_worse": (220, 50, 47),
    "empty_render": (220, 50, 47),
    "nan_score": (220, 50, 47),
    "refiner_stuck": (220, 50, 47),
    "no_physics": (160, 160, 160),
    "edited": (190, 90, 220),
    "new_best_scene": (240, 200, 60),
}


# Colour scales of the score maps: fixed, so that the same colour means the same number in every iteration.

Image = NDArray[np.uint8]
EMPTY: RGB = (38, 40, 44)
"""Pixels without a value."""

_VIRIDIS = ((68, 1, 84), (72, 40, 120), (62, 74, 137), (49, 104, 142), (38, 130, 142), (31, 158, 137),
            (53, 183, 121), (109, 205, 89), (180, 222, 44), (253, 231, 37))  # fmt: skip
_INFERNO = ((0, 0, 4), (31, 12, 72), (85, 15, 109), (136, 34, 106), (186, 54, 85), (227, 89, 51),
            (249, 140, 10), (249, 201, 50), (252, 255, 164))  # fmt: skip
_BLUE_RED = ((33, 102, 172), (103, 169, 207), (209, 229, 240), (250, 250, 250), (253, 219, 199), (239, 138, 98),
             (178, 24, 43))  # fmt: skip


@dataclass(frozen=True)
class Scale:
    """Numbers to colours, linear from ``low`` to ``high``; what lies beyond takes the end's colour."""

    low: float
    high: float
    unit: str
    anchors: tuple[RGB, ...]
    """Evenly spaced colours."""

    def shades(self, values: NDArray[np.floating]) -> NDArray[np.uint8]:
        """Palette indices (…) of values (…); NaN and infinity are 0."""
        known = np.isfinite(values)
        share = 254 * (np.where(known, values, self.low) - self.low) / (self.high - self.low)
        return np.where(known, 1 + np.clip(np.rint(share), 0, 254), 0).astype(np.uint8)

    def colors(self, values: NDArray[np.floating]) -> Image:
        """RGB (…, 3) of values (…); NaN becomes :data:`EMPTY`."""
        return rgb(self.shades(values), self.palette)

    @property
    def palette(self) -> bytes:
        """768 bytes RGB: :data:`EMPTY`, then 255 colours from ``low`` to ``high``."""
        return _palette(self.anchors)

    def gradient(self) -> str:
        """The colour bar as a CSS gradient, low on the left."""
        return f"linear-gradient(to right, {', '.join(f'rgb{c}' for c in self.anchors)})"

    @property
    def ticks(self) -> tuple[str, str, str]:
        """Labels at the left, middle and right of the bar."""
        middle = (self.low + self.high) / 2
        return f"{self.low:g}", f"{middle:g}", f"{self.high:g} {self.unit}".strip()


@cache
def _palette(anchors: tuple[RGB, ...]) -> bytes:
    return bytes(EMPTY) + lookup_table(anchors)[np.linspace(0, 255, 255).round().astype(int)].tobytes()


@cache
def lookup_table(anchors: tuple[RGB, ...]) -> Image:
    """(256, 3) colours between evenly spaced anchors."""
    at = np.linspace(0, 255, len(anchors))
    table = [np.interp(np.arange(256), at, [c[k] for c in anchors]) for k in range(3)]
    return np.round(np.stack(table, axis=-1)).astype(np.uint8)


def depth_scale(low_m: float, high_m: float) -> Scale:
    """Depth of one object's neighbourhood [m]."""
    return Scale(low_m, high_m, "m", _VIRIDIS)


def difference_scale(tau_m: float) -> Scale:
    """Observed − rendered depth over ±2τ [mm]: red = the sensor saw past the model, blue = something is before it."""
    return Scale(-2000.0 * tau_m, 2000.0 * tau_m, "mm", _BLUE_RED)


ANGLE = Scale(0.0, 90.0, "°", _INFERNO)
FIT = Scale(0.0, 1.0, "", _VIRIDIS)


CORRELATION = Scale(-2.0, 2.0, "", tuple(reversed(_BLUE_RED)))
"""What a pixel adds to f_c, times their number: blue = rendered and observed colour differ alike from their means."""

_CUBE = (6, 7, 6)
"""Steps of red, green and blue in a palette of colours."""
CUBE_PALETTE = (
    bytes(EMPTY) + np.rint(255 * np.indices(_CUBE).reshape(3, -1).T / (np.array(_CUBE) - 1)).astype(np.uint8).tobytes()
).ljust(768, b"\0")
"""768 bytes RGB: :data:`EMPTY`, then 252 colours."""


def cube_indices(image: Image) -> NDArray[np.uint8]:
    """Indices (…) into :data:`CUBE_PALETTE` of the colours nearest to RGB (…, 3)."""
    steps = np.rint(image / 255.0 * (np.array(_CUBE) - 1)).astype(np.intp)
    red, green, blue = np.moveaxis(steps, -1, 0)
    return (1 + (red * _CUBE[1] + green) * _CUBE[2] + blue).astype(np.uint8)


CLASS_PALETTE = (bytes(EMPTY) + b"".join(bytes(CLASS_COLORS[name]) for name in PIXEL_CLASSES)).ljust(768, b"\0")
"""768 bytes RGB of a pixel-class map: 0 = none, 1 + index into ``PIXEL_CLASSES``."""


def class_image(classes: NDArray[np.uint8]) -> Image:
    """RGB (…, 3) of a pixel-class map (…)."""
    return rgb(classes, CLASS_PALETTE)


def rgb(indices: NDArray[np.uint8], palette: bytes) -> Image:
    """RGB (…, 3) of indices (…) into a palette."""
    return np.frombuffer(palette, np.uint8).reshape(256, 3)[indices]
