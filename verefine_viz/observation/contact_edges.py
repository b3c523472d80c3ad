"""Which instances may touch: visible clouds that come near each other. docs/methods.md 2.3."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.spatial import KDTree

from verefine_viz.core.arrays import Float, Mask
from verefine_viz.core.dependency import Edge
from verefine_viz.observation.visible_parts import VisiblePart


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
    found = {}
    for a, b in combinations(sorted(parts, key=lambda p: p.instance_id), 2):
        meeting = _meeting(a, b, contact_m)
        if meeting is not None:
            found[a.instance_id, b.instance_id] = meeting
    return found


def contact_edges(found: Meetings, contact_m: float) -> tuple[Edge, ...]:
    """An edge per pair; the nearer, the stronger."""
    return tuple(
        Edge("contact", first, second, 1 - meeting.gap_m / contact_m, f"{1000 * meeting.gap_m:.0f} mm apart")
        for (first, second), meeting in found.items()
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
