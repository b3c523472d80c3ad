"""What a picture of a pose is made of: the part of the camera's image to show, and contours drawn into it."""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from PIL import Image as PilImage
from scipy import ndimage

from verefine_viz.core.arrays import Float, Mask
from verefine_viz.core.camera import Camera
from verefine_viz.core.geometry import apply
from verefine_viz.core.palette import RGB, Image, depth_scale
from verefine_viz.core.problem import Target

WIDTH_PX, HEIGHT_PX = 360, 270
"""Default size of a picture; smaller ones have the same shape."""
MARGIN = 0.25
"""Space around the object, as a share of its size."""
SMALLEST_PX = 48
"""Least width of what is shown of the camera's image."""
QUALITY = 72
"""Of WebP: a picture of this size takes 5 to 15 kB."""


@dataclass(frozen=True)
class Window:
    """The part of the camera's image that is shown, in its pixels; it lies inside the image."""

    u0: float
    v0: float
    width: float
    height: float

    @property
    def box(self) -> tuple[float, float, float, float]:
        """For resizing."""
        return self.u0, self.v0, self.u0 + self.width, self.v0 + self.height

    def camera(self, camera: Camera, width_px: int = WIDTH_PX) -> Camera:
        """The camera that sees this part in a picture of this width."""
        height_px = height_of(width_px)
        scale_x, scale_y = width_px / self.width, height_px / self.height
        # Pixel centres are at integers: the window's edge at u0 is half a pixel before that of pixel u0.
        K = np.array(
            [
                [camera.fx * scale_x, 0.0, (camera.cx + 0.5 - self.u0) * scale_x - 0.5],
                [0.0, camera.fy * scale_y, (camera.cy + 0.5 - self.v0) * scale_y - 0.5],
                [0.0, 0.0, 1.0],
            ]
        )
        return Camera(K, width_px, height_px)


def height_of(width_px: int) -> int:
    """Height of a picture of this width [px]."""
    return round(width_px * HEIGHT_PX / WIDTH_PX)


def window_around(target: Target, poses: Sequence[Float]) -> Window:
    """What to show: the object's mask and its model at all poses, as far as they are in the image."""
    camera = target.observation.camera
    rows, columns = np.nonzero(target.instance.mask)
    corners = [np.stack([columns, rows], axis=1).astype(float)]
    for T in poses:
        points_cam = apply(T, target.model.points)
        corners.append(camera.project(points_cam[points_cam[:, 2] > 0.01]))
    pixels = np.concatenate(corners)
    limits = np.array([camera.width, camera.height], float)
    pixels = np.clip(pixels, 0, limits) if len(pixels) else np.array([[0.0, 0.0], limits])
    low, high = pixels.min(axis=0), pixels.max(axis=0)
    width, height = np.maximum((high - low) * (1 + 2 * MARGIN), SMALLEST_PX)
    width = max(width, height * WIDTH_PX / HEIGHT_PX)
    # Never larger than the image, always of the picture's shape.
    width = min(width, camera.width, camera.height * WIDTH_PX / HEIGHT_PX)
    size = np.array([width, width * HEIGHT_PX / WIDTH_PX])
    u0, v0 = np.clip((low + high) / 2 - size / 2, 0, limits - size)
    return Window(float(u0), float(v0), float(size[0]), float(size[1]))


def data_uri(image: Image) -> str:
    """An image (H, W, 3) as a small WebP that a page can hold."""
    out = io.BytesIO()
    PilImage.fromarray(image).save(out, format="WEBP", quality=QUALITY, method=4)
    return "data:image/webp;base64," + base64.b64encode(out.getvalue()).decode("ascii")


def background(target: Target, window: Window, width_px: int = WIDTH_PX) -> Image:
    """The window of the camera's image, or of the depth image where there is none, as (H, W, 3)."""
    observation = target.observation
    image = observation.rgb
    if image is None:
        depth_m = observation.depth_m
        measured = depth_m[depth_m > 0]
        low, high = (float(measured.min()), float(measured.max()) + 1e-6) if len(measured) else (0.0, 1.0)
        image = depth_scale(low, high).colors(np.where(depth_m > 0, depth_m, np.nan))
    resized = PilImage.fromarray(image).resize((width_px, height_of(width_px)), PilImage.Resampling.BICUBIC, window.box)
    return np.array(resized)


def outline(image: Image, mask: Mask, color: RGB) -> None:
    """Draws the contour of a mask, two pixels wide with a dark rim, so that it shows on any ground."""
    line = mask & ~np.asarray(ndimage.binary_erosion(mask, iterations=2), bool)
    rim = np.asarray(ndimage.binary_dilation(line), bool) & ~line
    image[rim] = (image[rim] * 0.35).astype(np.uint8)
    image[line] = color
