"""Finds the pixels of an object that a person marks in the photo, by a box around it or a scribble on it.

What stands above the support plane, belongs to no labelled object and is connected in depth is one part; a box takes
the parts in its middle, a scribble those that it touches.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from verefine_viz.core.arrays import Mask
from verefine_viz.core.errors import InputError
from verefine_viz.core.geometry import apply
from verefine_viz.core.observation import Observation
from verefine_viz.core.problem import Placed
from verefine_viz.scenes.own_pixels import fit_reach_m, own_pixels
from verefine_viz.scenes.segments import FEWEST_MASK_PX

ABOVE_M, ABOVE_RMS = 0.004, 2.5
"""Height up to which a pixel belongs to the support plane [m], and as a multiple of the plane's noise."""
STEP_SHARE = 0.01
"""Largest difference in depth of neighbouring pixels of one part, as a share of depth."""
CORE = 0.25
"""Distance of a box's core from its sides, as a share of its size; the object is what fills most of the core."""
MARGIN = 0.14
"""Margin of an object in a box that is a fifth of the object's size too large on each side."""
LEAST_SHARE = 0.05
"""Least size of a part, as a share of the largest one; smaller parts are noise."""


def region_of_box(observation: Observation, box: Sequence[float], others: Sequence[Placed] = ()) -> Mask:
    """The pixels (H, W) of the object in the middle of a box.

    Args:
        observation: the frame.
        box: left, top, right, bottom [px]; may be up to a fifth too large on each side.
        others: objects that are labelled already.

    Raises:
        InputError: the box is outside of the image, or holds nothing but plane, labelled objects or pixels without
            depth.
    """
    height, width = observation.camera.shape
    left, top, right, bottom = (round(x) for x in box)
    inside = np.zeros((height, width), np.bool_)
    inside[max(top, 0) : max(bottom, 0), max(left, 0) : max(right, 0)] = True
    named = f"the box ({left}, {top}) to ({right}, {bottom})"
    if not inside.any():
        raise InputError(f"{named} holds no pixel of the image of {width}×{height}; draw it around the object")
    parts = _parts(observation, inside, others, named)
    n = parts.max() + 1
    total, in_core = np.bincount(parts.ravel(), minlength=n), _counts(parts, _shrunk(inside, CORE), n)
    chosen = np.zeros(n, np.bool_)
    chosen[int(in_core[1:].argmax()) + 1] = in_core[1:].any()
    # Parts that do not touch the box's sides belong to the object too: the inside of a cup, what shows behind a pole.
    n_largest = total[chosen].sum()
    on_sides = _counts(parts, inside & ~_shrunk(inside, 0), n)
    chosen |= (
        (_counts(parts, _shrunk(inside, MARGIN), n) > 0.5 * total)
        & (on_sides < 0.5 * np.sqrt(total))
        & (total >= LEAST_SHARE * n_largest)
    )
    chosen[0] = False
    return _large_enough(chosen[parts], named)


def region_of_scribble(
    observation: Observation, pixels: ArrayLike, within_m: float, others: Sequence[Placed] = ()
) -> Mask:
    """The pixels (H, W) of the object that a scribble touches.

    Args:
        observation: the frame.
        pixels: (N, 2) (u, v) of each point of the scribble [px]; those beside the image do not count.
        within_m: no pixel is further from the scribble: the object's diameter [m].
        others: objects that are labelled already.

    Raises:
        InputError: nothing of it lies on something that stands on the plane and is not labelled.
    """
    height, width = observation.camera.shape
    drawn = np.zeros((height, width), np.bool_)
    u, v = np.round(np.asarray(pixels, np.float64).reshape(-1, 2)).astype(np.int64).T
    is_inside = (u >= 0) & (u < width) & (v >= 0) & (v < height)
    drawn[v[is_inside], u[is_inside]] = True
    named = f"the scribble of {len(u)} points"
    points = observation.camera.back_project(np.asarray(observation.depth_m, np.float64))
    seen = drawn & (observation.depth_m > 0)
    if not seen.any():
        raise InputError(f"{named} lies where no depth was measured; draw it on the object")
    near = np.linalg.norm(points - np.median(points[seen], axis=0), axis=-1) < within_m
    parts = _parts(observation, near, others, named)
    touched = np.bincount(parts[drawn], minlength=parts.max() + 1)
    touched[0] = 0
    # A scribble that slips off the object touches something else with few of its pixels.
    return _large_enough((touched > 0.2 * touched.sum())[parts], named)


def _parts(observation: Observation, inside: Mask, others: Sequence[Placed], named: str) -> NDArray[np.int32]:
    """Number (H, W) of the part that a pixel belongs to, from 1; 0 outside, on the plane and on labelled objects."""
    depth_m = observation.depth_m
    standing = inside & (depth_m > 0)
    if not standing.any():
        raise InputError(f"no depth was measured in {named}; draw it where there is some")
    support = observation.support
    if support is not None:
        points = observation.camera.back_project(depth_m)[standing]
        heights = apply(support.T_world_cam, points) @ support.normal_world
        standing[standing] = heights > max(ABOVE_M, ABOVE_RMS * support.rms_m)
    for other in others:
        standing &= ~own_pixels(observation, other.model, other.T_cam_obj, (), fit_reach_m(other.model))
    n = np.count_nonzero(standing)
    if not n:
        raise InputError(f"{named} holds only the support plane and labelled objects; draw it around another object")
    number = np.zeros(depth_m.shape, np.int32)
    number[standing] = np.arange(n)
    links = [
        (number[here][linked], number[there][linked])
        for here, there in ((np.s_[:, :-1], np.s_[:, 1:]), (np.s_[:-1], np.s_[1:]))
        for linked in (standing[here] & standing[there] & _is_level(depth_m[here], depth_m[there]),)
    ]
    i, j = np.concatenate(links, axis=1)
    graph = coo_array((np.ones(len(i), np.bool_), (i, j)), shape=(n, n))
    parts = np.zeros(depth_m.shape, np.int32)
    parts[standing] = connected_components(graph, directed=False)[1] + 1
    return parts


def _is_level(a_m: NDArray[np.float32], b_m: NDArray[np.float32]) -> Mask:
    """Whether two depths [m] are those of one surface."""
    return np.abs(a_m - b_m) < STEP_SHARE * a_m


def _shrunk(box: Mask, share: float) -> Mask:
    """The pixels of a box (H, W) that are further than a share of its size, and one pixel, from its sides."""
    v, u = np.flatnonzero(box.any(axis=1)), np.flatnonzero(box.any(axis=0))
    dv, du = 1 + round(share * len(v)), 1 + round(share * len(u))
    inner = np.zeros_like(box)
    inner[v[0] + dv : v[-1] + 1 - dv, u[0] + du : u[-1] + 1 - du] = True
    return inner


def _counts(parts: NDArray[np.int32], where: Mask, n: int) -> NDArray[np.int64]:
    """How many pixels (n,) of each part lie there."""
    return np.bincount(parts[where], minlength=n)


def _large_enough(region: Mask, named: str) -> Mask:
    n = np.count_nonzero(region)
    if n < FEWEST_MASK_PX:
        raise InputError(f"only {n} pixels of {named} belong to something in its middle; expected {FEWEST_MASK_PX}")
    return region
