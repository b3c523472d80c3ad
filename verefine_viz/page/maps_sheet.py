"""All score maps of an object's poses as one picture with names and colour bars, to be saved."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from PIL import Image as PilImage
from PIL import ImageDraw, ImageFont

from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import InputError
from verefine_viz.core.palette import CLASS_COLORS, Image, depth_scale
from verefine_viz.core.problem import ANSWER, Target
from verefine_viz.core.scores import COLOUR_MAPS, MAP_NAMES, MapName, PoseScore, ScoreMaps
from verefine_viz.methods.known_methods import method_of
from verefine_viz.page.branch import Branch
from verefine_viz.page.evaluator import CachedEvaluator
from verefine_viz.page.frame_objects import labels_of
from verefine_viz.page.protocol import Save, pose_matrix
from verefine_viz.pictures.map_images import MapImages, scales_of

HEADINGS: dict[MapName, str] = {
    "observed": "observed depth",
    "rendered": "rendered depth",
    "difference": "depth difference",
    "angle": "angle of normals",
    "f_d": "depth fit f_d",
    "f_n": "normal fit f_n",
    "classes": "classes",
    "observed_colour": "image colour",
    "rendered_colour": "model colour",
    "correlation": "correlation",
}
MARGIN = 0.25
"""Shown around the object, as a share of its size."""
_TILE_W, _TILE_H, _LEFT, _TITLE, _HEAD, _BAR, _GAP = 240, 192, 150, 30, 34, 46, 8
_INK, _PAPER = (20, 20, 20), (250, 250, 250)


def maps_sheet(branch: Branch, what: Save) -> Image:
    """Draw (H, W, 3) what it is of, then a row per pose, a column per map, cut to the object.

    Args:
        branch: the run.
        what: the object, its poses by name, and the iteration at which they are shown.

    Raises:
        InputError: the frame has no such object, there is no pose of it, or the score is not made of pixels.
    """
    if what.obj is None or not what.poses:
        raise InputError("there is no pose of this object yet")
    target, is_answer = branch.run.problem.target(what.obj), what.poses[0][0] == ANSWER
    evaluator = branch.evaluator_of(what.k + is_answer)
    rows = _rows(evaluator, target, [(name, pose_matrix(T)) for name, T in what.poses])
    names: list[MapName] = [name for name in MAP_NAMES if rows[0][2].correlation is not None or name not in COLOUR_MAPS]
    v0, u0, v1, u1 = _region(target, [maps for _, _, maps in rows])
    depth = target.observation.depth_m
    known = depth[target.instance.mask & (depth > 0)]
    middle, half = float(np.median(known)) if len(known) else 1.0, max(target.model.diameter_m, 0.05)
    scales = scales_of(depth_scale(round(middle - half, 2), round(middle + half, 2)), evaluator.verifier.settings.tau_m)
    height = _TITLE + _HEAD + len(rows) * (_TILE_H + _GAP) + _BAR
    sheet = PilImage.new("RGB", (_LEFT + len(names) * (_TILE_W + _GAP), height), _PAPER)
    draw, font = ImageDraw.Draw(sheet), ImageFont.load_default(15)
    draw.text((8, 8), _title(branch, target, what.k, is_answer), _INK, font=font)
    for row, (words, score, maps) in enumerate(rows):
        top = _TITLE + _HEAD + row * (_TILE_H + _GAP)
        draw.text((8, top + 8), f"{words}\nscore {score.score:.3f}", _INK, font=font)
        cut = {name: image[v0:v1, u0:u1] for name, image in vars(maps).items() if image is not None}
        images = MapImages(ScoreMaps(**cut), depth[v0:v1, u0:u1], scales)
        for column, name in enumerate(names):
            tile = PilImage.fromarray(images.rgb(name))
            scale = min(_TILE_W / tile.width, _TILE_H / tile.height)
            tile = tile.resize((round(tile.width * scale), round(tile.height * scale)), PilImage.Resampling.NEAREST)
            sheet.paste(tile, (_LEFT + column * (_TILE_W + _GAP), top))
    for column, name in enumerate(names):
        left, bottom, scale = _LEFT + column * (_TILE_W + _GAP), height - _BAR, scales.get(name)
        draw.text((left, _TITLE + 8), HEADINGS[name], _INK, font=font)
        if name == "classes":
            _legend(draw, left, bottom)
        elif scale is not None:
            bar = np.repeat(scale.colors(np.linspace(scale.low, scale.high, _TILE_W))[None], 10, axis=0)
            sheet.paste(PilImage.fromarray(bar), (left, bottom))
            draw.text((left, bottom + 14), scale.ticks[0], _INK, font=font)
            draw.text((left + _TILE_W, bottom + 14), scale.ticks[2], _INK, font=font, anchor="ra")
    return np.asarray(sheet)


def _rows(
    evaluator: CachedEvaluator, target: Target, poses: Sequence[tuple[str, Float]]
) -> list[tuple[str, PoseScore, ScoreMaps]]:
    """Return name, score and maps of each pose."""
    rows: list[tuple[str, PoseScore, ScoreMaps]] = []
    for name, T in poses:
        maps = evaluator.maps(target, T)
        if maps is None:
            raise InputError(f"{evaluator.verifier.settings.verifier} gives a score, and no maps of it.")
        rows.append((name, evaluator.score(target, T), maps))
    return rows


def _region(target: Target, maps: list[ScoreMaps]) -> tuple[int, int, int, int]:
    """Return rows and columns that hold the mask and all renderings, with a margin."""
    shown = target.instance.mask.copy()
    for one in maps:
        shown |= one.rendered_m > 0
    rows, columns = np.nonzero(shown)
    if len(rows) == 0:
        return 0, 0, *shown.shape
    margin_v, margin_u = (int(MARGIN * (np.ptp(x) + 1)) for x in (rows, columns))
    return (
        max(int(rows.min()) - margin_v, 0),
        max(int(columns.min()) - margin_u, 0),
        int(rows.max()) + 1 + margin_v,
        int(columns.max()) + 1 + margin_u,
    )


def _title(branch: Branch, target: Target, k: int, is_answer: bool) -> str:
    label, method = (
        labels_of(branch.run.problem)[target.instance.instance_id],
        method_of(branch.settings.method.name).label,
    )
    when = f"answer after {k} iterations" if is_answer else f"iteration {k}"
    return f"{label}, frame {branch.run.problem.frame}, {method}, {when}"


def _legend(draw: ImageDraw.ImageDraw, left: int, top: int) -> None:
    font = ImageFont.load_default(11)
    for k, (name, color) in enumerate(CLASS_COLORS.items()):
        x, y = left + (k % 3) * 80, top + (k // 3) * 16
        draw.rectangle((x, y + 2, x + 9, y + 11), fill=color)
        draw.text((x + 13, y), name, _INK, font=font)
