"""Which pixels a model covers under a pose; used to tell instances of the same object apart."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from PIL import Image, ImageDraw

from verefine_viz.core.arrays import Float, Mask
from verefine_viz.core.camera import Camera
from verefine_viz.core.geometry import apply
from verefine_viz.core.model import ObjectModel

OVERSAMPLING = 4
"""The drawing fills every pixel that an edge touches; drawn this much larger, that is a quarter of a pixel."""


def silhouette(model: ObjectModel, T_cam_obj: Float, camera: Camera) -> Mask:
    """The model's outline, filled, (H, W); triangles that reach behind the camera are left out."""
    k = OVERSAMPLING
    canvas = Image.new("1", (camera.width * k, camera.height * k))
    draw = ImageDraw.Draw(canvas)
    vertices = apply(T_cam_obj, model.vertices)
    corners = vertices[model.faces]
    corners = corners[(corners[..., 2] > 1e-6).all(axis=1)]
    # Far outside the image is as good as just outside; it keeps the drawing's integers in range.
    limit = 4.0 * max(camera.shape)
    pixels = np.clip(camera.project(corners), -limit, limit) * k
    for triangle in pixels.reshape(-1, 6).round().tolist():
        draw.polygon(triangle, fill=1)
    return np.array(canvas, dtype=bool)[::k, ::k].copy()


def overlap(a: Mask, b: Mask) -> float:
    """Intersection over union of two masks, in [0, 1]; 0 where both are empty."""
    union = np.count_nonzero(a | b)
    return np.count_nonzero(a & b) / union if union else 0.0


def best_owner(outline: Mask, masks: Sequence[Mask]) -> int:
    """Index of the mask that an outline overlaps most; of the nearest one where it overlaps none."""
    shares = [overlap(outline, mask) for mask in masks]
    if max(shares) > 0:
        return int(np.argmax(shares))
    centres = [_centre(mask) for mask in masks]
    return int(np.argmin([np.linalg.norm(_centre(outline) - c) for c in centres]))


def _centre(mask: Mask) -> Float:
    """Mean (v, u) of a mask [px]; the image's middle where it is empty."""
    v, u = np.nonzero(mask)
    return np.array([v.mean(), u.mean()]) if len(v) else np.array(mask.shape) / 2
