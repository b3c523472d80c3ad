"""Input and output of a learned refiner at a step, as one picture, for the page and for recordings.

The crops side by side, two in a row. The step is drawn over the crop that shows the model at its pose, or over the
image: the shift as a white line of its length that ends in a dot, and the axis of the turn in yellow, longer for larger
turns.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from PIL import Image as PilImage
from PIL import ImageDraw, ImageFont

from verefine_viz.core.arrays import Float
from verefine_viz.core.palette import EMPTY, FIT, RGB, Image, Scale, difference_scale
from verefine_viz.core.problem import Target
from verefine_viz.core.protocols import Refiner
from verefine_viz.core.refiner_steps import RefinerStep, TrainedRefiner
from verefine_viz.evaluation.trained_range import start_of

TILE_PX, GAP_PX = 160, 3
SHIFT, TURN, POINT = (255, 255, 255), (255, 212, 59), (64, 192, 87)
LONGEST_TURN = np.pi / 2
"""A turn whose axis is drawn over half of the tile [rad]."""
DIVERGING = difference_scale(1.0).anchors
MASKS: tuple[RGB, ...] = ((38, 40, 44), (59, 130, 246), (230, 150, 60), (225, 225, 225))
"""Neither, the object's mask alone, the model alone, both."""


def step_picture(step: RefinerStep) -> Image:
    """(H, W, 3) all crops of a step, the step drawn over the last one."""
    tiles = [_tile(step, name) for name in step.crops]
    names = list(step.crops)
    _draw_step(tiles[names.index("rendered") if "rendered" in names else -1], step)
    columns = min(len(tiles), 2)
    rows = -(-len(tiles) // columns)
    side = TILE_PX + GAP_PX
    sheet = PilImage.new("RGB", (columns * side - GAP_PX, rows * side - GAP_PX), EMPTY)
    for k, (name, tile) in enumerate(zip(step.crops, tiles, strict=True)):
        _label(tile, name)
        sheet.paste(tile, (k % columns * side, k // columns * side))
    return np.asarray(sheet)


def step_words(step: RefinerStep) -> tuple[str, ...]:
    """The step in numbers, a few words a line."""
    turn_deg, shift_mm = np.rad2deg(np.linalg.norm(step.turn)), 1e3 * np.linalg.norm(step.shift_m)
    lines = [f"{turn_deg:.1f}°, {shift_mm:.1f} mm" + ("" if step.is_taken else ", not taken")]
    if step.expected_mm is not None:
        beyond = step.trained_mm is not None and step.expected_mm > step.trained_mm
        lines.append(
            f"expects {step.expected_mm:.1f} mm left" + (f", trained to {step.trained_mm:.0f} mm" if beyond else "")
        )
    if step.confidence is not None:
        lines.append(f"confidence {step.confidence:.2f}")
    return tuple(lines)


def start_words(refiner: Refiner, target: Target, T_cam_obj: Float) -> str:
    """How far from the ground truth a call began, and how far the refiner was trained for; "" where either is
    unknown.
    """
    trained = refiner.trained_range if isinstance(refiner, TrainedRefiner) else None
    if trained is None or target.instance.T_cam_obj_gt is None:
        return ""
    start = start_of(target.model, T_cam_obj, target.instance.T_cam_obj_gt)
    farthest = f"trained to {trained.rotation_deg:.0f}°, {start.largest_shift_mm(trained):.0f} mm"
    began = f"began {start.rotation_deg:.0f}°, {start.shift_mm:.0f} mm off"
    return f"{began}: out of range, {farthest}" if start.is_beyond(trained) else f"{began}, {farthest}"


def _tile(step: RefinerStep, name: str) -> PilImage.Image:
    crop = step.crops[name]
    if crop.ndim == 2 and name == "masks":
        crop = np.array(MASKS, np.uint8)[crop.astype(np.intp)]
    elif crop.ndim == 2:
        scale_of = Scale(*step.limits.get(name, _ends(crop)), "", DIVERGING if name == "difference" else FIT.anchors)
        crop = scale_of.colors(crop.astype(np.float64))
    height, width = crop.shape[:2]
    scale = TILE_PX / max(height, width)
    drawn = PilImage.fromarray(crop).resize((round(width * scale), round(height * scale)), PilImage.Resampling.NEAREST)
    tile = PilImage.new("RGB", (TILE_PX, TILE_PX), EMPTY)
    tile.paste(drawn, (0, 0))
    return tile


def _draw_step(tile: PilImage.Image, step: RefinerStep) -> None:
    height, width = next(iter(step.crops.values())).shape[:2]
    scale, draw = TILE_PX / max(height, width), ImageDraw.Draw(tile)
    for x, y in (step.points_px + 0.5) * scale if step.points_px is not None else ():
        draw.point((x, y), POINT)
    x, y = ((np.array([width, height]) - 1) / 2 if step.centre_px is None else step.centre_px) * scale + scale / 2
    angle = float(np.linalg.norm(step.turn))
    if angle > 0:
        ax, ay = step.turn[:2] / angle * min(angle / LONGEST_TURN, 1.0) * TILE_PX / 2
        _outlined(draw, (x - ax, y - ay, x + ax, y + ay), TURN)
    tip = np.array([x, y]) + step.shift_m[:2] * step.px_per_m * scale
    _outlined(draw, (x, y, float(tip[0]), float(tip[1])), SHIFT)
    draw.ellipse((tip[0] - 4, tip[1] - 4, tip[0] + 4, tip[1] + 4), SHIFT, EMPTY)


def _ends(crop: NDArray) -> tuple[float, float]:
    """The smallest and the largest number, made different."""
    known = crop[np.isfinite(crop)]
    low, high = (float(known.min()), float(known.max())) if known.size else (0.0, 1.0)
    return low, max(high, low + 1e-9)


def _outlined(draw: ImageDraw.ImageDraw, ends: tuple[float, float, float, float], color: RGB) -> None:
    draw.line(ends, EMPTY, 5)
    draw.line(ends, color, 2)


def _label(tile: PilImage.Image, name: str) -> None:
    draw, font = ImageDraw.Draw(tile), ImageFont.load_default(12)
    draw.rectangle((0, 0, draw.textlength(name, font) + 6, 15), (24, 26, 30))
    draw.text((3, 0), name, (230, 230, 230), font)
