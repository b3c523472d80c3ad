"""Which instances carry others, from what is seen of them: docs/methods.md 2.3, and what real frames and piles taught.

Two things whose footprints overlap cannot stand side by side: one is above the other. Which one is told by

- height: the lower end of one lies above the middle of the other, or
- where they meet: one's points lie above the other's there, which also holds inside a bowl or on a tilted edge.

Where they touch is often hidden below an overhang. An object that nothing is seen to carry is then carried by what its
footprint covers and its lower end is above. And an object may lean on something whose top it hardly covers: what ends
above the plane, though nothing hides its lower end, is carried by all that it meets and lies above.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from verefine_viz.core.arrays import Float, Mask
from verefine_viz.core.dependency import Edge
from verefine_viz.core.dependency_settings import DependencySettings
from verefine_viz.observation.contact_edges import Meetings
from verefine_viz.observation.visible_parts import VisiblePart

RISE_M = 0.004
"""Where they meet, one lies above the other if it is higher by more than this [m]: a depth sensor's noise."""
LOWER_END, MIDDLE, LOWEST = 10, 50, 2
"""Percentiles of visible heights; the lowest leaves out stray pixels at a mask's border."""
GRID = 24
"""A footprint's share is counted on a grid of so many points a side."""
MORE = 2.0
"""Where heights as a whole do not tell, so many times the usual share of the footprint is asked for."""
HIDDEN = 0.5
"""How much an edge whose contact is hidden is worth beside one whose contact is seen."""
LEANING = 0.1
"""Strength of an edge to what is leant on: the weakest sign."""


@dataclass(frozen=True, eq=False)
class _Stand:
    """How an object stands: its footprint and heights."""

    instance_id: int
    hull: ConvexHull
    """Of its visible points, seen from above."""
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
    """Of the upper's footprint that lies over the lower's."""
    above_m: float
    """How far the upper's lower end is above the lower's middle."""
    rise_m: float | None
    """How much higher the upper's points lie where they meet; None where they do not."""

    def edge(self, strength: float, evidence: str) -> Edge:
        return Edge("support", self.lower, self.upper, strength, evidence)


def support_edges(
    parts: Sequence[VisiblePart], meetings: Meetings, hidden: Collection[int], settings: DependencySettings
) -> tuple[Edge, ...]:
    """An edge from each carrier to what it carries.

    Its strength is the share of the footprint that lies over the carrier, less where the contact is hidden.

    Args:
        parts: what is seen of each instance; all need a plane.
        meetings: where they come near each other.
        hidden: instances of which another hides something: their lower end may be elsewhere.
        settings: thresholds.
    """
    stands = [s for s in map(_stand, sorted(parts, key=lambda p: p.instance_id)) if s is not None]
    edges: list[Edge] = []
    for upper in stands:
        pairs = [_pair(lower, upper, meetings) for lower in stands if lower is not upper]
        below = [pair for pair in pairs if pair.share > settings.footprint_share]
        found = [edge for pair in below if (edge := _standing(pair, settings.footprint_share))]
        if not found:
            found = [edge for pair in below if (edge := _standing_unseen(pair))]
        if upper.lowest_m > settings.base_m and upper.instance_id not in hidden:
            known = {edge.first for edge in found}
            found += [edge for pair in pairs if pair.lower not in known and (edge := _leaning(pair))]
        edges += found
    return tuple(edges)


def lowest_m(part: VisiblePart) -> float:
    """Height over the plane of its lowest visible points [m]."""
    return float(np.percentile(part.heights_m, LOWEST))


def _standing(pair: _Pair, footprint_share: float) -> Edge | None:
    """The edge of a contact that is seen."""
    if pair.rise_m is None:
        return None
    over = f"{pair.share:.0%} of its footprint"
    if pair.above_m >= 0:
        return pair.edge(pair.share, f"{over}, {1000 * pair.above_m:.0f} mm above")
    if pair.rise_m > RISE_M and pair.share > MORE * footprint_share:
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
