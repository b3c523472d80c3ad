"""All score maps of both stages as one picture, with names and colour bars, to be kept."""

from __future__ import annotations

import numpy as np
from PIL import Image as PilImage
from PIL import ImageDraw, ImageFont

from verefine_viz.core.colormaps import Image
from verefine_viz.core.palette import CLASS_COLORS
from verefine_viz.viewer.maps import LABELS, MAP_NAMES, MapName, map_image, scale_of
from verefine_viz.viewer.panels.maps import shared_crop
from verefine_viz.viewer.scene_words import method_name
from verefine_viz.viewer.view import View

_TILE_W, _TILE_H, _LEFT, _TITLE, _HEAD, _BAR, _GAP = 240, 192, 150, 30, 34, 46, 8
_TOP = _TITLE + _HEAD


def maps_sheet(view: View) -> Image:
    """(H, W, 3) RGB: what it is of, then a row per stage, a column per map, cut to the object."""
    sides = [s for s in (view.a, view.b) if s is not None and s.maps is not None]
    width = _LEFT + len(MAP_NAMES) * (_TILE_W + _GAP)
    height = _TOP + max(len(sides), 1) * (_TILE_H + _GAP) + _BAR
    sheet = PilImage.new("RGB", (width, height), (250, 250, 250))
    draw, font = ImageDraw.Draw(sheet), ImageFont.load_default(15)
    draw.text((8, 8), sheet_title(view), (20, 20, 20), font=font)
    crop, tau_m = shared_crop(view), view.session.score.tau_m
    for row, side in enumerate(sides):
        assert side.maps is not None
        top = _TOP + row * (_TILE_H + _GAP)
        score = f"\nscore {side.pose.score.score:.3f}" if side.pose.score else ""
        draw.text((8, top + 8), f"{side.pose.label}{score}", (20, 20, 20), font=font)
        for column, name in enumerate(MAP_NAMES):
            image = PilImage.fromarray(map_image(name, side.maps, view.map_target, tau_m, crop))
            tile = image.resize((_TILE_W, _TILE_H), PilImage.Resampling.NEAREST)
            sheet.paste(tile, (_LEFT + column * (_TILE_W + _GAP), top))
    if not sides:
        draw.text((8, _TOP + 8), "no pose to show here", (20, 20, 20), font=font)
    bottom = height - _BAR
    for column, name in enumerate(MAP_NAMES):
        left = _LEFT + column * (_TILE_W + _GAP)
        draw.text((left, _TITLE + 8), _heading(name), (20, 20, 20), font=font)
        scale = scale_of(name, view.map_target, tau_m)
        if scale is None:
            _legend(draw, left, bottom)
            continue
        ramp = np.linspace(scale.low, scale.high, _TILE_W)
        bar = np.repeat(scale.colors(ramp)[None], 10, axis=0)
        sheet.paste(PilImage.fromarray(bar), (left, bottom))
        draw.text((left, bottom + 14), scale.ticks[0], (20, 20, 20), font=font)
        draw.text((left + _TILE_W, bottom + 14), scale.ticks[2], (20, 20, 20), font=font, anchor="ra")
    return np.asarray(sheet)


def sheet_title(view: View) -> str:
    """Of which object, frame and moment of a run the maps are."""
    whose = "all objects" if view.is_whole_scene else view.scene.object(view.target.instance.instance_id).label
    when = f"answer after {view.cursor} iterations" if view.is_answer else f"iteration {view.cursor}"
    return f"{whose}, frame {view.frame}, {method_name(view.session.method.name)}, {when}"


def _heading(name: MapName) -> str:
    """A map's label in letters that the picture's typeface has."""
    return LABELS[name][0].replace("Δ", "delta ")


def _legend(draw: ImageDraw.ImageDraw, left: int, top: int) -> None:
    font = ImageFont.load_default(11)
    for k, (name, color) in enumerate(CLASS_COLORS.items()):
        x, y = left + (k % 3) * 80, top + (k // 3) * 16
        draw.rectangle((x, y + 2, x + 9, y + 11), fill=color)
        draw.text((x + 13, y), name, (20, 20, 20), font=font)
