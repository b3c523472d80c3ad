"""The strip of score maps: both stages, every quantity, cut to the object, with colour bars."""

from __future__ import annotations

import json

import numpy as np
import viser

from verefine_viz.core.colormaps import rgb
from verefine_viz.core.palette import CLASS_COLORS, STAGE_COLORS
from verefine_viz.rendering.png import indexed_png
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.long_names import cut
from verefine_viz.viewer.maps import LABELS, MAP_NAMES, Crop, MapName, crop_around, data_uri, map_shades, png, scale_of
from verefine_viz.viewer.markup import carries, swatch, text
from verefine_viz.viewer.pair_words import score_digits
from verefine_viz.viewer.score_tables import CLASS_MEANING
from verefine_viz.viewer.view import Side, View
from verefine_viz.viewer.widgets import Block, Send

ASPECT = 0.95


class MapsPanel:
    """Two rows of pictures."""

    def __init__(self, gui: viser.GuiApi, send: Send) -> None:
        self._strip = Block(gui, "strip")

    def show(self, view: View) -> None:
        """New pictures; the old ones stay until they are known."""
        if view.deep:
            self._strip.show(maps_html(view))


def maps_html(view: View) -> str:
    """The strip as HTML with the pictures inside."""
    sides = [s for s in (view.a, view.b) if s is not None and s.maps is not None]
    if not sides:
        missing = view.look.a if view.a is None else view.look.b
        return f'<p class="dim">No {text(missing)} pose here yet: press Step (N), or choose other stages in Score.</p>'
    crop = shared_crop(view)
    o = view.scene.object(view.target.instance.instance_id)
    several = len(view.scene.objects) > 1 and not view.is_whole_scene
    whose = swatch(o.color) + cut(o.label, 52) if several else ""
    head = "".join(f'<th title="{text(LABELS[m][1])}">{text(LABELS[m][0])}</th>' for m in MAP_NAMES)
    rows = "".join(_row(view, side, crop, letter) for side, letter in zip(sides, "AB", strict=False))
    bars = "".join(f"<td>{_bar(view, m)}</td>" for m in MAP_NAMES)
    return f'<table><tr><th class="whose">{whose}</th>{head}</tr>{rows}<tr><td></td>{bars}</tr></table>'


def shared_crop(view: View) -> Crop:
    """The part of the image that holds the mask and both renderings."""
    relevant = view.map_target.instance.mask.copy()
    for side in (view.a, view.b):
        if side is not None and side.maps is not None:
            relevant |= side.maps.rendered_m > 0
    return crop_around(relevant, ASPECT)


def _row(view: View, side: Side, crop: Crop, letter: str) -> str:
    assert side.maps is not None
    digits = score_digits([s.pose.score for s in (view.a, view.b) if s is not None])
    score = f"{side.pose.score.score:.{digits}f}" if side.pose.score else ""
    color = STAGE_COLORS.get(side.pose.name, STAGE_COLORS["current"])
    name = f"{swatch(color)}<b>{letter}</b> {text(side.pose.label)}<br>{score}"
    cells = [f"<td>{_picture(view, side, m, crop)}</td>" for m in MAP_NAMES]
    return f"<tr><td>{name}</td>{''.join(cells)}</tr>"


def _picture(view: View, side: Side, name: MapName, crop: Crop) -> str:
    assert side.maps is not None
    shades, palette = map_shades(name, side.maps, view.map_target, view.session.score.tau_m, crop)
    if view.look.pixel is None:
        picture = indexed_png(shades, palette)
    else:
        picture = png(_with_cross(rgb(shades, palette), view.look.pixel[0] - crop.u0, view.look.pixel[1] - crop.v0))
    area = json.dumps([crop.u0, crop.v0, crop.width, crop.height])
    return (
        f'<img src="{data_uri(picture)}" {carries(c.ProbePixel(0, 0))} data-crop="{area}" '
        f'alt="{text(LABELS[name][0])} of {text(side.pose.label)}" title="click for the numbers of a pixel">'
    )


def _with_cross(image: np.ndarray, u: int, v: int) -> np.ndarray:
    h, w = image.shape[:2]
    if 0 <= u < w and 0 <= v < h:
        image = image.copy()
        reach = max(2, h // 20)
        image[max(v - reach, 0) : v + reach + 1, u] = 255
        image[v, max(u - reach, 0) : u + reach + 1] = 255
    return image


def _bar(view: View, name: MapName) -> str:
    if name == "classes":
        return "".join(swatch(color, f"{k}: {CLASS_MEANING[k]}") for k, color in CLASS_COLORS.items())
    scale = scale_of(name, view.map_target, view.session.score.tau_m)
    assert scale is not None
    ticks = "".join(f"<span>{text(t)}</span>" for t in (scale.ticks[0], scale.ticks[2]))
    return f'<div class="cb" style="background:{scale.gradient()}"></div><div class="ticks">{ticks}</div>'
