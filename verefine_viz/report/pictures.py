"""Pictures of an answer: the camera's image with contours, and the depth that the answer leaves unexplained."""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image as PilImage
from scipy import ndimage

from verefine_viz.core.arrays import Float, Mask
from verefine_viz.core.camera import Camera
from verefine_viz.core.colormaps import Image, depth_scale, difference_scale
from verefine_viz.core.geometry import apply
from verefine_viz.core.palette import CLASS_COLORS, RGB, SIDE_COLORS, STAGE_COLORS
from verefine_viz.core.problem import Placed, Target
from verefine_viz.rendering.scene import render_scene

WIDTH_PX, HEIGHT_PX = 360, 270
"""Size of a picture in the report; its contours are drawn at this size, however small the object is."""
MARGIN = 0.25
"""Room around the object, as a share of its size."""
SMALLEST_PX = 48
"""Least width of what is shown of the camera's image."""
QUALITY = 72
"""Of WebP: a picture takes 5 to 15 kB."""


@dataclass(frozen=True)
class Pictures:
    """Two images as data URIs."""

    camera: str
    """With the contours of the answers and of the ground truth."""
    depth: str
    """Observed − rendered depth of the first answer over the grey image."""


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

    def camera(self, camera: Camera) -> Camera:
        """The camera that sees this part in the size of a picture."""
        scale_x, scale_y = WIDTH_PX / self.width, HEIGHT_PX / self.height
        # Pixel centres are at integers: the window's edge at u0 is half a pixel before that of pixel u0.
        K = np.array(
            [
                [camera.fx * scale_x, 0.0, (camera.cx + 0.5 - self.u0) * scale_x - 0.5],
                [0.0, camera.fy * scale_y, (camera.cy + 0.5 - self.v0) * scale_y - 0.5],
                [0.0, 0.0, 1.0],
            ]
        )
        return Camera(K, WIDTH_PX, HEIGHT_PX)


def pictures(target: Target, answers: Sequence[tuple[Float, str]], tau_m: float) -> Pictures:
    """The pictures of one object.

    Args:
        target: with ground truth or without.
        answers: T_cam_obj (4, 4) and what it is: "best" where one run is shown, else its side "A" or "B".
        tau_m: depth tolerance of the score, which sets the scale of the depth picture [m].
    """
    T_gt = target.instance.T_cam_obj_gt
    poses = [T for T, _ in answers] + ([T_gt] if T_gt is not None else [])
    window = window_around(target, poses)
    camera = window.camera(target.observation.camera)
    background = _background(target, window)
    drawn = [render_scene([Placed(0, target.model, T)], camera) for T in poses]
    seen = background.copy()
    if T_gt is not None:
        _outline(seen, drawn[-1].labels >= 0, STAGE_COLORS["ground truth"])
    for (_, kind), rendering in zip(answers, drawn, strict=False):
        _outline(seen, rendering.labels >= 0, color_of(kind))
    rendered_m = drawn[0].depth_m if answers else np.zeros((HEIGHT_PX, WIDTH_PX), np.float32)
    difference = _difference(background, _resized_depth(target, window), rendered_m, tau_m)
    return Pictures(data_uri(seen), data_uri(difference))


def color_of(kind: str) -> RGB:
    """The contour's colour of an answer."""
    return SIDE_COLORS[kind] if kind in SIDE_COLORS else STAGE_COLORS["accepted"]


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


def _background(target: Target, window: Window) -> Image:
    observation = target.observation
    image = observation.rgb
    if image is None:
        depth_m = observation.depth_m
        known = depth_m[depth_m > 0]
        low, high = (float(known.min()), float(known.max()) + 1e-6) if len(known) else (0.0, 1.0)
        image = depth_scale(low, high).colors(np.where(depth_m > 0, depth_m, np.nan))
    resized = PilImage.fromarray(image).resize((WIDTH_PX, HEIGHT_PX), PilImage.Resampling.BICUBIC, window.box)
    return np.array(resized)


def _resized_depth(target: Target, window: Window) -> NDArray[np.float32]:
    depth = PilImage.fromarray(np.ascontiguousarray(target.observation.depth_m, np.float32))
    return np.asarray(depth.resize((WIDTH_PX, HEIGHT_PX), PilImage.Resampling.NEAREST, window.box))


def _difference(
    background: Image, observed_m: NDArray[np.float32], rendered_m: NDArray[np.float32], tau_m: float
) -> Image:
    grey = background.mean(axis=2, keepdims=True) * 0.35 + 20
    out = np.repeat(grey, 3, axis=2).astype(np.uint8)
    covered = rendered_m > 0
    both = covered & (observed_m > 0)
    difference_mm = np.where(both, (observed_m - rendered_m) * 1e3, np.nan)
    out[both] = difference_scale(tau_m).colors(difference_mm)[both]
    out[covered & ~both] = CLASS_COLORS["unknown"]
    return out


def _outline(image: Image, mask: Mask, color: RGB) -> None:
    """Draws the contour of a mask, two pixels wide with a dark rim, so that it shows on any ground."""
    line = mask & ~np.asarray(ndimage.binary_erosion(mask, iterations=2), bool)
    rim = np.asarray(ndimage.binary_dilation(line), bool) & ~line
    image[rim] = (image[rim] * 0.35).astype(np.uint8)
    image[line] = color
