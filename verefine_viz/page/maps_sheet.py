"""All score maps of an object's poses as one picture with names and colour bars, to be saved."""

from __future__ import annotations

import numpy as np
from PIL import Image as PilImage
from PIL import ImageDraw, ImageFont

from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import InputError
from verefine_viz.core.palette import CLASS_COLORS, Image, depth_scale
from verefine_viz.core.problem import Target
from verefine_viz.core.scores import COLOUR_MAPS, MAP_NAMES, MapName, PoseScore, ScoreMaps
from verefine_viz.methods.registry import method_of
from verefine_viz.page.branch import Branch
from verefine_viz.page.moment import Moment, labels_of, moment_of
from verefine_viz.page.protocol import Look
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


def maps_sheet(branch: Branch, k: int, obj: int | None) -> Image:
    """Draw (H, W, 3) what it is of, then a row per pose, a column per map, cut to the object.

    Args:
        branch: the run.
        k: the iteration whose pose is shown; at the end of a run that is over, the answer.
        obj: the object; None = that of the iteration.

    Raises:
        InputError: the frame has no such object, there is no pose of it, or the score is not made of pixels.
    """
    moment = moment_of(branch, Look(branch=branch.index, k=k, obj=obj, answer=True))
    target, rows = moment.target, _rows(moment)
    if not rows:
        raise InputError("there is no pose of this object yet")
    names: list[MapName] = [name for name in MAP_NAMES if rows[0][2].correlation is not None or name not in COLOUR_MAPS]
    v0, u0, v1, u1 = _region(target, [maps for _, _, maps in rows])
    depth = target.observation.depth_m
    known = depth[target.instance.mask & (depth > 0)]
    middle, half = float(np.median(known)) if len(known) else 1.0, max(target.model.diameter_m, 0.05)
    scales = scales_of(
        depth_scale(round(middle - half, 2), round(middle + half, 2)), moment.evaluator.verifier.settings.tau_m
    )
    height = _TITLE + _HEAD + len(rows) * (_TILE_H + _GAP) + _BAR
    sheet = PilImage.new("RGB", (_LEFT + len(names) * (_TILE_W + _GAP), height), _PAPER)
    draw, font = ImageDraw.Draw(sheet), ImageFont.load_default(15)
    draw.text((8, 8), _title(moment), _INK, font=font)
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


def _rows(moment: Moment) -> list[tuple[str, PoseScore, ScoreMaps]]:
    """Return the pose that the run has there, and the true one: name, score, maps."""
    poses: dict[str, Float | None] = {
        "answer" if moment.is_answer else "accepted": moment.poses.get("best" if moment.is_answer else "accepted"),
        "ground truth": moment.poses.get("ground truth"),
    }
    if poses.get("accepted", True) is None:
        poses = {"initial": moment.poses.get("initial"), **poses}
    evaluator, target = moment.evaluator, moment.target
    rows: list[tuple[str, PoseScore, ScoreMaps]] = []
    for words, T in poses.items():
        maps = None if T is None else evaluator.maps(target, T)
        if T is not None and maps is None:
            raise InputError(f"{evaluator.verifier.settings.verifier} gives a score, and no maps of it.")
        if T is not None and maps is not None:
            rows.append((words, evaluator.score(target, T), maps))
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


def _title(moment: Moment) -> str:
    branch, instance_id = moment.branch, moment.target.instance.instance_id
    label, method = labels_of(moment.problem)[instance_id], method_of(branch.settings.method.name).label
    when = f"answer after {moment.k} iterations" if moment.is_answer else f"iteration {moment.k}"
    return f"{label}, frame {moment.problem.frame}, {method}, {when}"


def _legend(draw: ImageDraw.ImageDraw, left: int, top: int) -> None:
    font = ImageFont.load_default(11)
    for k, (name, color) in enumerate(CLASS_COLORS.items()):
        x, y = left + (k % 3) * 80, top + (k // 3) * 16
        draw.rectangle((x, y + 2, x + 9, y + 11), fill=color)
        draw.text((x + 13, y), name, _INK, font=font)
