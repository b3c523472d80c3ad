"""Colours, scales and names that mean something, as a browser gets them in the message ``hello``."""

from __future__ import annotations

from verefine_viz.core.palette import RGB
from verefine_viz.page.wire import Part

Hex = str
"""A colour as ``#rrggbb``."""
Anchors = tuple[RGB, ...]
"""Evenly spaced colours of a scale, low first."""


class PixelClass(Part, frozen=True):
    """What became of a pixel in the score."""

    name: str
    color: Hex
    words: str


class Palette(Part, frozen=True):
    """Colours by what they mean; ``core/palette.py`` says more of each."""

    stages: dict[str, Hex]
    """Colours of poses, by stage."""
    meanings: dict[str, str]
    """What the stages are, in words."""
    marks: dict[str, Hex]
    """Colours of marks, by tone."""
    classes: tuple[PixelClass, ...]
    """In the order of their numbers, from 1."""
    sides: dict[str, Hex]
    """Two runs that are compared, in pictures."""
    side_lines: dict[str, Hex]
    """These runs in charts."""
    scene: dict[str, Hex]
    axes: tuple[Hex, Hex, Hex]
    """The axes x, y and z of a pose."""
    grasps: dict[str, Hex]
    motions: dict[str, Hex]
    causes: tuple[Hex, ...]
    runs: tuple[Hex, ...]
    times: dict[str, Hex]
    ranks: dict[str, tuple[RGB, RGB]]
    """Hue [°], saturation and lightness [%] of the lowest and the highest hypothesis, by theme."""
    scales: dict[str, Anchors]
    empty: Hex
    """A pixel without a value."""
