"""The small picture of a model alone, from the front and a little above, for choosing a model."""

from __future__ import annotations

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.camera import Camera
from verefine_viz.core.geometry import axis_angle, transform
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.problem import Placed
from verefine_viz.pictures.answer_pictures import webp
from verefine_viz.rendering.rendered_scene import render_scene

SIZE_PX = 96
FOCAL_PX = 260.0
ABOVE_DEG, BESIDE_DEG = 25.0, 30.0
"""Direction of the view: elevation above the model's horizon, azimuth from its front (−y)."""
FINER = 2
"""Oversampling: drawn this many times finer, then reduced, for smooth edges."""
PAPER = 255


def model_picture(model: ObjectModel) -> bytes:
    """The picture, as WebP; z of the model is up."""
    low, high = model.vertices.min(axis=0), model.vertices.max(axis=0)
    radius_m = max(float(np.linalg.norm(high - low)) / 2, 1e-6)
    distance_m = 2 * radius_m * FOCAL_PX / SIZE_PX * 1.15
    size, focal = SIZE_PX * FINER, FOCAL_PX * FINER
    camera = Camera(np.array([[focal, 0, size / 2], [0, focal, size / 2], [0, 0, 1.0]]), size, size)
    seen = render_scene([Placed(0, model, _pose(low, high, distance_m))], camera)
    rgb = np.where(seen.labels[..., None] >= 0, seen.rgb, np.uint8(PAPER))
    small = rgb.reshape(SIZE_PX, FINER, SIZE_PX, FINER, 3).mean(axis=(1, 3))
    return webp(small.astype(np.uint8))


def _pose(low: Float, high: Float, distance_m: float) -> Float:
    upright = np.array([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]])  # z of the model is the image's up.
    turned = upright @ axis_angle(np.array([0.0, 0, 1.0]), float(np.radians(BESIDE_DEG)))
    R = axis_angle(np.array([1.0, 0, 0]), float(np.radians(ABOVE_DEG))) @ turned
    return transform(R, np.array([0, 0, distance_m]) - R @ ((low + high) / 2))
