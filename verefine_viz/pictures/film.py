"""A film of a run: its key moments as pictures, photo beside map, and all of them as a strip or an animation."""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from textwrap import wrap

import numpy as np
from PIL import Image as PilImage
from PIL import ImageDraw, ImageFont

from verefine_viz.core.arrays import Float
from verefine_viz.core.moment import LAYER_COLORS, Moment
from verefine_viz.core.palette import (
    AXIS_COLORS,
    CLASS_COLORS,
    RGB,
    Image,
    depth_scale,
    difference_scale,
    stage_color,
)
from verefine_viz.core.problem import Target
from verefine_viz.core.scores import ScoreMaps
from verefine_viz.pictures.answer_pictures import ShownPart, camera_image, webp, window_around, with_outlines
from verefine_viz.pictures.contours import draw_contours
from verefine_viz.pictures.map_images import MapImages, scales_of
from verefine_viz.pictures.support_patch import support_patch

SIDE_PX = 240
"""Side of the photo, and of the map beside it."""
GAP_PX = 2
COLUMNS = 3
STILL_MS, LAST_MS = 1800, 3500
"""Durations of a moment in an animation, and of the last one."""
TINTED = 0.6
DIFFERENCE_WORDS = ("seen past the model", "something before it")
INK, DIM, PAPER = (235, 236, 240), (165, 170, 180), (24, 26, 30)
MARGIN, HEAD, LINE, FOOT = 10, 26, 20, 26

MapsOf = Callable[[Moment, Float], ScoreMaps | None]
"""Score maps at a pose (4, 4) by the settings of a moment; None where the score is not made of pixels."""


@dataclass(frozen=True, eq=False)
class Film:
    """The pictures of an object's key moments.

    Args:
        target: the object.
        moments: what to draw.
        maps_of: gives score maps.
        tau_m: depth tolerance of the score [m].
    """

    target: Target
    moments: Sequence[Moment]
    maps_of: MapsOf
    tau_m: float

    @cached_property
    def pictures(self) -> list[Image]:
        """(SIDE_PX, 2 SIDE_PX + GAP_PX, 3) each: the photo with contours, the map."""
        return [self._picture(moment) for moment in self.moments]

    @cached_property
    def _window(self) -> ShownPart:
        """One part of the image for all moments, for comparison: around the poses shown, not around all initial
        poses.
        """
        return window_around(self.target, [moment.poses[0][1] for moment in self.moments], 1.0)

    @cached_property
    def _wide(self) -> ShownPart:
        """The largest square of the image, for a support plane."""
        camera, near = self.target.observation.camera, self._window
        side, middle = min(camera.width, camera.height), (near.u0 + near.width / 2, near.v0 + near.height / 2)
        limits = (camera.width - side, camera.height - side)
        u0, v0 = (min(max(at - side / 2, 0.0), limit) for at, limit in zip(middle, limits, strict=True))
        return ShownPart(u0, v0, side, side)

    def _picture(self, moment: Moment) -> Image:
        window = self._wide if moment.layer == "plane" else self._window
        photo = _part(camera_image(self.target.observation), window, PilImage.Resampling.BICUBIC)
        shown = [(T, stage_color(role)) for role, T in reversed(moment.poses)]
        drawn = [with_outlines(self._with_layer(photo, moment, window), self.target, window, shown)]
        if moment.layer == "axes":
            drawn = [self._with_axes(drawn[0], moment.poses[0][1])]
        maps = self.maps_of(moment, moment.poses[0][1])
        if maps is not None:
            gap = np.full((SIDE_PX, GAP_PX, 3), PAPER, np.uint8)
            drawn += [gap, _part(self._images(maps).rgb(moment.map), window)]
        return np.concatenate(drawn, axis=1)

    def _with_layer(self, photo: Image, moment: Moment, window: ShownPart) -> Image:
        """The photo with the mask's contour, or with the pixels tinted that lie on the support plane."""
        if moment.layer == "mask":
            mask = _part(self.target.instance.mask.astype(np.uint8), window) > 0
            return draw_contours(photo, mask, LAYER_COLORS["mask"][1])
        patch = support_patch(self.target.observation) if moment.layer == "plane" else None
        if patch is None:
            return photo
        tint = TINTED * _part(patch.inliers.astype(np.uint8), window)[..., None]
        return ((1 - tint) * photo + tint * np.array(LAYER_COLORS["plane"][1])).astype(np.uint8)

    def _with_axes(self, photo: Image, T_cam_obj: Float) -> Image:
        """A picture with the axes of a pose: a turn that no outline shows."""
        camera, length_m = (
            self._window.camera(self.target.observation.camera, SIDE_PX),
            self.target.model.diameter_m / 2,
        )
        ends = np.append(
            self.target.model.middle_m + length_m * np.vstack([np.zeros(3), np.eye(3)]), np.ones((4, 1)), 1
        )
        from_px, *ends_px = (tuple(pixel) for pixel in camera.project((ends @ T_cam_obj.T)[:, :3]).tolist())
        image = PilImage.fromarray(photo)
        for end_px, color in zip(ends_px, AXIS_COLORS, strict=True):
            ImageDraw.Draw(image).line([from_px, end_px], PAPER, 5)
            ImageDraw.Draw(image).line([from_px, end_px], color, 3)
        return np.array(image)

    def _images(self, maps: ScoreMaps) -> MapImages:
        observation = self.target.observation
        depth_m = observation.depth_m
        known = depth_m[self.target.instance.mask & (depth_m > 0)]
        middle, half = float(np.median(known)) if len(known) else 1.0, self.target.model.diameter_m / 2
        return MapImages(maps, depth_m, scales_of(depth_scale(middle - half, middle + half), self.tau_m))

    # All of them

    def panels(self) -> list[PilImage.Image]:
        """Every moment with its title, the legend of its colours, and its caption."""
        return [_panel(moment, picture) for moment, picture in zip(self.moments, self.pictures, strict=True)]

    def strip(self, title: str) -> PilImage.Image:
        """All moments in rows of three, or two rows of two, between a title and the legend of the maps' colours."""
        panels = self.panels()
        columns = columns_of(len(panels))
        rows = -(-len(panels) // columns)
        width, height = panels[0].width + MARGIN, panels[0].height + MARGIN
        sheet = PilImage.new("RGB", (columns * width + MARGIN, HEAD + MARGIN + rows * height + FOOT), PAPER)
        draw = ImageDraw.Draw(sheet)
        draw.text((MARGIN, MARGIN), title, INK, font=_font(17))
        for k, panel in enumerate(panels):
            sheet.paste(panel, (MARGIN + (k % columns) * width, HEAD + MARGIN + (k // columns) * height))
        colors = dict(CLASS_COLORS) | dict(zip(DIFFERENCE_WORDS, _ends(self.tau_m), strict=True))
        _chips(draw, MARGIN, sheet.height - FOOT, colors, sheet.width)
        return sheet

    def save(self, out: io.BytesIO, title: str, animated: bool) -> None:
        """Write the strip as PNG, or an animation (GIF) of a moment at a time."""
        if not animated:
            return self.strip(title).save(out, "PNG", optimize=True)
        first, *others = [panel.quantize(200, dither=PilImage.Dither.NONE) for panel in self.panels()]
        times = [STILL_MS] * len(others) + [LAST_MS]
        first.save(out, "GIF", save_all=True, append_images=others, duration=times, loop=0)
        return None


def columns_of(n_moments: int) -> int:
    """Number of moments in a row."""
    return 2 if n_moments == 4 else COLUMNS


def film_pictures(target: Target, moments: Sequence[Moment], maps_of: MapsOf, tau_m: float) -> list[bytes]:
    """The pictures of moments as WebP, 4 to 10 kB each."""
    return [webp(picture) for picture in Film(target, moments, maps_of, tau_m).pictures]


def _part(whole: Image, window: ShownPart, how: PilImage.Resampling = PilImage.Resampling.NEAREST) -> Image:
    """The part of an image (H, W) or (H, W, 3) that is shown, as large as a picture."""
    return np.array(PilImage.fromarray(whole).resize((SIDE_PX, SIDE_PX), how, window.box))


def _panel(moment: Moment, picture: Image) -> PilImage.Image:
    width = picture.shape[1]
    lines = wrap(moment.caption, max(width // 8, 20))[:2]
    panel = PilImage.new("RGB", (width, HEAD + SIDE_PX + 2 * LINE + 6), PAPER)
    draw = ImageDraw.Draw(panel)
    draw.text((0, 4), moment.title, INK, font=_font(15))
    _chips(draw, draw.textlength(moment.title, font=_font(15)) + 14, 4, moment.legend, width)
    panel.paste(PilImage.fromarray(picture), (0, HEAD))
    for k, line in enumerate(lines):
        draw.text((0, HEAD + SIDE_PX + 4 + k * LINE), line, INK, font=_font(16))
    return panel


def _chips(draw: ImageDraw.ImageDraw, x: float, y: float, colors: dict[str, RGB], right: float) -> None:
    """Names with their colours in a row, as many as fit."""
    for name, color in colors.items():
        end = x + 16 + draw.textlength(name, font=_font(14))
        if end > right:
            return
        draw.rectangle((x, y + 4, x + 10, y + 14), fill=color)
        draw.text((x + 15, y), name, DIM, font=_font(14))
        x = end + 12


def _ends(tau_m: float) -> tuple[RGB, RGB]:
    low, *_, high = difference_scale(tau_m).anchors
    return high, low


def _font(size: int) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    return ImageFont.load_default(size)
