"""Colours, scales and names that mean something, as a browser gets them once: in the message ``hello``."""

from __future__ import annotations

from collections.abc import Mapping

from verefine_viz import __version__
from verefine_viz.core import palette as colours
from verefine_viz.core.accuracy import CORRECT
from verefine_viz.page.messages import HelloMessage
from verefine_viz.page.palette_message import Hex, Palette, PixelClass


def hello(window: int) -> HelloMessage:
    """Return the first message: which window a browser is, which version answers it, and what colours mean."""
    return HelloMessage(window, __version__, sent_palette(), CORRECT)


def hex_color(color: colours.RGB) -> Hex:
    """Write a colour as ``#rrggbb``."""
    return "#{:02x}{:02x}{:02x}".format(*color)


def sent_palette() -> Palette:
    """Return the palette as it is sent."""
    return Palette(
        stages=_hex(colours.STAGE_COLORS),
        meanings=colours.STAGE_MEANINGS,
        marks=_hex(colours.MARK_COLORS),
        classes=tuple(
            PixelClass(name, hex_color(color), colours.CLASS_MEANINGS[name])
            for name, color in colours.CLASS_COLORS.items()
        ),
        sides=_hex(colours.SIDE_COLORS),
        side_lines=_hex(colours.SIDE_LINE_COLORS),
        scene=_hex(colours.SCENE_COLORS),
        axes=(hex_color(colours.AXIS_COLORS[0]), hex_color(colours.AXIS_COLORS[1]), hex_color(colours.AXIS_COLORS[2])),
        grasps=_hex(colours.GRASP_COLORS),
        motions=_hex(colours.MOTION_COLORS),
        causes=tuple(map(hex_color, colours.CAUSE_COLORS)),
        runs=tuple(map(hex_color, colours.RUN_COLORS)),
        times=_hex(colours.TIME_COLORS),
        ranks=colours.RANK_RAMP,
        scales={
            "viridis": colours.VIRIDIS,
            "inferno": colours.INFERNO,
            "blue_red": colours.BLUE_RED,
            "magenta_green": colours.MAGENTA_GREEN,
        },
        empty=hex_color(colours.EMPTY),
    )


def _hex(colors: Mapping[str, colours.RGB]) -> dict[str, Hex]:
    return {name: hex_color(color) for name, color in colors.items()}
