"""Contours of posed models, drawn alike by the page's image pane, the gallery and the report."""

from __future__ import annotations

import math

import contourpy
import numpy as np
from numpy.typing import NDArray
from PIL import Image as PilImage
from PIL import ImageDraw

from verefine_viz.core.arrays import Float, Mask
from verefine_viz.core.camera import Camera
from verefine_viz.core.geometry import apply
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.palette import RGB, Image
from verefine_viz.core.problem import Placed
from verefine_viz.scenes.segments import draw_placed

FINEST = 2
"""So many times finer than the camera's pixels a contour is at most."""
MOST_PX = 480
"""Width and height at most of the picture from which a contour is taken."""
RIM_PX, LINE_PX = 4, 2
DARKER = 0.35


def contour_lines(mask: Mask) -> list[Float]:
    """The contours of a mask (H, W): lines (n, 2) of (u, v), halfway between a pixel inside and one outside.

    Pixel centres are at integers. The border of the image counts as outside.
    """
    padded = np.pad(mask.astype(np.float32), 1)
    return [line - 1.0 for line in contourpy.contour_generator(z=padded).lines(0.5)]  # type: ignore[operator]


def model_contours(model: ObjectModel, T_cam_obj: Float, camera: Camera) -> list[Float]:
    """The contours of a posed model in the camera's image, finer than its pixels, as :func:`contour_lines` has them.

    Empty where the model is not in the image.
    """
    points_cam = apply(T_cam_obj, model.points)
    pixels = camera.project(points_cam[points_cam[:, 2] > 0.01])
    if len(pixels) == 0:
        return []
    low = np.maximum(np.floor(pixels.min(axis=0)) - 2, 0)
    high = np.minimum(np.ceil(pixels.max(axis=0)) + 3, (camera.width, camera.height))
    width, height = (high - low).astype(int)
    if min(width, height) <= 0:
        return []
    finer = min(FINEST, MOST_PX / max(width, height))
    part = _part(camera, low, finer, (math.ceil(width * finer), math.ceil(height * finer)))
    mask = draw_placed([Placed(0, model, T_cam_obj)], part)[0] > 0
    return [(_smoothed(line) + 0.5) / finer - 0.5 + low for line in contour_lines(mask)]


def _part(camera: Camera, low: NDArray, finer: float, size: tuple[int, int]) -> Camera:
    """The camera that sees the image from pixel ``low`` (u, v) on, with pixels that much finer."""
    cx, cy = ((c + 0.5 - edge) * finer - 0.5 for c, edge in zip((camera.cx, camera.cy), low, strict=True))
    return Camera(np.array([[camera.fx * finer, 0.0, cx], [0.0, camera.fy * finer, cy], [0.0, 0.0, 1.0]]), *size)


def svg_path(lines: list[Float]) -> str:
    """Contours as the ``d`` of an SVG path, in whose coordinates pixel (u, v) covers u … u + 1 and v … v + 1.

    To a tenth of a pixel, each point relative to the one before it.
    """
    parts = []
    for line in lines:
        tenths = np.rint((line + 0.5) * 10).astype(int)
        steps = np.diff(tenths, axis=0)
        way = " ".join(f"{u / 10:g} {v / 10:g}" for u, v in steps[steps.any(axis=1)].tolist())
        parts.append(f"M{tenths[0, 0] / 10:g} {tenths[0, 1] / 10:g}l{way}z")
    return "".join(parts)


def _smoothed(line: Float) -> Float:
    """A closed line (n, 2) without the stairs of its pixels and with a third of its points."""
    ring = line[:-1]
    if len(ring) < 12:
        return line
    return np.mean([np.roll(ring, k, axis=0) for k in range(-2, 3)], axis=0)[::3]


def draw_contours(image: Image, mask: Mask, color: RGB) -> Image:
    """An image (H, W, 3) with the contours of a mask, two pixels wide with a dark rim: they show on any ground."""
    lines = [[(float(u), float(v)) for u, v in line] for line in contour_lines(mask)]
    rim = PilImage.new("1", image.shape[1::-1])
    for line in lines:
        ImageDraw.Draw(rim).line(line, fill=1, width=RIM_PX)
    dark = np.where(np.asarray(rim)[..., None], (image * DARKER).astype(np.uint8), image)
    drawn = PilImage.fromarray(dark)
    for line in lines:
        ImageDraw.Draw(drawn).line(line, fill=color, width=LINE_PX)
    return np.array(drawn)
