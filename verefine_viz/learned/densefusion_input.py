"""Input of DenseFusion for an object: a crop of the image, and points of its mask. docs/methods.md 5.2.

Prepared as in the official implementation, which the official weights need: sides of the crop in steps of 40 pixels,
colours from 0 to 255 shifted and scaled by numbers that were meant for 0 to 1.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.arrays import Mask
from verefine_viz.core.camera import Camera

BORDER_PX = 40
"""Step of a crop's sides [px], which are multiples of it."""
MEAN = np.array([0.485, 0.456, 0.406], np.float32)
STD = np.array([0.229, 0.224, 0.225], np.float32)


@dataclass(frozen=True, eq=False)
class ImageWindow:
    """A window of an image; it may reach beyond a smaller image."""

    top: int
    left: int
    height: int
    width: int


@dataclass(frozen=True, eq=False)
class ObjectCrop:
    """One object as input of the networks."""

    image: NDArray[np.float32]
    """(1, 3, h, w) normalised; what lies beyond the image is black."""
    points: NDArray[np.float32]
    """(1, N, 3) points of the mask in the camera's frame [m]."""
    chosen: NDArray[np.int64]
    """(N,) indices of the points in the flattened crop."""
    n_distinct: int
    """Number of distinct points, which come first; points of a small mask are repeated."""


def window_around(mask: Mask) -> ImageWindow:
    """The window around the pixels of a mask (H, W), of which there is at least one."""
    rows, columns = (np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0))
    top, height = _span(int(rows[0]), int(rows[-1]) + 1, mask.shape[0])
    left, width = _span(int(columns[0]), int(columns[-1]) + 1, mask.shape[1])
    return ImageWindow(top, left, height, width)


def _span(first: int, end: int, length: int) -> tuple[int, int]:
    """Start and size along one axis: the next multiple, about the same middle, shifted into the image."""
    size = -(-(end - first) // BORDER_PX) * BORDER_PX
    start = (first + end) // 2 - size // 2
    return max(0, min(start, length - size)), size


def crop_of(
    rgb: NDArray[np.uint8],
    depth_m: NDArray[np.float32],
    mask: Mask,
    camera: Camera,
    n_points: int,
    seed: int | tuple[int, ...],
) -> ObjectCrop | None:
    """The crop of an object; None where its mask holds no depth.

    Args:
        rgb: (H, W, 3).
        depth_m: (H, W) [m]; 0 where nothing was measured.
        mask: (H, W) the object's pixels.
        camera: intrinsics.
        n_points: how many points; a larger mask gives a random choice, a smaller one repeats its points, both in the
            order of the image.
        seed: seed of the choice.
    """
    usable = mask & np.isfinite(depth_m) & (depth_m > 0)
    if not usable.any():
        return None
    window = window_around(mask)
    rows, columns = np.nonzero(usable)
    n_distinct = min(len(rows), n_points)
    if len(rows) > n_points:
        drawn = np.sort(np.random.default_rng(seed).choice(len(rows), n_points, replace=False))
    else:
        drawn = np.arange(n_points) % len(rows)
    rows, columns = rows[drawn], columns[drawn]
    z = depth_m[rows, columns].astype(np.float64)
    points = np.stack([(columns - camera.cx) * z / camera.fx, (rows - camera.cy) * z / camera.fy, z], axis=1)
    chosen = (rows - window.top) * window.width + columns - window.left
    return ObjectCrop(_normalised(rgb, window), points.astype(np.float32)[None], chosen.astype(np.int64), n_distinct)


def _normalised(rgb: NDArray[np.uint8], window: ImageWindow) -> NDArray[np.float32]:
    crop = np.zeros((window.height, window.width, 3), np.float32)
    part = rgb[window.top : window.top + window.height, window.left : window.left + window.width]
    crop[: part.shape[0], : part.shape[1]] = part
    return np.ascontiguousarray(((crop - MEAN) / STD).transpose(2, 0, 1)[None])
