"""Contours of posed models, drawn alike by the page's image pane and on the cards of answers."""

from __future__ import annotations

import contourpy
import numpy as np
from PIL import Image as PilImage
from PIL import ImageDraw

from verefine_viz.core.arrays import Float, Mask
from verefine_viz.core.palette import RGB, Image

RIM_PX, LINE_PX = 4, 2
DARKER = 0.35


def contour_lines(mask: Mask) -> list[Float]:
    """The contours of a mask (H, W): lines (n, 2) of (u, v), halfway between a pixel inside and one outside.

    Pixel centres are at integers. The border of the image counts as outside.
    """
    padded = np.pad(mask.astype(np.float32), 1)
    return [line - 1.0 for line in contourpy.contour_generator(z=padded).lines(0.5)]  # type: ignore[operator]


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
