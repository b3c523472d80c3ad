"""Why one pose scores higher than another: the Score panel in numbers, the strip of score maps in pictures."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from math import acos, degrees

import numpy as np
import viser

from verefine_viz.core.palette import CLASS_COLORS, Scale
from verefine_viz.core.refiner_steps import LearnedRefiner
from verefine_viz.core.scores import MAP_NAMES, MapName
from verefine_viz.pictures.map_images import MapImages, palette_of
from verefine_viz.pictures.refiner_crops import step_picture, step_words
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.drawing.bandit_tables import passes_table
from verefine_viz.viewer.drawing.markup import Row, carries, focus_label, number, sentence, swatch, table, text
from verefine_viz.viewer.drawing.pose_tables import CLASS_MEANING, score_table
from verefine_viz.viewer.drawing.recorded_scores import agreement_html
from verefine_viz.viewer.drawing.score_maps import (
    LABELS,
    Crop,
    data_uri,
    indexed_png,
    map_names,
    png,
    scales_for,
    shared_crop,
)
from verefine_viz.viewer.panels.widgets import Block, Send, add_style, by_user
from verefine_viz.viewer.snapshot.snapshot import ComparedPose, Probe, Snapshot
from verefine_viz.viewer.state.view_options import STAGES, stage_label
from verefine_viz.viewer.text.display_names import TERMS, abridged, in_focus
from verefine_viz.viewer.text.pose_words import compared, score_digits
from verefine_viz.viewer.web.viser_internals import compact, side_by_side

ROW_PX, SECOND_FROM_PX, LETTER_PX = 26, 158, 12
"""Height of a row, where the second stage begins, and width of the letter before each [px]."""


class ScorePanel:
    """Two stages in numbers, and one pixel of both."""

    def __init__(self, gui: viser.GuiApi, send: Send) -> None:
        self._words = Block(gui)
        stages = {stage_label(name): name for name in STAGES}
        self.a = gui.add_dropdown("A", tuple(stages), initial_value="simulated", hint="first stage to compare")
        self.b = gui.add_dropdown("B", tuple(stages), initial_value="refined", hint="second stage to compare")
        self.a.on_update(by_user(lambda v: send(c.Compare(a=stages[v], b=stages[self.b.value]))))
        self.b.on_update(by_user(lambda v: send(c.Compare(a=stages[self.a.value], b=stages[v]))))
        self._probe = Block(gui)
        self._numbers = Block(gui)
        self._agreement = Block(gui)
        names = {LABELS[m][0]: m for m in MAP_NAMES}
        self.map = gui.add_dropdown("Map", tuple(names), hint="the map of B that lies on the camera image in 3D")
        self.map.on_update(by_user(lambda v: send(c.ShowMap(names[v]))))
        add_style(
            gui, *(compact(row, ROW_PX) for row in (self.a, self.b, self.map)),
            side_by_side(self.a, self.b, ROW_PX, SECOND_FROM_PX, LETTER_PX),
        )  # fmt: skip

    def show(self, snapshot: Snapshot) -> None:
        """Numbers of both stages and of the probed pixel."""
        options, whole = snapshot.options, snapshot.is_whole_scene
        self.a.visible = self.b.visible = not whole and snapshot.comparison is None
        self.a.value, self.b.value = stage_label(options.a), stage_label(options.b)
        self.map.value = LABELS[options.map][0]
        if whole and not snapshot.deep:
            return  # A scene is scored when there is time to draw it.
        self._words.show("" if whole else sentence(compared(snapshot)))
        self._numbers.show(score_html(snapshot))
        self._agreement.show("" if whole else agreement_html(snapshot))
        if snapshot.deep:
            a, b = ((side.pose.label, side.probe) if side else ("", None) for side in (snapshot.a, snapshot.b))
            self._probe.show(probe_table(a, b))


def score_html(snapshot: Snapshot) -> str:
    """Both scores part by part, the passes of a scene, and what the scores are by."""
    a, b = (side.pose if side else None for side in (snapshot.a, snapshot.b))
    if snapshot.is_whole_scene:
        of = f'<span title="frame score: {text(TERMS["frame score"])}">all objects</span>'
    else:
        of = focus_label(snapshot)
    passes = passes_table(snapshot) if snapshot.is_whole_scene else ""
    if snapshot.options.pixel is not None:
        # With a pixel's numbers above it the table leaves out what its bars say, so that both fit the screen.
        return score_table(a, b, of, short=True) + passes
    return score_table(a, b, of, rule=score_rule(snapshot)) + passes


def score_rule(snapshot: Snapshot) -> str:
    """What the scores are by, for a tooltip."""
    s = snapshot.session.score
    return (
        f"τ = {s.tau_m * 1000:g} mm: off by τ or more counts 0. α = {s.alpha:g}: normals count up to "
        f"{degrees(acos(1 - s.alpha)):.0f}°. Pixels: {s.pixels}."
    )


def probe_table(a: tuple[str, Probe | None], b: tuple[str, Probe | None]) -> str:
    """One pixel in numbers, for both stages."""
    sides = [(name, p) for name, p in (a, b) if p is not None]
    if not sides:
        return ""
    first = sides[0][1]

    def row(label: str, tip: str, pick: Callable[[Probe], str]) -> Row:
        return Row([f'<span title="{text(tip)}">{label}</span>', *(text(pick(p)) for _, p in sides)])

    rows = [
        row("observed", "depth that the sensor measured", lambda p: number(p.observed_m, 4, " m")),
        row("rendered", "depth of the model", lambda p: number(p.rendered_m, 4, " m")),
        row("Δ depth, angle", "observed − rendered; between the normals",
            lambda p: f"{number(p.difference_mm, 1, ' mm')}, {number(p.angle_deg, 1, '°')}"),
        row("f_d, f_n", "depth and normal fit", lambda p: f"{p.f_d:.2f}, {p.f_n:.2f}"),
        *([row("f_c", "what this pixel adds to the correlation of colours, times their number",
               lambda p: number(p.correlation, 2)),
           row("colour", "of the model and of the image",
               lambda p: f"{_hex(p.rendered_rgb)}, {_hex(p.observed_rgb)}")]
          if any(p.observed_rgb for _, p in sides) else []),
        row("class", "why it counts as it does", lambda p: p.pixel_class),
        row("adds", "what this pixel adds to the score", lambda p: f"{p.contribution:.5f}"),
    ]  # fmt: skip
    head = [(f"pixel {first.u}, {first.v}", "column u, row v"), *((name, "") for name, _ in sides)]
    return table(head, rows)


def _hex(rgb: tuple[int, int, int] | None) -> str:
    return "–" if rgb is None else "#{:02x}{:02x}{:02x}".format(*rgb)


# The strip of score maps: both stages, every quantity, cut to the object, with colour bars.


WORDS_ON_BAR: dict[MapName, tuple[str, str]] = {
    "difference": ("behind", "in front"),
    "correlation": ("against", "for"),
}
"""At the ends of a colour bar: where the model lies, against what was observed."""


REFINED_NOWHERE = '<p class="dim">No refined pose here.</p>'
WIPE = (
    '<span>all B</span><input type="range" min="0" max="100" value="0" aria-label="A or B" '
    'title="drag the line: A on its left, B on its right"><span>all A</span>'
)
"""Where the line between A and B is in the Maps layout; each browser's own (``assets/page.js``)."""


NAME_LENGTH = 7
"""Characters of a name for which there is room beside the maps, where they are not all of the page."""


class MapsPanel:
    """The pictures of both stages: A above B, or in the Maps layout under it."""

    def __init__(self, gui: viser.GuiApi) -> None:
        Block(gui, "maps-wipe").show(WIPE)
        self._switch = Block(gui, "refiner-switch")
        self._strip = Block(gui, "strip")

    def show(self, snapshot: Snapshot) -> None:
        """New pictures; the old ones stay until they are known."""
        if snapshot.deep:
            self._switch.show(switch_html(snapshot))
            self._strip.show(maps_html(snapshot) + refiner_html(snapshot))


def maps_html(snapshot: Snapshot) -> str:
    """The strip as HTML with the pictures inside: a column per map, A above B. What was observed is the same for both:
    it stands once, beside their names.
    """
    sides = [s for s in (snapshot.a, snapshot.b) if s is not None and s.maps is not None]
    if not sides:
        missing = snapshot.options.a if snapshot.a is None else snapshot.options.b
        return f'<p class="dim">No {text(missing)} pose here yet.</p>'
    crop, tau_m = shared_crop(snapshot), snapshot.session.score.tau_m
    images = [crop.images(side.maps, snapshot.map_target, tau_m) for side in sides if side.maps is not None]
    scales = scales_for(snapshot.map_target, tau_m)
    names = [_name(snapshot, side, letter) for side, letter in zip(sides, "AB", strict=False)]
    observed = _tile(snapshot, sides[0], "observed", images[0], crop)
    columns = [_column("observed", [observed], scales)]
    shown = map_names([side.maps for side in sides])
    for name in shown[1:]:
        tiles = [_tile(snapshot, side, name, of_side, crop) for side, of_side in zip(sides, images, strict=True)]
        columns.append(_column(name, tiles, scales))
    label = in_focus(snapshot).label
    name = f"<span>{text(label)}</span><small>{text(abridged(label, NAME_LENGTH))}</small>"
    whose = f'<b class="whose">{focus_label(snapshot)}{name if focus_label(snapshot) else ""}</b>'
    who = f'<div class="who">{whose}{names[0]}{observed}{"".join(names[1:])}<span class="maps-readout"></span></div>'
    kind = "maps coloured" if "correlation" in shown else "maps"
    return f'<div class="{kind}">{who}{"".join(columns)}</div>'


def switch_html(snapshot: Snapshot) -> str:
    """The box that shows the refiner's crops instead of the maps; none for refiners that cannot say what they saw."""
    if not isinstance(snapshot.refiner, LearnedRefiner):
        return ""
    ticked = " checked" if snapshot.options.refiner_crops else ""
    return (
        '<label title="the crops that the network saw in this iteration, and its steps"><input type="checkbox" '
        f'aria-label="what the refiner saw" {carries(c.ShowRefinerCrops())}{ticked}>refiner</label>'
    )


def refiner_html(snapshot: Snapshot) -> str:
    """What a learned refiner saw, a picture a step; nothing while the box is not ticked."""
    if not snapshot.options.refiner_crops or not isinstance(snapshot.refiner, LearnedRefiner):
        return ""
    figures = "".join(
        f'<figure><img src="{data_uri(png(step_picture(step)))}" alt="step {k}: what the refiner saw">'
        f"<figcaption><b>step {k}</b> {'<br>'.join(map(text, step_words(step)))}</figcaption></figure>"
        for k, step in enumerate(snapshot.refiner_steps or (), 1)
    )
    start = f'<p class="dim start">{text(snapshot.refiner_start)}</p>' if snapshot.refiner_start else ""
    return f'<div class="refiner">{start}{figures or REFINED_NOWHERE}</div>'


def _column(name: MapName, tiles: Sequence[str], scales: Mapping[MapName, Scale]) -> str:
    label, tip = LABELS[name]
    head = f'<div class="name" title="{text(tip)}">{text(label)}</div>'
    return f'<div class="map {name}">{head}{"".join(tiles)}{color_bar(name, scales.get(name))}</div>'


def _name(snapshot: Snapshot, side: ComparedPose, letter: str) -> str:
    digits = score_digits([s.pose.score for s in (snapshot.a, snapshot.b) if s is not None])
    score = f"{side.pose.score.score:.{digits}f}" if side.pose.score else ""
    return (
        f'<div class="side">{swatch(side.pose.color)}<b>{letter}</b> {text(side.pose.label)} <span>{score}</span></div>'
    )


def _tile(snapshot: Snapshot, side: ComparedPose, name: MapName, images: MapImages, crop: Crop) -> str:
    return f'<div class="tile">{_picture(snapshot, side, name, images, crop)}</div>'


def _picture(snapshot: Snapshot, side: ComparedPose, name: MapName, images: MapImages, crop: Crop) -> str:
    if snapshot.options.pixel is None:
        picture = indexed_png(images.indices(name), palette_of(name, images.scales))
    else:
        u, v = snapshot.options.pixel
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


def color_bar(name: MapName, scale: Scale | None) -> str:
    """The colour bar of a scale; of the classes, which have none, their colours with their names; none of colours."""
    if scale is None and name != "classes":
        return "<div></div>"
    if scale is None:
        return (
            '<div class="key">'
            + "".join(
                f'<span title="{text(CLASS_MEANING[k])}">{swatch(color)}{k}</span>' for k, color in CLASS_COLORS.items()
            )
            + "</div>"
        )
    ticks = "".join(f"<span>{text(t)}</span>" for t in (scale.ticks[0], scale.ticks[2]))
    words = "".join(f"<span>{text(word)}</span>" for word in WORDS_ON_BAR.get(name, ()))
    bar = f'<div class="cb" style="background:{scale.gradient()}">{words}</div>'
    return f'<div>{bar}<div class="ticks">{ticks}</div></div>'
