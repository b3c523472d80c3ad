"""Masks of objects at known poses, and how visible each is: what ``scene_gt_info.json`` of a BOP data set states.

Numbers are defined as in the official toolkit (``calc_gt_masks``, ``calc_gt_info``), with two differences. Pixel
centres lie at whole coordinates, as in the depth image and its camera matrix; the toolkit's renderer has them half a
pixel off. And a pixel belongs to the foremost of the objects only: the toolkit asks the measured depth alone, which
does not tell two that touch from each other (docs/methods.md 9.4).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.arrays import Mask
from verefine_viz.core.camera import Camera
from verefine_viz.core.problem import Placed
from verefine_viz.evaluation.vsd import seen
from verefine_viz.scenes.segments import draw_placed

MARGIN = 1
"""Images on each side of the image in which the cut-off part of an object is counted."""


@dataclass(frozen=True, eq=False)
class InstanceMask:
    """Where an object is in its frame."""

    whole: Mask
    """(H, W) its silhouette, also where something hides it."""
    visible: Mask
    """(H, W)."""
    info: dict[str, Any]
    """Its entry of ``scene_gt_info.json``; boxes are (x, y, width, height) [px], -1 where nothing is seen."""


def instance_masks(placed: Sequence[Placed], depth_m: NDArray[np.float32], camera: Camera) -> list[InstanceMask]:
    """The masks of all objects of a frame, in their order.

    Args:
        placed: all objects that are known in the frame.
        depth_m: the measured image (H, W) [m]; 0 where nothing was measured, which hides nothing.
        camera: of the frame.
    """
    drawn = [_drawn(one, camera) for one in placed]
    height, width = camera.shape
    rows, columns = slice(MARGIN * height, MARGIN * height + height), slice(MARGIN * width, MARGIN * width + width)
    inside = [one[rows, columns] for one in drawn]
    depth_mm = np.asarray(depth_m * np.float32(1e3), np.float32)
    foremost_m = np.min([np.where(one > 0, one, np.inf) for one in inside], axis=0, initial=np.inf)
    masks: list[InstanceMask] = []
    for large_m, own_m in zip(drawn, inside, strict=True):
        visible = seen(depth_mm, np.ascontiguousarray(own_m * np.float32(1e3)), camera.K) & (own_m <= foremost_m)
        masks.append(InstanceMask(own_m > 0, visible, _info(large_m > 0, own_m > 0, visible, depth_m)))
    return masks


def _drawn(one: Placed, camera: Camera) -> NDArray[np.float32]:
    """The depth [m] of an object alone, 0 beside it, on a canvas of ``MARGIN`` images on each side of the image."""
    height, width = camera.shape
    K = np.array(camera.K)
    K[:2, 2] += MARGIN * width, MARGIN * height
    size = 1 + 2 * MARGIN
    return draw_placed([one], Camera(K, size * width, size * height))[0]


def _info(large: Mask, whole: Mask, visible: Mask, depth_m: NDArray[np.float32]) -> dict[str, Any]:
    n_all, n_visible = int(np.count_nonzero(large)), int(np.count_nonzero(visible))
    height, width = whole.shape
    nothing = [-1, -1, -1, -1]
    return {
        "bbox_obj": _box(large, MARGIN * width, MARGIN * height) if n_visible else nothing,
        "bbox_visib": _box(visible, 0, 0) if n_visible else nothing,
        "px_count_all": n_all,
        "px_count_valid": int(np.count_nonzero(whole & (depth_m > 0))),
        "px_count_visib": n_visible,
        "visib_fract": n_visible / n_all if n_all else 0.0,
    }


def _box(mask: Mask, left: int, top: int) -> list[int]:
    """(x, y, width, height) of a mask's box in an image that begins at column ``left`` and row ``top``; as the toolkit
    counts, one pixel has width 0.
    """
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    return [
        int(columns[0]) - left, int(rows[0]) - top, int(columns[-1] - columns[0]), int(rows[-1] - rows[0]),
    ]  # fmt: skip
