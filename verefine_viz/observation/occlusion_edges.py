"""Which instances hide others: a step in depth along the border that two masks share. docs/methods.md 2.3."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

from verefine_viz.core.arrays import Mask
from verefine_viz.core.dependency import Edge
from verefine_viz.observation.visible_parts import Box, VisiblePart

FEWEST_PX = 3
"""Measured pixels that each side of a border needs."""
WIDEST = 4
"""A border without depth (the sensor's shadow behind an edge) is widened up to so many times its width."""


def occlusion_edges(
    parts: Sequence[VisiblePart], depth_m: NDArray[np.floating], border_px: int, occlusion_m: float
) -> tuple[Edge, ...]:
    """An edge from the nearer to the farther of two instances whose depth differs along their common border.

    Args:
        parts: what is seen of each instance.
        depth_m: z, (H, W) [m]; 0 where nothing was measured.
        border_px: width of the common border [px].
        occlusion_m: the step in depth must be larger than this [m].
    """
    edges = []
    for a, b in combinations(sorted(parts, key=lambda p: p.instance_id), 2):
        found = _step(a, b, depth_m, border_px)
        if found is None or abs(found[0]) <= occlusion_m:
            continue
        step_m, length_px = found
        first, second = (a, b) if step_m > 0 else (b, a)
        evidence = f"{1000 * abs(step_m):.0f} mm nearer along {length_px} px"
        edges.append(Edge("occlusion", first.instance_id, second.instance_id, 1 - occlusion_m / abs(step_m), evidence))
    return tuple(edges)


def _step(a: VisiblePart, b: VisiblePart, depth_m: NDArray[np.floating], border_px: int) -> tuple[float, int] | None:
    """How much farther b is than a along their border [m], and the border's length [px]; None without a border."""
    for times in (1, 2, WIDEST):
        width_px = times * border_px
        window = _common(a.box, b.box, width_px, a.pixels.shape)
        if window is None:
            return None
        mine, other, depth = a.pixels[window], b.pixels[window], depth_m[window]
        at_a, at_b = mine & _grown(other, width_px), other & _grown(mine, width_px)
        length_px = int(min(np.count_nonzero(at_a), np.count_nonzero(at_b))) // width_px
        if length_px == 0:
            return None
        depths_a, depths_b = depth[at_a & (depth > 0)], depth[at_b & (depth > 0)]
        if min(len(depths_a), len(depths_b)) >= FEWEST_PX:
            return float(np.median(depths_b) - np.median(depths_a)), length_px
    return None


def _grown(mask: Mask, by_px: int) -> Mask:
    return np.asarray(binary_dilation(mask, iterations=by_px), dtype=bool)


def _common(a: Box, b: Box, by_px: int, shape: tuple[int, ...]) -> Box | None:
    """Where both boxes lie when each is grown, with a margin to see what is next to it; None if nowhere."""
    window = []
    for one, other, end in zip(a, b, shape, strict=True):
        low, high = max(one.start, other.start) - by_px, min(one.stop, other.stop) + by_px
        if low >= high:
            return None
        window.append(slice(max(low, 0), min(high, end)))
    return window[0], window[1]
