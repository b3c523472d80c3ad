"""Pictures of an answer: the camera's image with contours, and the depth that the answer leaves unexplained."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image as PilImage

from verefine_viz.core.arrays import Float
from verefine_viz.core.palette import CLASS_COLORS, RGB, SIDE_COLORS, STAGE_COLORS, Image, difference_scale
from verefine_viz.core.problem import Placed, Target
from verefine_viz.rendering.contours import (
    HEIGHT_PX,
    WIDTH_PX,
    Window,
    background,
    data_uri,
    outline,
    window_around,
)
from verefine_viz.rendering.rendered_scene import render_scene


@dataclass(frozen=True)
class Pictures:
    """Two images as data URIs."""

    camera: str
    """With the contours of the answers and of the ground truth."""
    depth: str
    """Observed − rendered depth of the first answer over the grey image."""


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
    behind = background(target, window)
    drawn = [render_scene([Placed(0, target.model, T)], camera) for T in poses]
    seen = behind.copy()
    if T_gt is not None:
        outline(seen, drawn[-1].labels >= 0, STAGE_COLORS["ground truth"])
    for (_, kind), rendering in zip(answers, drawn, strict=False):
        outline(seen, rendering.labels >= 0, color_of(kind))
    rendered_m = drawn[0].depth_m if answers else np.zeros((HEIGHT_PX, WIDTH_PX), np.float32)
    difference = _difference(behind, _resized_depth(target, window), rendered_m, tau_m)
    return Pictures(data_uri(seen), data_uri(difference))


def color_of(kind: str) -> RGB:
    """The contour's colour of an answer."""
    return SIDE_COLORS[kind] if kind in SIDE_COLORS else STAGE_COLORS["accepted"]


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
