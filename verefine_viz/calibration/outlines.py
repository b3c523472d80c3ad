"""Measures how much larger than its model in a known pose an object appears in the image, and how far beside it.

A shift and a factor of size lay the outline of the drawn model over that of the object's mask. Outlines are compared,
not areas: what hides a part of the object, or the border of the image, then costs only that part of the outline. How
well the outlines agree after the fit tells a mask of another shape from one of another size. In a second fit, width and
height get a factor each: where one focal length alone is wrong, the mask is of another shape.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage, optimize

from verefine_viz.calibration.seen_object import mesh_of
from verefine_viz.core.arrays import Float, Mask, writable
from verefine_viz.core.camera import Camera
from verefine_viz.core.geometry import apply
from verefine_viz.core.model import ObjectModel
from verefine_viz.rendering.rasterizer import draw_depth

SIDE, MARGIN = 96, 30
"""Pixels along the longer side of the drawn model; and pixels around it in which distances to its outline are known."""
FEWEST, POINTS, OUTLIER = 30, 200, 0.01
"""Fewest and most places on an outline that are compared; and distance, a share of size, from which they count less."""
SAME_DEPTH, MOST_OF = 0.03, 0.5
"""Share by which equal ratios of depth may differ; and least share of the pixels that must agree on one."""
STEP_M, BORDER_PX = 0.015, 3
"""What is nearer than the object by more than this hides it [m]; and distance from such a place, or from the border,
within which the outline is not the object's own."""


@dataclass(frozen=True, eq=False)
class DrawnModel:
    """A model in its pose, drawn by itself; lengths and places (u, v) are in pixels of the camera's image."""

    depth_m: NDArray[np.float32]  # (h, w), 0 beside the model
    outside: Float  # (3, h, w) distance to its outline, negative inside, and its slopes along u and v
    pitch: float  # of a pixel of the drawing
    corner_px: Float  # (2,) of its first pixel
    middle_px: Float  # (2,) of the model's pixels
    size_px: float  # square root of the model's area
    box_px: Float  # (2,) the model's width and height

    def rows_columns(self, places: NDArray, factors: Float, shift_px: Float) -> Float:
        """Rows and columns (2, N) in the drawing, enlarged and shifted, of pixels (N, 2) of the camera's image."""
        pixels = (places - self.middle_px - shift_px) / factors + self.middle_px
        return ((pixels - self.corner_px) / self.pitch).T[::-1]


@dataclass(frozen=True, eq=False)
class OutlineFit:
    """Shift and factor that lay the outline of a drawn model over that of a mask; errors are shares."""

    drawn: DrawnModel
    camera: Camera
    origin_px: Float  # (2,) where the model's origin is seen
    shift_px: Float  # (2,) from the middle of the drawn model to the middle of the mask
    factor: float  # size of the mask over size of the drawing
    error: float  # of the factor
    depth: float  # measured over drawn depth at the same places (median); NaN without any, or without a common ratio
    gain: float  # share of the drawn depth that was measured where the mask is, less the share where the model is
    fit_sides: Callable[[], tuple[Float, Float]]  # logarithms of width, height and shift, and their errors

    @cached_property
    def _fitted(self) -> tuple[Float, Float]:
        return self.fit_sides()

    @property
    def sides(self) -> Float:
        """(2,) width and height of the mask over those of the drawing, fitted apart, when asked for."""
        return np.exp(self._fitted[0][:2])

    @property
    def sides_error(self) -> float:
        """The larger error of the two sides."""
        return float(max(self._fitted[1][:2]))


def fit_outline(
    model: ObjectModel, T_cam_obj: Float, camera: Camera, mask: Mask, others: Mask, depth_m: NDArray[np.float32]
) -> OutlineFit | None:
    """How an object's ``mask`` (H, W) lies over its model at ``T_cam_obj`` (4, 4); None where too little is seen.

    ``others`` (H, W) are pixels of other objects, which may hide it; ``depth_m`` (H, W) is 0 where unmeasured.
    """
    drawn = _draw(model, T_cam_obj, camera)
    places = _own_outline(mask, others, depth_m) if mask.any() else np.zeros((0, 2))
    if drawn is None or len(places) < FEWEST:
        return None
    places = places[np.linspace(0, len(places) - 1, min(POINTS, len(places))).astype(int)]
    inside = np.argwhere(mask)[:, ::-1]

    def distances(x: Float) -> Float:
        """Distances (N,) of places to the drawn outline, enlarged by ``np.exp(x[:2])`` and shifted, in sizes of it."""
        at = drawn.rows_columns(places, np.exp(x[:2]), x[2:] * drawn.size_px)
        outside_px, *slope = (ndimage.map_coordinates(one, at, order=1, mode="nearest") for one in drawn.outside)
        # Pixels across the enlarged outline for one pixel across that of the drawing.
        across = (np.hypot(*slope) + 1e-9) / (np.hypot(*(slope / np.exp(x[:2])[:, None])) + 1e-9)
        # The last pixels of a mask lie half a pixel inside of its outline.
        return (across * outside_px + 0.5) / drawn.size_px

    size = np.log(np.clip(np.sqrt(len(inside)) / drawn.size_px, 0.5, 2.0))
    start = np.array([size, *(inside.mean(axis=0) - drawn.middle_px) / drawn.size_px])
    x, errors = _least_squares(lambda x: distances(x[[0, 0, 1, 2]]), start)
    factor, shift_px = float(np.exp(x[0])), x[1:] * drawn.size_px
    depth = _depth_ratio(drawn, inside, factor, shift_px, depth_m)
    gain = _share_measured(drawn, shift_px, depth_m) - _share_measured(drawn, np.zeros(2), depth_m)
    origin_px, error = camera.project(T_cam_obj[:3, 3]), float(errors[0])

    def fit_sides() -> tuple[Float, Float]:
        return _least_squares(distances, x[[0, 0, 1, 2]])

    return OutlineFit(drawn, camera, origin_px, shift_px, factor, error, depth, gain, fit_sides)


def _least_squares(residuals: Callable[[Float], Float], start: Float) -> tuple[Float, Float]:
    """Parameters (k,) and the error of each; infinite where the places do not determine them."""
    x = optimize.least_squares(residuals, start, loss="soft_l1", f_scale=OUTLIER, max_nfev=60).x
    slopes = np.stack([(residuals(x + step) - residuals(x - step)) / 2e-3 for step in 1e-3 * np.eye(len(x))], axis=1)
    system = slopes.T @ slopes
    if np.linalg.cond(system) > 1e6:
        return x, np.full(len(x), np.inf)
    return x, float(np.linalg.norm(residuals(x))) * np.sqrt(np.diag(np.linalg.inv(system)))


def _draw(model: ObjectModel, T_cam_obj: Float, camera: Camera) -> DrawnModel | None:
    """Draw a model in its pose; None where no part is in front of the camera, or some part is too near."""
    points_cam = apply(T_cam_obj, model.vertices)
    if points_cam[:, 2].min() < 0.05 or T_cam_obj[2, 3] <= 0:
        return None
    pixels = camera.project(points_cam)
    low, high = pixels.min(axis=0), pixels.max(axis=0)
    pitch = float((high - low).max()) / SIDE
    corner_px = low - MARGIN * pitch
    width, height = (np.ceil((high - low) / pitch).astype(int) + 2 * MARGIN).tolist()
    depth_m = np.zeros((height, width), np.float32)
    fx, fy, cx, cy = (np.array([camera.fx, camera.fy, *(camera.K[:2, 2] - corner_px)]) / pitch).tolist()
    draw_depth(writable(T_cam_obj), *mesh_of(model).arrays, fx, fy, cx, cy, depth_m)
    shown = depth_m > 0
    if not shown.any():
        return None
    # Half a pixel less on either side: the outline runs between pixels.
    inner, outer = (np.asarray(ndimage.distance_transform_edt(m), np.float64) for m in (shown, ~shown))
    outside_px = np.where(shown, 0.5 - inner, outer - 0.5) * pitch
    outside = np.stack([outside_px, *np.gradient(outside_px, pitch)[::-1]])
    places = np.argwhere(shown)[:, ::-1] * pitch
    middle_px, box_px = places.mean(axis=0) + corner_px, np.ptp(places, axis=0) + pitch
    return DrawnModel(depth_m, outside, pitch, corner_px, middle_px, float(np.sqrt(len(places))) * pitch, box_px)


def _own_outline(mask: Mask, others: Mask, depth_m: NDArray[np.float32]) -> Float:
    """Pixels (N, 2) = (u, v) of a mask's outline where the object itself ends, rather than the part that is seen."""
    pixels = np.argwhere(mask)
    corner = np.maximum(pixels.min(axis=0) - 3 * BORDER_PX, 0)
    box = tuple(slice(*ends) for ends in zip(corner, pixels.max(axis=0) + 3 * BORDER_PX + 1, strict=True))
    own, measured_m, size = mask[box], depth_m[box], 2 * BORDER_PX + 1
    around_m = ndimage.minimum_filter(np.where(own & (measured_m > 0), measured_m, np.inf), size)
    is_nearer = (measured_m > 0) & (measured_m < around_m - STEP_M)
    is_farther = measured_m > around_m + 2 * STEP_M
    hiding = ~own & (is_nearer | (others[box] & ~is_farther))
    is_beside_hiding = np.asarray(ndimage.maximum_filter(hiding, size), np.bool_)
    is_surrounded = np.asarray(ndimage.binary_erosion(own), np.bool_)
    places = np.argwhere(own & ~is_surrounded & ~is_beside_hiding) + corner
    is_inner = ((places >= BORDER_PX) & (places < np.array(mask.shape) - BORDER_PX)).all(axis=1)
    return places[is_inner, ::-1].astype(np.float64)


def _depth_ratio(
    drawn: DrawnModel, inside: NDArray[np.integer], factor: float, shift_px: Float, depth_m: NDArray[np.float32]
) -> float:
    """Median of measured over drawn depth at pixels (N, 2) of a mask, with the model enlarged and shifted onto it."""
    some = inside[:: max(1, len(inside) // POINTS)]
    at = np.rint(drawn.rows_columns(some, np.full(2, factor), shift_px)).astype(int)
    rows, columns = np.clip(at.T, 0, np.array(drawn.depth_m.shape) - 1).T
    measured, shown = depth_m[some[:, 1], some[:, 0]], drawn.depth_m[rows, columns]
    ratios = measured[(measured > 0) & (shown > 0)] / shown[(measured > 0) & (shown > 0)]
    median = float(np.median(ratios)) if len(ratios) else 0.0
    n_alike = np.count_nonzero(np.abs(ratios - median) < SAME_DEPTH * median)
    return median if n_alike > MOST_OF * len(some) else float("nan")


def _share_measured(drawn: DrawnModel, shift_px: Float, depth_m: NDArray[np.float32]) -> float:
    """Share of the measured depth that agrees with the drawn model, moved by ``shift_px`` (2,); 0 without any."""
    some = np.argwhere(drawn.depth_m > 0)
    some = some[:: max(1, len(some) // POINTS)]
    places = np.rint(some[:, ::-1] * drawn.pitch + drawn.corner_px + shift_px).astype(int)[:, ::-1]
    is_inside = ((places >= 0) & (places < depth_m.shape)).all(axis=1)
    measured, shown = depth_m[tuple(places[is_inside].T)], drawn.depth_m[tuple(some[is_inside].T)]
    is_near = np.abs(measured - shown)[measured > 0] < SAME_DEPTH * shown[measured > 0]
    return float(is_near.mean()) if len(is_near) else 0.0
