"""The image pane: the photo with contours, the posed model and a score map over it, and the numbers of its pixels.

Zoom, wipe, opacity and what the legend switches off belong to each browser (``assets/image_pane.js``); what is drawn is
the same for all.
"""

from __future__ import annotations

import json

import viser

from verefine_viz.core.problem import Problem
from verefine_viz.core.scores import COLOUR_MAPS, PIXEL_CLASSES, MapName
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.assets import asset
from verefine_viz.viewer.command_json import to_json
from verefine_viz.viewer.drawing.image_layers import (
    ShownContour,
    contours_svg,
    map_html,
    model_html,
    numbers_html,
    object_crop,
    photo_html,
    shown_contours,
    shown_side,
)
from verefine_viz.viewer.drawing.markup import carries, swatch, text
from verefine_viz.viewer.drawing.ruler import ruler_html, ruler_of
from verefine_viz.viewer.drawing.score_maps import LABELS, scales_for
from verefine_viz.viewer.panels.score_panel import color_bar
from verefine_viz.viewer.panels.widgets import Block, add_style
from verefine_viz.viewer.snapshot.snapshot import ComparedPose, Snapshot

OVER_PHOTO: tuple[MapName, ...] = ("difference", "angle", "f_d", "f_n", "classes", "correlation")
"""Score maps that can be laid over the photo."""
_ICON = '<svg viewBox="0 0 16 16"><path d="{}"/></svg>'
WHOLE = _ICON.format("M1 5V1h4M11 1h4v4M15 11v4h-4M5 15H1v-4M6 6h4v4H6z")
CAMERA = _ICON.format("M1 4h9v8H1zM10 7l5-3v8l-5-3")
OBJECT = _ICON.format("M8 0v4M8 12v4M0 8h4M12 8h4M5 8a3 3 0 1 0 6 0a3 3 0 1 0 -6 0")
RULER = _ICON.format("M1 11L11 1l4 4L5 15zM4 8l2 2M7 5l2 2")
WIPE = _ICON.format("M1 2h14v12H1zM8 0v16M10 5h3M10 8h3M10 11h3")


class ImagePanel:
    """Blocks that lie over each other and fill the box that the panel is given; only those that changed are sent."""

    def __init__(self, gui: viser.GuiApi) -> None:
        add_style(gui, asset("image_pane.css"))
        self._photo = Block(gui, "image-layer photo")
        self._model = Block(gui, "image-layer model")
        self._map = Block(gui, "image-layer map")
        self._contours = Block(gui, "image-layer contours")
        self._numbers = Block(gui, "image-layer numbers")
        self._pane = Block(gui, "image-pane")
        self._problem: Problem | None = None

    def show(self, snapshot: Snapshot) -> None:
        """Contours at once; model, map and numbers of pixels are those of the last deep snapshot until the next."""
        if snapshot.problem is not self._problem:
            self._problem = snapshot.problem
            self._photo.show(photo_html(snapshot.problem.observation))
        contours = shown_contours(snapshot)
        self._contours.show(contours_svg(snapshot, contours))
        self._pane.show(pane_html(snapshot, contours))
        if snapshot.deep:
            side = shown_side(snapshot)
            self._model.show(model_html(snapshot, side) if side is not None else "")
            self._map.show(map_html(snapshot, side) + map_scale(snapshot, side) if side is not None else "")
            self._numbers.show(numbers_html(side) if side is not None else "")


def map_scale(snapshot: Snapshot, side: ComparedPose) -> str:
    """Which map of which pose lies over the photo, and its colours."""
    name = snapshot.options.map
    scale = scales_for(snapshot.map_target, snapshot.session.score.tau_m).get(name)
    letter = "B" if side is snapshot.b else "A"
    head = f"{letter} {text(side.pose.label)}: {text(LABELS[name][0])}"
    return f'<div class="image-scale">{head}{color_bar(name, scale)}</div>'


def pane_html(snapshot: Snapshot, contours: tuple[ShownContour, ...]) -> str:
    """What takes the mouse, with the bar above the picture and the legend below."""
    camera, crop = snapshot.problem.observation.camera, object_crop(snapshot)
    whole = json.dumps([0, 0, camera.width, camera.height])
    area = json.dumps([crop.u0, crop.v0, crop.width, crop.height])
    whose = "all" if snapshot.is_whole_scene else snapshot.target.instance.instance_id
    # Frames of two sessions may have one name.
    key = f"{snapshot.frame} {whose} {snapshot.session.title}".rstrip()
    marked = [pixel for pixel in (snapshot.options.pixel, snapshot.options.ruler) if pixel is not None]
    marks = "".join(f'<i class="image-cross probed" style="--u:{u + 0.5};--v:{v + 0.5}"></i>' for u, v in marked)
    ruler = ruler_of(snapshot.problem.observation, snapshot.options)
    if ruler is not None:
        marks += ruler_html(ruler, camera.width, camera.height)
    legend = "".join(
        f'<button class="image-key" data-key="{one.key}" title="contour on or off">{_named(one)}</button>'
        for one in contours
    )
    return (
        f'<div class="image-view" data-frame="{whole}" data-area="{area}" data-of="{text(key)}" '
        f'data-classes="{text(json.dumps(["not scored", *PIXEL_CLASSES]))}">'
        f'<div class="image-canvas image-hit" {carries(c.ProbePixel(0, 0))} data-crop="{whole}" '
        f'style="width:{camera.width}px;height:{camera.height}px"></div>'
        f"{marks}"
        '<i class="image-wipe" title="left: photo, right: rendering"></i></div>'
        f'<div class="image-bar">{_bar(snapshot)}</div>'
        f'<div class="image-foot"><span class="image-legend">{legend}</span><span class="image-readout"></span></div>'
    )


def _named(contour: ShownContour) -> str:
    """Its name with its colour; of one that several poses share, all of them."""
    names = contour.names or ((contour.label, contour.color),)
    return " = ".join(f"{swatch(color)}{text(name)}" for name, color in names)


def _bar(snapshot: Snapshot) -> str:
    """What belongs to one browser has no command, but names what ``image_pane.js`` does."""
    chosen = snapshot.options.map
    maps = "".join(
        f'<option value="{text(to_json(c.ShowMap(name)))}"{" data-chosen" if name == chosen else ""}>'
        f"{text(LABELS[name][0])}</option>"
        for name in OVER_PHOTO
        if name not in COLOUR_MAPS or snapshot.session.score.colour_weight > 0
    )
    return (
        f'<button data-image="whole" title="object or whole frame; wheel: zoom, double click: back">{WHOLE}</button>'
        f'<button data-image="wipe" title="drag a line: photo on its left, rendering on its right">{WIPE}</button>'
        '<input type="range" min="0" max="100" aria-label="opacity of the model" title="opacity of the posed model">'
        '<select class="image-map" aria-label="score map over the photo" title="score map over the photo">'
        f'<option value="none">no map</option>{maps}</select>'
        f"<button {carries(c.PlaceRuler())}{' data-on' if snapshot.options.ruler is not None else ''} "
        f'title="ruler: from the marked pixel to the next that is clicked (R)">{RULER}</button>'
        f'<button {carries(c.MoveCamera("sensor"))} title="look through the camera in 3D">{CAMERA}</button>'
        f'<button {carries(c.MoveCamera("object"))} title="focus the object in 3D">{OBJECT}</button>'
    )
