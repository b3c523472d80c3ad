"""How much larger than its model in a known pose an object appears in the image, and how far beside it.

The outline of an object's mask is laid over that of the drawn model by a shift and one factor of size. Outlines are
compared, not areas, so that what hides a part of the object, or the border of the image, costs nothing but that part of
the outline; and how well they then lie on each other tells a mask of another shape from one of another size. Then width
and height get a factor each: where one focal length alone is wrong, the mask is of another shape otherwise.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from verefine_viz.core.arrays import Float, Mask
from verefine_viz.core.camera import Camera
from verefine_viz.core.model import ObjectModel
from verefine_viz.scenes.drawn_model import POINTS, Drawn, depth_ratio, drawn_model, in_drawing, share_alike

CROSS = np.array([[0, 1, 0], [1, 1, 1], [0, 1, 0]], np.bool_)
"""A pixel with its neighbours."""
FEWEST = 30
"""With fewer there is no telling."""
STEP_M = 0.015
"""What is nearer than the object beside it by more than this hides a part of it [m]."""
BORDER_PX = 3
"""The outline this near to the image's border, or to what hides the object, is not the object's own."""
STEPS = 15
"""Least-squares steps at the most; five to seven are enough where the outlines are alike."""
LONGEST_STEP = 0.15
"""In one step the factor changes by no larger share, the place by no larger share of the object's size."""
WORST_CONDITION = 1e6
"""Of the least squares: beyond it nothing holds the factor or the place."""
LEVEL = 1e-9
"""Keeps what has no slope from dividing by nothing: places as near to one part of an outline as to another."""
ALIKE = np.array([[1, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], np.float64)
"""One factor for width and height, and the place."""
SIDES = np.eye(4)
"""Width and height, each by itself, and the place."""
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
    box_px: Float
    """(2,) its width and height."""
    error: float
    """The factor is certain up to about this share: how far apart the outlines still are, and how well what is seen of
    them holds the factor."""
    sides: Float
    """(2,) the mask is so many times as wide, and as high, where the two may differ."""
    sides_error: float
    """Both are certain up to about this share."""
    depth: float
    """Measured depth over drawn depth at the same places (median); NaN where there is none, or no common ratio."""
    gain: float
    """So much more of the drawn depth was measured where the mask has the object than where the model is drawn."""


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
    drawn, box = drawn_model(model, T_cam_obj, camera), _box(mask)
    if drawn is None or box is None:
        return None
    places = _own_outline(mask, others, depth_m, box)
    if len(places) < FEWEST:
        return None
    places = places[np.linspace(0, len(places) - 1, min(POINTS, len(places))).astype(int)]
    v, u = np.nonzero(mask[box])
    inside = np.stack([u + box[1].start, v + box[0].start], axis=1)
    size = np.sqrt(len(inside)) / drawn.size_px
    start = np.clip([size, size], 0.5, 2.0), inside.mean(axis=0) - drawn.middle_px
    alike = _fit(drawn, places, *start, ALIKE)
    if alike is None:
        return None
    sides = _fit(drawn, places, alike.factors, alike.shift_px, SIDES)
    better = alike if sides is None else sides
    return Likeness(
        factor=float(alike.factors[0]),
        shift_px=alike.shift_px,
        middle_px=drawn.middle_px,
        size_px=drawn.size_px,
        box_px=drawn.box_px,
        error=float(alike.errors[0]),
        sides=better.factors,
        sides_error=float("inf") if sides is None else float(np.max(sides.errors[:2])),
        depth=depth_ratio(drawn, inside, alike.factors, alike.shift_px, depth_m),
        gain=share_alike(drawn, alike.shift_px, depth_m) - share_alike(drawn, np.zeros(2), depth_m),
    )


@dataclass(frozen=True, eq=False)
class _Fit:
    """What lays a drawn model's outline over places of another."""

    factors: Float
    """(2,) so many times as wide and as high."""
    shift_px: Float
    """(2,)"""
    errors: Float
    """(k,) what each of the parameters is uncertain by."""


def _fit(drawn: Drawn, places: Float, factors: Float, shift_px: Float, freedom: Float) -> _Fit | None:
    """Least squares of the distances of places (N, 2); None where nothing holds the result.

    Args:
        drawn: the model.
        places: (N, 2) of the other outline [px].
        factors: (2,) to begin with.
        shift_px: (2,) to begin with.
        freedom: (4, k) how width, height (logarithms) and shift (in sizes of the model) follow from the parameters.
    """
    for _ in range(STEPS):
        residuals, slopes = _residuals(drawn, places, factors, shift_px)
        slopes = slopes @ freedom
        weights = 1.0 / np.sqrt(1.0 + (residuals / OUTLIER) ** 2)
        system = (slopes * weights[:, None]).T @ slopes
        if np.linalg.cond(system) > WORST_CONDITION:
            return None
        step = np.clip(np.linalg.solve(system, -slopes.T @ (weights * residuals)), -LONGEST_STEP, LONGEST_STEP)
        change = freedom @ step
        factors, shift_px = factors * np.exp(change[:2]), shift_px + change[2:] * drawn.size_px
        if np.abs(step).max() < 1e-4:
            break
    residuals, slopes = _residuals(drawn, places, factors, shift_px)
    slopes = slopes @ freedom
    system = slopes.T @ slopes
    if np.linalg.cond(system) > WORST_CONDITION:
        return None
    errors = float(np.linalg.norm(residuals)) * np.sqrt(np.diag(np.linalg.inv(system)))
    return _Fit(factors, shift_px, np.asarray(errors, np.float64))


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


def _residuals(drawn: Drawn, places: Float, factors: Float, shift_px: Float) -> tuple[Float, Float]:
    """How far places (N, 2) lie outside of the enlarged and shifted outline, and how that changes.

    Returns:
        (N,) distances in sizes of the drawn model, and (N, 4) their slopes with the factors' logarithms and the shift.
    """
    at = in_drawing(drawn, places, factors, shift_px)
    distance, along_u, along_v = (ndimage.map_coordinates(one, at, order=1, mode="nearest") for one in drawn.outside)
    slope = np.stack([along_u, along_v], axis=1)
    enlarged = slope / factors
    # So many pixels across the enlarged outline are one across that of the drawing.
    across = (np.linalg.norm(slope, axis=1) + LEVEL) / (np.linalg.norm(enlarged, axis=1) + LEVEL)
    normal = enlarged * across[:, None]
    share = enlarged**2 / (np.sum(enlarged**2, axis=1) + LEVEL)[:, None]
    arm = places - drawn.middle_px - shift_px
    by_factors = ((across * distance)[:, None] * share - normal * arm) / drawn.size_px
    # The last pixels of a mask lie half a pixel inside of its outline.
    return (across * distance + 0.5) / drawn.size_px, np.concatenate([by_factors, -normal], axis=1)
