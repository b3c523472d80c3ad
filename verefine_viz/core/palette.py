"""Colours that mean something, the same on the page, in maps, recordings and reports."""

from __future__ import annotations

from colorsys import hls_to_rgb
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

STAGE_MEANINGS: dict[str, str] = {
    "initial": "where the hypothesis started",
    "current": "where this iteration started",
    "simulated": "after physics",
    "mixed": "rotation of simulated, translation of current: where the refiner starts",
    "refined": "after the refiner",
    "flipped": "turned to where the shape looks nearly the same",
    "accepted": "the pose that the next iteration of this hypothesis starts from",
    "best": "the best pose of the object so far; the answer of a finished run",
    "runner-up": "the best pose of another hypothesis than the answer's",
    "edited": "the pose that is edited",
    "ground truth": "the true pose",
}

CLASS_COLORS: dict[str, RGB] = {
    "explained": (85, 215, 90),
    "missed": (190, 35, 30),
    "protruding": (200, 50, 225),
    "hidden": (100, 130, 150),
    "unknown": (235, 235, 230),
}
"""Colours of different lightness where red and green look alike."""

CLASS_MEANINGS: dict[str, str] = {
    "explained": "in the mask, rendered and observed agree within τ",
    "missed": "in the mask; the pose leaves it empty, or puts it behind the surface",
    "protruding": "rendered where the sensor saw through, or outside the mask",
    "hidden": "something nearer stands in front",
    "unknown": "rendered, but nothing was measured there",
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

SIDE_LINE_COLORS: dict[str, RGB] = {"A": (0, 190, 205), "B": (159, 196, 0)}
"""These runs in charts, which are on white as well."""

SCENE_COLORS: dict[str, RGB] = {
    "plane": (120, 165, 215),
    "gravity": (250, 205, 60),
    "contacts": (255, 140, 0),
    "overlaps": (255, 30, 30),
    "marked": (255, 210, 60),
    "allowed": (150, 235, 205),
}
"""What pictures and the 3D view show beside poses; ``marked`` is what the user marked, ``allowed`` the poses that the
image cannot tell from an answer."""

AXIS_COLORS: tuple[RGB, RGB, RGB] = ((235, 64, 52), (70, 200, 70), (80, 140, 255))
"""The axes x, y and z of a pose."""

GRASP_COLORS: dict[str, RGB] = {"free": (40, 200, 80), "blocked": (190, 80, 70), "chosen": (255, 210, 60)}
"""Colours of grasps: the approach meets nothing, meets something, is the one that is carried out."""

MARK_COLORS: dict[str, RGB] = {
    "problem": (220, 50, 47),
    "rejected": (255, 140, 0),
    "flip": (235, 60, 200),
    "edited": (190, 90, 220),
    "switched": (50, 110, 255),
    "best": (40, 168, 96),
}
"""Marks on the timeline, by tone (``page/marks.py``)."""

MOTION_COLORS: dict[str, RGB] = {
    "flip": (235, 60, 200),
    "jump": (220, 50, 47),
    "lost": (230, 150, 40),
    "recovered": (70, 160, 220),
}
"""What stands out of an object from one frame of a sequence to the next."""

CAUSE_COLORS: tuple[RGB, ...] = (
    (78, 121, 167),
    (242, 142, 43),
    (225, 87, 89),
    (118, 183, 178),
    (89, 161, 79),
    (237, 201, 72),
    (176, 122, 161),
    (255, 157, 167),
    (156, 117, 95),
    (134, 188, 182),
    (211, 114, 149),
    (160, 203, 232),
)
"""Causes of failure in bar charts, the most frequent first; after the last the first again."""

RUN_COLORS: tuple[RGB, ...] = (
    (59, 142, 234),
    (242, 142, 43),
    (47, 174, 95),
    (216, 80, 77),
    (154, 123, 208),
    (160, 113, 94),
    (227, 119, 194),
    (168, 169, 40),
    (23, 179, 196),
    (15, 157, 120),
    (190, 60, 160),
    (110, 130, 235),
)
"""Runs that a report compares."""

TIME_COLORS: dict[str, RGB] = {
    "read": (141, 153, 174),
    "prepare": (201, 180, 138),
    "compile": (184, 166, 106),
    "start": (87, 117, 144),
    "refine": (50, 110, 255),
    "simulate": (255, 140, 0),
    "score": (40, 200, 80),
    "rest": (152, 163, 181),
    "grasp": (233, 196, 106),
    "explain": (138, 118, 168),
    "summarise": (201, 173, 167),
    "record": (154, 140, 152),
}
"""Where the time of a run went, by stage (``run/answers.py``)."""

RANK_RAMP: dict[str, tuple[tuple[int, int, int], tuple[int, int, int]]] = {
    "light": ((214, 20, 76), (262, 76, 44)),
    "dark": ((216, 18, 36), (262, 95, 78)),
}
"""Hypotheses by rank: hue [°], saturation and lightness [%] of the lowest and of the highest, by theme; from pale slate
to strong violet, hues that no stage, mark or answer has."""

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

VIRIDIS = ((68, 1, 84), (72, 40, 120), (62, 74, 137), (49, 104, 142), (38, 130, 142), (31, 158, 137),
            (53, 183, 121), (109, 205, 89), (180, 222, 44), (253, 231, 37))  # fmt: skip
INFERNO = ((0, 0, 4), (31, 12, 72), (85, 15, 109), (136, 34, 106), (186, 54, 85), (227, 89, 51),
            (249, 140, 10), (249, 201, 50), (252, 255, 164))  # fmt: skip
BLUE_RED = ((33, 102, 172), (103, 169, 207), (209, 229, 240), (250, 250, 250), (253, 219, 199), (239, 138, 98),
            (178, 24, 43))  # fmt: skip
MAGENTA_GREEN = ((197, 27, 125), (233, 163, 201), (253, 224, 239), (247, 247, 247), (230, 245, 208), (161, 215, 106),
                 (77, 146, 33))  # fmt: skip
"""A gain of one pose over another: green = the second fits better."""


def stage_color(name: str) -> RGB:
    """The colour of a stage; of one that has none its own, that of "current"."""
    return STAGE_COLORS.get(name, STAGE_COLORS["current"])


def rank_colors(shares: NDArray[np.floating]) -> NDArray[np.uint8]:
    """RGB (n, 3) of hypotheses by rank (n,) in [0, 1], 1 = the highest, on dark ground."""
    low, high = (np.array(end, float) / (360, 100, 100) for end in RANK_RAMP["dark"])
    hsl = low + np.asarray(shares, float)[:, None] * (high - low)
    rgb_shares = [hls_to_rgb(hue, lightness, saturation) for hue, saturation, lightness in hsl]
    return np.rint(255 * np.array(rgb_shares).reshape(-1, 3)).astype(np.uint8)


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
    return Scale(low_m, high_m, "m", VIRIDIS)


def difference_scale(tau_m: float) -> Scale:
    """Observed − rendered depth over ±2τ [mm]: red = the sensor saw past the model, blue = something is before it."""
    return Scale(-2000.0 * tau_m, 2000.0 * tau_m, "mm", BLUE_RED)


ANGLE = Scale(0.0, 90.0, "°", INFERNO)
FIT = Scale(0.0, 1.0, "", VIRIDIS)


CORRELATION = Scale(-2.0, 2.0, "", tuple(reversed(BLUE_RED)))
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
