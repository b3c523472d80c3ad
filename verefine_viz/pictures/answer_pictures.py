"""Small pictures of answers, for the cards of page and report: the camera's image with contours."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from msgspec import structs
from PIL import Image as PilImage

from verefine_viz.core.arrays import Float
from verefine_viz.core.camera import Camera
from verefine_viz.core.geometry import apply
from verefine_viz.core.observation import Observation
from verefine_viz.core.palette import RGB, STAGE_COLORS, Image, depth_scale
from verefine_viz.core.problem import Placed, Target
from verefine_viz.core.settings import Session
from verefine_viz.pictures.contours import draw_contours
from verefine_viz.scenes.segments import draw_placed
from verefine_viz.scenes.source import SceneSource, open_scene

WIDTH_PX, HEIGHT_PX = 360, 270
"""Shape of a picture, and its size unless another is asked for."""
MARGIN = 0.25
"""Margin around the object, as a share of its size."""
SMALLEST_PX = 48
"""Least width of the shown part of the camera's image."""
SHADE = 0.4
"""Brightness of a surface seen from the side, where there is no photo."""
QUALITY = 72
"""Quality of WebP: a picture of this size takes 5 to 15 kB."""


@dataclass(frozen=True)
class ShownPart:
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
        height_px = round(width_px * self.height / self.width)
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


def _height_of(width_px: int) -> int:
    """Height of a picture of this width [px]."""
    return round(width_px * HEIGHT_PX / WIDTH_PX)


def window_around(target: Target, poses: Sequence[Float], aspect: float = WIDTH_PX / HEIGHT_PX) -> ShownPart:
    """The part to show: around the object's mask and its model at all poses, as far as they are in the image.

    ``aspect``: width by height of the picture.
    """
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
    width = max(width, height * aspect)
    # Never larger than the image, always of the picture's shape.
    width = min(width, camera.width, camera.height * aspect)
    size = np.array([width, width / aspect])
    u0, v0 = np.clip((low + high) / 2 - size / 2, 0, limits - size)
    return ShownPart(float(u0), float(v0), float(size[0]), float(size[1]))


def thumbnail(target: Target, T_cam_obj: Float | None, width_px: int) -> bytes:
    """The camera's image with the contours of an answer, if there is one, and of the ground truth, as WebP."""
    drawn = {"ground truth": target.instance.T_cam_obj_gt, "accepted": T_cam_obj}
    poses = {kind: T for kind, T in drawn.items() if T is not None}
    window, size = window_around(target, [*poses.values()]), (width_px, _height_of(width_px))
    whole = PilImage.fromarray(camera_image(target.observation))
    image = np.array(whole.resize(size, PilImage.Resampling.BICUBIC, window.box))
    return webp(with_outlines(image, target, window, [(T, STAGE_COLORS[kind]) for kind, T in poses.items()]))


def with_outlines(image: Image, target: Target, window: ShownPart, poses: Sequence[tuple[Float, RGB]]) -> Image:
    """A picture (H, W, 3) of a part of the image with the contours of a model at some poses, the last one on top."""
    camera = window.camera(target.observation.camera, image.shape[1])
    for T, color in poses:
        depth_m = draw_placed([Placed(0, target.model, T)], camera)[0]
        image = draw_contours(image, depth_m > 0, color)
    return image


def picture_source(session: Session, frames: Sequence[str]) -> SceneSource:
    """The data of a run, opened without its initial poses: they are not drawn, and their files may be gone.

    Raises:
        VerefineError: the data cannot be read.
    """
    hypotheses = structs.replace(session.hypotheses, source="perturb", estimate=())
    return open_scene(structs.replace(session.scene, frames=tuple(frames)), hypotheses)


def webp(image: Image) -> bytes:
    """An image (H, W, 3) as a small WebP file."""
    out = io.BytesIO()
    PilImage.fromarray(image).save(out, format="WEBP", quality=QUALITY, method=4)
    return out.getvalue()


def camera_image(observation: Observation) -> Image:
    """(H, W, 3) the camera's image, or where there is none the coloured depth image, shaded so that it shows shapes."""
    if observation.rgb is not None:
        return observation.rgb
    depth_m = observation.depth_m
    known = depth_m[depth_m > 0]
    # A few pixels far behind everything must not use up the range of colours.
    low, high = (float(known.min()), float(np.percentile(known, 98)) + 1e-6) if len(known) else (0.0, 1.0)
    colors = depth_scale(low, high).colors(np.where(depth_m > 0, depth_m, np.nan))
    facing = np.abs(observation.normals_cam[..., 2:])
    return (colors * (SHADE + (1 - SHADE) * facing)).astype(np.uint8)
