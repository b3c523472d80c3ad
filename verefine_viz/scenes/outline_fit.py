"""How much larger than its model in a known pose an object appears in the image, and how far beside it.

The outline of an object's mask is laid over that of the drawn model by a shift and one factor of size. Outlines are
compared, not areas, so that what hides a part of the object, or the border of the image, costs nothing but that part of
the outline; and how well they then lie on each other tells a mask of another shape from one of another size.
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
CROSS = np.array([[0, 1, 0], [1, 1, 1], [0, 1, 0]], np.bool_)
"""A pixel with its neighbours."""
POINTS = 200
"""Places of the mask's outline that are looked at."""
FEWEST = 30
"""With fewer there is no telling."""
NEAR_M = 0.05
"""Models that come nearer to the camera than this are not drawn [m]."""
STEP_M = 0.015
"""What is nearer than the object beside it by more than this hides a part of it [m]."""
BORDER_PX = 3
"""The outline this near to the image's border, or to what hides the object, is not the object's own."""
SAME_DEPTH = 0.03
"""Ratios of depths that differ by less are the same."""
MOST_OF = 0.5
"""Share of the mask's pixels that must have the same ratio of depths: depth of something else has none."""
STEPS = 15
"""Least-squares steps at the most; five to seven are enough where the outlines are alike."""
LONGEST_STEP = 0.15
"""In one step the factor changes by no larger share, the place by no larger share of the object's size."""
WORST_CONDITION = 1e6
"""Of the least squares: beyond it nothing holds the factor or the place."""
OUTLIER = 0.01
"""Places that lie further off than this count less; a share of the object's size, as all lengths in the fit."""


@dataclass(frozen=True, eq=False)
class Likeness:
    """What lays the outline of a drawn model over that of a mask."""

    factor: float
    """The mask is so many times as large."""
    shift_px: Float
    """(2,) of the drawn model's middle to where the mask has it (u, v)."""
    middle_px: Float
    """(2,) of the drawn model."""
    size_px: float
    """Square root of the area of the drawn model."""
    error: float
    """The factor is certain up to about this share: how far apart the outlines still are, and how well what is seen of
    them holds the factor."""
    depth: float
    """Measured depth over drawn depth at the same places (median); NaN where there is none, or no common ratio."""


@dataclass(frozen=True, eq=False)
class _Drawn:
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
    size_px: float


def likeness(
    model: ObjectModel, T_cam_obj: Float, camera: Camera, mask: Mask, others: Mask, depth_m: NDArray[np.float32]
) -> Likeness | None:
    """How a mask lies over a model in its pose; None where too little is seen of its outline.

    Args:
        model: of the object.
        T_cam_obj: (4, 4) its pose.
        camera: of the image.
        mask: (H, W) the object's visible pixels, or all of them.
        others: (H, W) pixels of other objects.
        depth_m: (H, W) as measured, 0 where nothing was.
    """
    drawn, box = _draw(model, T_cam_obj, camera), _box(mask)
    if drawn is None or box is None:
        return None
    places = _own_outline(mask, others, depth_m, box)
    if len(places) < FEWEST:
        return None
    places = places[np.linspace(0, len(places) - 1, min(POINTS, len(places))).astype(int)]
    v, u = np.nonzero(mask[box])
    inside = np.stack([u + box[1].start, v + box[0].start], axis=1)
    factor = float(np.clip(np.sqrt(len(inside)) / drawn.size_px, 0.5, 2.0))
    shift = inside.mean(axis=0) - drawn.middle_px
    for _ in range(STEPS):
        residuals, slopes = _residuals(drawn, places, factor, shift)
        weights = 1.0 / np.sqrt(1.0 + (residuals / OUTLIER) ** 2)
        system = (slopes * weights[:, None]).T @ slopes
        if np.linalg.cond(system) > WORST_CONDITION:
            return None
        step = np.clip(np.linalg.solve(system, -slopes.T @ (weights * residuals)), -LONGEST_STEP, LONGEST_STEP)
        factor, shift = factor * float(np.exp(step[0])), shift + step[1:] * drawn.size_px
        if np.abs(step).max() < 1e-4:
            break
    residuals, slopes = _residuals(drawn, places, factor, shift)
    system = slopes.T @ slopes
    if np.linalg.cond(system) > WORST_CONDITION:
        return None
    error = float(np.linalg.norm(residuals) * np.sqrt(np.linalg.inv(system)[0, 0]))
    depth = _depth_ratio(drawn, inside, factor, shift, depth_m)
    return Likeness(factor, shift, drawn.middle_px, drawn.size_px, error, depth)


def _draw(model: ObjectModel, T_cam_obj: Float, camera: Camera) -> _Drawn | None:
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
    return _Drawn(
        depth_m, np.stack([distance, along_u, along_v]), corner, pitch, middle, float(np.sqrt(len(u))) * pitch
    )


@lru_cache(maxsize=64)
def _mesh(model: ObjectModel) -> RenderMesh:
    return render_mesh(model.vertices, model.faces)


def _distances(mask: Mask) -> Float:
    """(H, W) how far each of its pixels is from the nearest pixel beside it [px]."""
    return np.asarray(ndimage.distance_transform_edt(mask), np.float64)


def _box(mask: Mask) -> tuple[slice, slice] | None:
    """Rows and columns of a mask and of what is around it; None where it is empty."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if len(rows) == 0:
        return None
    reach = 3 * BORDER_PX
    top, left = max(int(rows[0]) - reach, 0), max(int(columns[0]) - reach, 0)
    return slice(top, int(rows[-1]) + reach + 1), slice(left, int(columns[-1]) + reach + 1)


def _own_outline(mask: Mask, others: Mask, depth_m: NDArray[np.float32], box: tuple[slice, slice]) -> Float:
    """Pixels (N, 2) = (u, v) of a mask's outline where the object itself ends, not what is seen of it."""
    own, other, measured_m = mask[box], others[box] & ~mask[box], depth_m[box]
    known = measured_m > 0
    around_m = ndimage.minimum_filter(np.where(own & known, measured_m, np.inf), 2 * BORDER_PX + 1)
    is_nearer = known & (measured_m < around_m - STEP_M)
    is_farther = known & (measured_m > around_m + 2 * STEP_M)
    hiding = ~own & (is_nearer | (other & ~is_farther))
    beside_hiding = np.asarray(ndimage.maximum_filter(hiding, 2 * BORDER_PX + 1), np.bool_)
    surrounded = np.asarray(ndimage.minimum_filter(own, footprint=CROSS), np.bool_)
    outline = own & ~surrounded & ~beside_hiding
    v, u = np.nonzero(outline)
    v, u = v + box[0].start, u + box[1].start
    height, width = mask.shape
    inner = (u >= BORDER_PX) & (v >= BORDER_PX) & (u < width - BORDER_PX) & (v < height - BORDER_PX)
    return np.stack([u[inner], v[inner]], axis=1).astype(np.float64)


def _in_drawing(drawn: _Drawn, places: NDArray, factor: float, shift: Float) -> Float:
    """Rows and columns (2, N) of the drawing where pixels (N, 2) of the camera's image come to lie."""
    pixels = (places - drawn.middle_px - shift) / factor + drawn.middle_px
    return ((pixels - drawn.corner_px) / drawn.pitch).T[::-1]


def _residuals(drawn: _Drawn, places: Float, factor: float, shift: Float) -> tuple[Float, Float]:
    """How far places (N, 2) lie outside of the enlarged and shifted outline, and how that changes.

    Returns:
        (N,) distances in sizes of the drawn model, and (N, 3) their slopes with the factor's logarithm and the shift.
    """
    at = _in_drawing(drawn, places, factor, shift)
    distance, along_u, along_v = (ndimage.map_coordinates(one, at, order=1, mode="nearest") for one in drawn.outside)
    arm = places - drawn.middle_px - shift
    by_factor = factor * distance - along_u * arm[:, 0] - along_v * arm[:, 1]
    slopes = np.stack([by_factor / drawn.size_px, -along_u, -along_v], axis=1)
    # The last pixels of a mask lie half a pixel inside of its outline.
    return (factor * distance + 0.5) / drawn.size_px, slopes


def _depth_ratio(
    drawn: _Drawn, inside: NDArray[np.integer], factor: float, shift: Float, depth_m: NDArray[np.float32]
) -> float:
    some = inside[:: max(1, len(inside) // POINTS)]
    rows, columns = np.rint(_in_drawing(drawn, some, factor, shift)).astype(int)
    height, width = drawn.depth_m.shape
    rows, columns = np.clip(rows, 0, height - 1), np.clip(columns, 0, width - 1)
    u, v = some.T
    measured, shown = depth_m[v, u], drawn.depth_m[rows, columns]
    both = (measured > 0) & (shown > 0)
    ratios = measured[both] / shown[both]
    median = float(np.median(ratios)) if len(ratios) else 0.0
    alike = np.count_nonzero(np.abs(ratios - median) < SAME_DEPTH * median)
    return median if alike > MOST_OF * len(some) else float("nan")
