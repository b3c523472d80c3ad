"""A model as it would look at a pose: with its colours, lit from the camera."""

from __future__ import annotations

import io
import math

import numpy as np
from PIL import Image as PilImage

from verefine_viz.core.arrays import Float
from verefine_viz.core.camera import Camera
from verefine_viz.core.geometry import apply
from verefine_viz.core.problem import Placed, Target
from verefine_viz.rendering.rendered_scene import render_scene

Region = tuple[int, int, int, int]
"""[u0, v0, width, height] of a part of the image [px]."""
FINER = 2
"""A picture's resolution in the camera's pixels, at most."""
MOST_PX = 480
"""Largest width and height of a picture, unless the model is larger in the camera's own pixels."""


def shaded_picture(target: Target, T_cam_obj: Float) -> tuple[Region, bytes] | None:
    """The region of the image, as :func:`region_of` has it, and its PNG with transparency; None where nothing shows."""
    region = region_of(target, T_cam_obj)
    return None if region is None else (region, picture(target, T_cam_obj, region))


def region_of(target: Target, T_cam_obj: Float) -> Region | None:
    """[u0, v0, width, height] of the pixels that may show the model; None where the model is not in the image."""
    camera = target.observation.camera
    points_cam = apply(T_cam_obj, target.model.vertices)
    in_front = points_cam[:, 2] > 0.01
    if not in_front.any():
        return None
    if not in_front.all():
        return 0, 0, camera.width, camera.height
    pixels = camera.project(points_cam)
    low = np.maximum(np.floor(pixels.min(axis=0)), 0)
    high = np.minimum(np.ceil(pixels.max(axis=0)) + 1, (camera.width, camera.height))
    if (high <= low).any():
        return None
    return int(low[0]), int(low[1]), int(high[0] - low[0]), int(high[1] - low[1])


def picture(target: Target, T_cam_obj: Float, region: Region) -> bytes:
    """The PNG of a region."""
    _, _, width, height = region
    finer = min(FINER, max(1, math.floor(MOST_PX / max(width, height))))
    part = part_of(target.observation.camera, region, finer)
    seen = render_scene([Placed(0, target.model, T_cam_obj)], part)
    opaque = np.where(seen.labels >= 0, 255, 0).astype(np.uint8)
    out = io.BytesIO()
    PilImage.fromarray(np.dstack([seen.rgb, opaque])).save(out, "png", compress_level=1)
    return out.getvalue()


def part_of(camera: Camera, region: Region, finer: int) -> Camera:
    """The camera that sees a region, with pixels finer by a factor."""
    u0, v0, width, height = region
    cx, cy = ((c + 0.5 - edge) * finer - 0.5 for c, edge in zip((camera.cx, camera.cy), (u0, v0), strict=True))
    K = np.array([[camera.fx * finer, 0.0, cx], [0.0, camera.fy * finer, cy], [0.0, 0.0, 1.0]])
    return Camera(K, width * finer, height * finer)
