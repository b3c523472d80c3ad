"""A model drawn by itself in a known pose: its outline, and measured depth beside its own.

What is seen beside it, larger or smaller by a factor for each side, is brought to the drawing and compared there.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from verefine_viz.core.arrays import Float, Mask
from verefine_viz.core.camera import Camera
from verefine_viz.core.geometry import apply
from verefine_viz.core.model import ObjectModel
from verefine_viz.rendering.mesh import RenderMesh, render_mesh
from verefine_viz.rendering.rasterizer import draw_depth

SIDE = 96
"""Pixels along the longer side of the drawn model; finer ones change the factor by less than 0.002."""
MARGIN = 30
"""Pixels around it, in which distances to its outline are known."""
NEAR_M = 0.05
"""Models that come nearer to the camera than this are not drawn [m]."""
SAME_DEPTH = 0.03
"""Ratios of depths that differ by less are the same."""
MOST_OF = 0.5
"""Share of the mask's pixels that must have the same ratio of depths: depth of something else has none."""
POINTS = 200
"""Places of an outline, or pixels, that are looked at."""


@dataclass(frozen=True, eq=False)
class Drawn:
    """A model in its pose, drawn by itself."""

    depth_m: NDArray[np.float32]
    """(h, w) 0 beside the model."""
    outside: Float
    """(3, h, w) distance to its outline, negative inside [px of the camera], and its slope along columns and rows."""
    corner_px: Float
    """(2,) where its first pixel is in the camera's image."""
    pitch: float
    """Camera pixels per pixel."""
    middle_px: Float
    """(2,)"""
    size_px: float
    """Square root of its area."""
    box_px: Float
    """(2,) width and height."""


def drawn_model(model: ObjectModel, T_cam_obj: Float, camera: Camera) -> Drawn | None:
    """A model in its pose (4, 4); None where nothing of it is in front of the camera, or it is too near."""
    points_cam = apply(T_cam_obj, model.vertices)
    if points_cam[:, 2].min() < NEAR_M:
        return None
    pixels = camera.project(points_cam)
    low, high = pixels.min(axis=0), pixels.max(axis=0)
    pitch = float((high - low).max()) / SIDE
    corner = low - MARGIN * pitch
    width, height = (np.ceil((high - low) / pitch).astype(int) + 2 * MARGIN).tolist()
    depth_m = np.zeros((height, width), np.float32)
    cx, cy = (np.array([camera.cx, camera.cy]) - corner) / pitch
    pinhole = camera.fx / pitch, camera.fy / pitch, cx, cy
    draw_depth(np.ascontiguousarray(T_cam_obj), *_mesh(model).arrays, *pinhole, depth_m)
    shown = depth_m > 0
    if not shown.any():
        return None
    # Half a pixel less on either side: the outline runs between pixels.
    distance = np.where(shown, 0.5 - _distances(shown), _distances(~shown) - 0.5) * pitch
    along_v, along_u = np.gradient(distance, pitch)
    v, u = np.nonzero(shown)
    middle = np.array([u.mean(), v.mean()]) * pitch + corner
    outside, size_px = np.stack([distance, along_u, along_v]), float(np.sqrt(len(u))) * pitch
    box_px: Float = np.array([np.ptp(u) + 1.0, np.ptp(v) + 1.0]) * pitch
    return Drawn(depth_m, outside, corner, pitch, middle, size_px, box_px)


@lru_cache(maxsize=64)
def _mesh(model: ObjectModel) -> RenderMesh:
    return render_mesh(model.vertices, model.faces)


def _distances(mask: Mask) -> Float:
    """(H, W) how far each of its pixels is from the nearest pixel beside it [px]."""
    return np.asarray(ndimage.distance_transform_edt(mask), np.float64)


def in_drawing(drawn: Drawn, places: NDArray, factors: Float, shift_px: Float) -> Float:
    """Rows and columns (2, N) of the drawing where pixels (N, 2) of the camera's image come to lie."""
    pixels = (places - drawn.middle_px - shift_px) / factors + drawn.middle_px
    return ((pixels - drawn.corner_px) / drawn.pitch).T[::-1]


def depth_ratio(
    drawn: Drawn, inside: NDArray[np.integer], factors: Float, shift_px: Float, depth_m: NDArray[np.float32]
) -> float:
    """Measured over drawn depth (median) at pixels (N, 2) of a mask that lies over the enlarged and shifted model."""
    some = inside[:: max(1, len(inside) // POINTS)]
    rows, columns = np.rint(in_drawing(drawn, some, factors, shift_px)).astype(int)
    height, width = drawn.depth_m.shape
    rows, columns = np.clip(rows, 0, height - 1), np.clip(columns, 0, width - 1)
    u, v = some.T
    measured, shown = depth_m[v, u], drawn.depth_m[rows, columns]
    both = (measured > 0) & (shown > 0)
    ratios = measured[both] / shown[both]
    median = float(np.median(ratios)) if len(ratios) else 0.0
    alike = np.count_nonzero(np.abs(ratios - median) < SAME_DEPTH * median)
    return median if alike > MOST_OF * len(some) else float("nan")


def share_alike(drawn: Drawn, shift_px: Float, depth_m: NDArray[np.float32]) -> float:
    """Share of the measured depth that is that of the drawn model, moved by ``shift_px`` (2,); 0 without any."""
    rows, columns = np.nonzero(drawn.depth_m)
    some = slice(None, None, max(1, len(rows) // POINTS))
    shown = drawn.depth_m[rows[some], columns[some]]
    places = np.stack([columns[some], rows[some]]).T * drawn.pitch + drawn.corner_px + shift_px
    u, v = np.rint(places).astype(int).T
    height, width = depth_m.shape
    inner = (u >= 0) & (v >= 0) & (u < width) & (v < height)
    measured, shown = depth_m[v[inner], u[inner]], shown[inner]
    near = np.abs(measured - shown)[measured > 0] < SAME_DEPTH * shown[measured > 0]
    return float(near.mean()) if len(near) else 0.0
