"""Which instances touch, hide or support others, from what is visible of them (docs/methods.md 2.3).

Two objects whose footprints overlap cannot stand side by side: one is above the other. Which one follows from

- height: the lower end of one lies above the middle of the other, or
- where they meet: one's points lie above the other's there, which also holds inside a bowl or on a tilted edge.

Where they touch is often hidden below an overhang. An object without a visible support then rests on what its footprint
covers and its lower end is above. And an object may lean on something whose top it hardly covers: what ends above the
plane, though nothing hides its lower end, rests on all that it meets and lies above.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation
from scipy.spatial import ConvexHull, KDTree, QhullError

from verefine_viz.core.arrays import Float, Mask
from verefine_viz.core.problem import Edge
from verefine_viz.observation.visible_parts import Box, VisiblePart

FEWEST_PX = 3
"""Measured pixels that each side of a border needs."""
BORDER_PX = 3
"""Width of the common border of two masks [px]."""
WIDEST = 4
"""A border without depth (the sensor's shadow behind an edge) is widened up to so many times its width."""
RISE_M = 0.004
"""Where they meet, one lies above the other if it is higher by more than this [m]: a depth sensor's noise."""
LOWER_END, MIDDLE, LOWEST = 10, 50, 2
"""Percentiles of visible heights; the lowest leaves out stray pixels at a mask's border."""
FOOTPRINT = 0.1
"""An object lies over another if more than this share of its footprint does."""
BASE_M = 0.020
"""An object whose lowest visible point is lower than this over the plane stands on it [m]."""
GRID = 24
"""A footprint's share is counted on a grid of so many points a side."""
MORE = 2.0
"""Where heights as a whole do not decide, so many times this share of the footprint is required."""
HIDDEN = 0.5
"""How much an edge whose contact is hidden is worth beside one whose contact is seen."""
LEANING = 0.1
"""Strength of an edge to what is leant on: the weakest sign."""


@dataclass(frozen=True)
class Meeting:
    """Where two visible clouds come near each other."""

    gap_m: float
    """Smallest distance."""
    rise_m: float
    """How much higher the second's points lie there than the first's, by their medians; 0 without a plane."""


Meetings = dict[tuple[int, int], Meeting]
"""By instance ids, the lower first."""


def meetings(parts: Sequence[VisiblePart], contact_m: float) -> Meetings:
    """All pairs whose visible clouds come nearer than ``contact_m``."""
    by_pair = {}
    for a, b in combinations(sorted(parts, key=lambda p: p.instance_id), 2):
        meeting = _meeting(a, b, contact_m)
        if meeting is not None:
            by_pair[a.instance_id, b.instance_id] = meeting
    return by_pair


def contact_edges(near: Meetings, contact_m: float) -> tuple[Edge, ...]:
    """An edge per pair; the nearer, the stronger."""
    return tuple(
        Edge("contact", first, second, 1 - meeting.gap_m / contact_m, f"{1000 * meeting.gap_m:.0f} mm apart")
        for (first, second), meeting in near.items()
    )


def _meeting(a: VisiblePart, b: VisiblePart, contact_m: float) -> Meeting | None:
    low, high = np.maximum(a.bounds_cam[0], b.bounds_cam[0]), np.minimum(a.bounds_cam[1], b.bounds_cam[1])
    if (low > high + contact_m).any():
        return None
    # Only what lies in both boxes, grown by the reach, can be near the other.
    near_a, near_b = (_within(p.points_cam, low - contact_m, high + contact_m) for p in (a, b))
    points_a, points_b = a.points_cam[near_a], b.points_cam[near_b]
    if len(points_a) == 0 or len(points_b) == 0:
        return None
    distances_a = _distances(points_a, points_b, contact_m)
    gap_m = float(distances_a.min())
    if not gap_m < contact_m:
        return None
    if a.points_plane is None or b.points_plane is None:
        return Meeting(gap_m, 0.0)
    heights_a = a.points_plane[near_a, 2][distances_a < contact_m]
    heights_b = b.points_plane[near_b, 2][_distances(points_b, points_a, contact_m) < contact_m]
    return Meeting(gap_m, float(np.median(heights_b) - np.median(heights_a)))


def _distances(points: Float, others: Float, reach_m: float) -> Float:
    """Distance of each point to the nearest of the others; infinite beyond ``reach_m``."""
    distances, _ = KDTree(others).query(points, distance_upper_bound=reach_m)
    return np.asarray(distances)


def _within(points: Float, low: Float, high: Float) -> Mask:
    """Which points (N, 3) lie in a box."""
    inside = np.ones(len(points), dtype=bool)
    for k in range(3):
        inside &= (points[:, k] >= low[k]) & (points[:, k] <= high[k])
    return inside


def occlusion_edges(
    parts: Sequence[VisiblePart], depth_m: NDArray[np.floating], occlusion_m: float
) -> tuple[Edge, ...]:
    """An edge from the nearer to the farther of two instances whose depth differs along their common border.

    Args:
        parts: what is seen of each instance.
        depth_m: z, (H, W) [m]; 0 where nothing was measured.
        occlusion_m: the step in depth must be larger than this [m].
    """
    edges = []
    for a, b in combinations(sorted(parts, key=lambda p: p.instance_id), 2):
        step = _step(a, b, depth_m)
        if step is None or abs(step[0]) <= occlusion_m:
            continue
        step_m, length_px = step
        first, second = (a, b) if step_m > 0 else (b, a)
        evidence = f"{1000 * abs(step_m):.0f} mm nearer along {length_px} px"
        edges.append(Edge("occlusion", first.instance_id, second.instance_id, 1 - occlusion_m / abs(step_m), evidence))
    return tuple(edges)


def _step(a: VisiblePart, b: VisiblePart, depth_m: NDArray[np.floating]) -> tuple[float, int] | None:
    """How much farther b is than a along their border [m], and the border's length [px]; None without a border."""
    for times in (1, 2, WIDEST):
        width_px = times * BORDER_PX
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


@dataclass(frozen=True, eq=False)
class _Stand:
    """How an object stands: its footprint and heights."""

    instance_id: int
    hull: ConvexHull
    """Hull of its visible points, seen from above."""
    samples: Float
    """(n, 2) points all over the footprint [m]."""
    lowest_m: float
    lower_end_m: float
    middle_m: float


@dataclass(frozen=True)
class _Pair:
    """An object and what may carry it."""

    lower: int
    upper: int
    share: float
    """Share of the upper's footprint that lies over the lower's."""
    above_m: float
    """How far the upper's lower end is above the lower's middle."""
    rise_m: float | None
    """How much higher the upper's points lie where they meet; None where they do not."""

    def edge(self, strength: float, evidence: str) -> Edge:
        return Edge("support", self.lower, self.upper, strength, evidence)


def support_edges(parts: Sequence[VisiblePart], meetings: Meetings, hidden: Collection[int]) -> tuple[Edge, ...]:
    """An edge from each carrier to what it carries.

    Its strength is the share of the footprint that lies over the carrier, less where the contact is hidden.

    Args:
        parts: what is seen of each instance; all need a plane.
        meetings: where they come near each other.
        hidden: instances of which another hides something: their lower end may be elsewhere.
    """
    stands = [s for s in map(_stand, sorted(parts, key=lambda p: p.instance_id)) if s is not None]
    edges: list[Edge] = []
    for upper in stands:
        pairs = [_pair(lower, upper, meetings) for lower in stands if lower is not upper]
        below = [pair for pair in pairs if pair.share > FOOTPRINT]
        own = [edge for pair in below if (edge := _standing(pair))]
        if not own:
            own = [edge for pair in below if (edge := _standing_unseen(pair))]
        if upper.lowest_m > BASE_M and upper.instance_id not in hidden:
            carriers = {edge.first for edge in own}
            own += [edge for pair in pairs if pair.lower not in carriers and (edge := _leaning(pair))]
        edges += own
    return tuple(edges)


def lowest_m(part: VisiblePart) -> float:
    """Height over the plane of its lowest visible points [m]."""
    return float(np.percentile(part.heights_m, LOWEST))


def _standing(pair: _Pair) -> Edge | None:
    """The edge of a contact that is seen."""
    if pair.rise_m is None:
        return None
    over = f"{pair.share:.0%} of its footprint"
    if pair.above_m >= 0:
        return pair.edge(pair.share, f"{over}, {1000 * pair.above_m:.0f} mm above")
    if pair.rise_m > RISE_M and pair.share > MORE * FOOTPRINT:
        return pair.edge(pair.share, f"{over}, {1000 * pair.rise_m:.0f} mm above where they meet")
    return None


def _standing_unseen(pair: _Pair) -> Edge | None:
    """The edge of a contact that cannot be seen."""
    if pair.rise_m is not None or pair.above_m < 0:
        return None
    evidence = f"{pair.share:.0%} of its footprint, {1000 * pair.above_m:.0f} mm above, contact hidden"
    return pair.edge(HIDDEN * pair.share, evidence)


def _leaning(pair: _Pair) -> Edge | None:
    """The edge to something whose top is hardly covered."""
    if pair.rise_m is None or pair.rise_m <= RISE_M or pair.above_m < 0:
        return None
    return pair.edge(LEANING, f"leans on it, {1000 * pair.rise_m:.0f} mm above where they meet")


def _pair(lower: _Stand, upper: _Stand, meetings: Meetings) -> _Pair:
    a, b = lower.instance_id, upper.instance_id
    meeting = meetings.get((min(a, b), max(a, b)))
    rise_m = None if meeting is None else meeting.rise_m if a < b else -meeting.rise_m
    share = float(_inside(lower.hull, upper.samples).mean()) if len(upper.samples) else 0.0
    return _Pair(a, b, share, upper.lower_end_m - lower.middle_m, rise_m)


def _stand(part: VisiblePart) -> _Stand | None:
    """None where so little is seen that it has no footprint."""
    assert part.points_plane is not None
    try:
        hull = ConvexHull(part.points_plane[:, :2])
    except (QhullError, ValueError):
        return None
    low, high = hull.min_bound, hull.max_bound
    grid = np.stack(np.meshgrid(*(np.linspace(low[k], high[k], GRID) for k in (0, 1))), axis=-1).reshape(-1, 2)
    lowest, lower_end, middle = np.percentile(part.heights_m, [LOWEST, LOWER_END, MIDDLE])
    samples = grid[_inside(hull, grid)]
    return _Stand(part.instance_id, hull, samples, float(lowest), float(lower_end), float(middle))


def _inside(hull: ConvexHull, points: Float) -> Mask:
    return np.all(points @ hull.equations[:, :2].T + hull.equations[:, 2] <= 1e-9, axis=1)
