"""Why one pose scores higher than another: the Score panel in numbers, the strip of score maps in pictures."""

from __future__ import annotations

import json
from math import acos, degrees

import numpy as np
import viser

from verefine_viz.core.palette import CLASS_COLORS, STAGE_COLORS, Scale
from verefine_viz.core.scores import MAP_NAMES, MapName
from verefine_viz.pictures.map_images import MapImages, palette_of
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.drawing.bandit_tables import passes_table
from verefine_viz.viewer.drawing.markup import carries, cut, hinted, swatch, text
from verefine_viz.viewer.drawing.score_maps import LABELS, Crop, data_uri, indexed_png, png, scales_for, shared_crop
from verefine_viz.viewer.drawing.tables import CLASS_MEANING, probe_table, score_table
from verefine_viz.viewer.panels.widgets import Block, Send, by_person
from verefine_viz.viewer.snapshot.snapshot import ComparedPose, Snapshot
from verefine_viz.viewer.state.view_options import STAGES
from verefine_viz.viewer.text.names import TERMS
from verefine_viz.viewer.text.poses import compared, score_digits
from verefine_viz.viewer.text.scene import scene_sentence
from verefine_viz.viewer.web.viser_internals import compact

ROW_PX = 26
"""So that both stages in numbers fit into the panel."""


class ScorePanel:
    """Two stages in numbers, and one pixel of both."""

    def __init__(self, gui: viser.GuiApi, send: Send) -> None:
        self._words = Block(gui)
        self.a = gui.add_dropdown("A", STAGES, initial_value="simulated", hint="first stage to compare")
        self.b = gui.add_dropdown("B", STAGES, initial_value="refined", hint="second stage to compare")
        self.a.on_update(by_person(lambda v: send(c.Compare(a=v))))
        self.b.on_update(by_person(lambda v: send(c.Compare(b=v))))
        self._probe = Block(gui)
        self._numbers = Block(gui)
        labels = {LABELS[m][0]: m for m in MAP_NAMES}
        self.map = gui.add_dropdown("On image", tuple(labels), hint="the map of B that lies on the camera image in 3D")
        self.map.on_update(by_person(lambda v: send(c.ShowMap(labels[v]))))
        rows = "".join(compact(row, ROW_PX) for row in (self.a, self.b, self.map))
        gui.add_html(f"<style>{rows}</style>")

    def show(self, view: Snapshot) -> None:
        """Numbers of both stages and of the probed pixel."""
        self.a.visible = self.b.visible = not view.is_whole_scene
        self.a.value, self.b.value = view.options.a, view.options.b
        self.map.value = LABELS[view.options.map][0]
        if view.is_whole_scene and not view.deep:
            return  # A scene is scored when there is time to draw it.
        self._words.show(hinted(scene_sentence(view) if view.is_whole_scene else compared(view), TERMS))
        a, b = (side.pose if side else None for side in (view.a, view.b))
        s = view.session.score
        cut = f"τ = {s.tau_m * 1000:g} mm, normals count up to {degrees(acos(1 - s.alpha)):.0f}°, pixels: {s.pixels}"
        probed = view.options.pixel is not None
        # With a pixel's numbers above it the table leaves out what its bars say, so that both fit the screen.
        below = "" if probed else f'<p class="dim">{text(cut)}</p>{_HINT}'
        passes = passes_table(view) if view.is_whole_scene else ""
        self._numbers.show(score_table([a, b], short=probed) + passes + below)
        if not view.deep:
            return
        sides = [(side.pose.label, side.probe) if side else ("", None) for side in (view.a, view.b)]
        self._probe.show(probe_table(sides[0], sides[1]))


_HINT = "<p class='dim'>Click a map, photo or cloud for a pixel in numbers.</p>"


# The strip of score maps: both stages, every quantity, cut to the object, with colour bars.


class MapsPanel:
    """Two rows of pictures."""

    def __init__(self, gui: viser.GuiApi, send: Send) -> None:
        self._strip = Block(gui, "strip")

    def show(self, view: Snapshot) -> None:
        """New pictures; the old ones stay until they are known."""
        if view.deep:
            self._strip.show(maps_html(view))


def maps_html(view: Snapshot) -> str:
    """The strip as HTML with the pictures inside."""
    sides = [s for s in (view.a, view.b) if s is not None and s.maps is not None]
    if not sides:
        missing = view.options.a if view.a is None else view.options.b
        return f'<p class="dim">No {text(missing)} pose here yet: press Step (N), or choose other stages in Score.</p>'
    crop = shared_crop(view)
    o = view.scene.object(view.target.instance.instance_id)
    several = len(view.scene.objects) > 1 and not view.is_whole_scene
    whose = swatch(o.color) + cut(o.label, 52) if several else ""
    head = "".join(f'<th title="{text(LABELS[m][1])}">{text(LABELS[m][0])}</th>' for m in MAP_NAMES)
    rows = "".join(_row(view, side, crop, letter) for side, letter in zip(sides, "AB", strict=False))
    scales = scales_for(view.map_target, view.session.score.tau_m)
    bars = "".join(f"<td>{_bar(scales.get(m))}</td>" for m in MAP_NAMES)
    return f'<table><tr><th class="whose">{whose}</th>{head}</tr>{rows}<tr><td></td>{bars}</tr></table>'


def _row(view: Snapshot, side: ComparedPose, crop: Crop, letter: str) -> str:
    assert side.maps is not None
    digits = score_digits([s.pose.score for s in (view.a, view.b) if s is not None])
    score = f"{side.pose.score.score:.{digits}f}" if side.pose.score else ""
    color = STAGE_COLORS.get(side.pose.name, STAGE_COLORS["current"])
    name = f"{swatch(color)}<b>{letter}</b> {text(side.pose.label)}<br>{score}"
    images = crop.images(side.maps, view.map_target, view.session.score.tau_m)
    cells = [f"<td>{_picture(view, side, m, images, crop)}</td>" for m in MAP_NAMES]
    return f"<tr><td>{name}</td>{''.join(cells)}</tr>"


def _picture(view: Snapshot, side: ComparedPose, name: MapName, images: MapImages, crop: Crop) -> str:
    if view.options.pixel is None:
        picture = indexed_png(images.indices(name), palette_of(name, images.scales))
    else:
        u, v = view.options.pixel
        picture = png(_with_cross(images.rgb(name), u - crop.u0, v - crop.v0))
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


def _bar(scale: Scale | None) -> str:
    """The colour bar of a scale; of the classes, which have none, their colours."""
    if scale is None:
        return "".join(swatch(color, f"{k}: {CLASS_MEANING[k]}") for k, color in CLASS_COLORS.items())
    ticks = "".join(f"<span>{text(t)}</span>" for t in (scale.ticks[0], scale.ticks[2]))
    return f'<div class="cb" style="background:{scale.gradient()}"></div><div class="ticks">{ticks}</div>'
