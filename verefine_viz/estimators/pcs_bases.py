"""Bases: four points of the segment, far apart and almost in one plane, and what no rigid motion changes about them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.kernels import kernel

TRIANGLES = 1000
"""Random triangles, of which the largest becomes part of a base. docs/methods.md 3.2."""
APART = 0.2
"""The fourth point is at least this share of the longest distance away from the other three. docs/methods.md 3.2."""
ATTEMPTS = 10
"""Most first points that are tried for a base; a segment without a fourth point for any of them gives no base."""
PAIRINGS = np.array([[0, 1, 2, 3], [0, 2, 1, 3], [0, 3, 1, 2]])
"""The three ways to join four points by two segments."""


class Base(NamedTuple):
    """Four points, joined by the two segments 0-1 and 2-3, which meet or almost meet."""

    points: Float
    """(4, 3) [m]."""
    r1: float
    """Where on 0-1 it is nearest to 2-3: 0 at point 0, 1 at point 1. Affine maps do not change it."""
    r2: float
    """Ratio on the line 2-3."""


def diameter(points: Float) -> float:
    """Largest distance between two of the points (N, 3); 0 for fewer than two."""
    return float(_diameter(np.array(points, dtype=np.float64, order="C")))


def draw_base(points: Float, longest_m: float, gap_m: float, rng: np.random.Generator) -> Base | None:
    """One random base of a cloud, or None where the cloud is too small or too thin for any.

    A first point is drawn; of 1000 random triangles with it the largest is taken; the fourth point is the most coplanar
    of those that are far from the three and let two of the segments meet. (Super4PCS takes the most coplanar one
    whether or not segments meet; where they do not, no congruent set can be found by its own test.)

    Args:
        points: (N, 3) of the segment [m].
        longest_m: largest distance between two points of the base: the segment's diameter, or the model's where that is
            less (a mask that leaks onto what lies behind makes the segment larger than the model).
        gap_m: how near the two segments must come, and the fourth point to the plane of the others.
        rng: draws first points and triangles.
    """
    n = len(points)
    if n < 4 or longest_m <= 0:
        return None
    for _ in range(ATTEMPTS):
        first = int(rng.integers(n))
        others = rng.integers(n, size=(TRIANGLES, 2))
        has_base, quad, r1, r2 = _widest(points, first, others, APART * longest_m, longest_m, gap_m)
        if has_base:
            return Base(points[quad], r1, r2)
    return None


@kernel()
def segment_gap(a: np.ndarray, b: np.ndarray, c: np.ndarray, d: np.ndarray) -> tuple[float, float, float]:
    """Smallest distance between the segments a-b and c-d, and where on each it is reached (0 at a and c, 1 at b and d).

    Source: Ericson, Real-Time Collision Detection, 5.1.9.
    """
    u, v, w = b - a, d - c, a - c
    uu, vv, uv, uw, vw = float(u @ u), float(v @ v), float(u @ v), float(u @ w), float(v @ w)
    s, t = 0.0, 0.0
    if uu > 0.0 and vv > 0.0:
        denominator = uu * vv - uv * uv
        if denominator > 1e-12 * uu * vv:
            s = min(1.0, max(0.0, (uv * vw - uw * vv) / denominator))
        t = (uv * s + vw) / vv
        if t < 0.0:
            t, s = 0.0, min(1.0, max(0.0, -uw / uu))
        elif t > 1.0:
            t, s = 1.0, min(1.0, max(0.0, (uv - uw) / uu))
    elif uu > 0.0:
        s = min(1.0, max(0.0, -uw / uu))
    elif vv > 0.0:
        t = min(1.0, max(0.0, vw / vv))
    gap = w + s * u - t * v
    return float(np.sqrt(gap @ gap)), s, t


@kernel()
def best_pairing(quad: np.ndarray) -> tuple[int, float, float, float]:
    """Which of ``PAIRINGS`` joins the four points (4, 3) by the two segments that come nearest; their gap, r1, r2."""
    best, least, r1, r2 = 0, np.inf, 0.0, 0.0
    for k in range(3):
        gap, s, t = segment_gap(quad[PAIRINGS[k, 0]], quad[PAIRINGS[k, 1]], quad[PAIRINGS[k, 2]], quad[PAIRINGS[k, 3]])
        if gap < least:
            best, least, r1, r2 = k, gap, s, t
    return best, least, r1, r2


@kernel()
def _diameter(points: np.ndarray) -> float:
    largest = 0.0
    for i in range(len(points)):
        for j in range(i):
            dx, dy, dz = points[i, 0] - points[j, 0], points[i, 1] - points[j, 1], points[i, 2] - points[j, 2]
            largest = max(largest, dx * dx + dy * dy + dz * dz)
    return np.sqrt(largest)


@kernel()
def _widest(
    points: np.ndarray, first: int, others: np.ndarray, apart_m: float, longest_m: float, gap_m: float
) -> tuple[bool, np.ndarray, float, float]:
    """Whether there is a base with ``first``; its points' indices, pairs together; r1, r2."""
    quad = np.array([first, first, first, first])
    a = points[first]
    longest = longest_m * longest_m
    widest = 0.0
    normal = np.zeros(3)
    for k in range(len(others)):
        u, v = points[others[k, 0]] - a, points[others[k, 1]] - a
        w = v - u
        if u @ u > longest or v @ v > longest or w @ w > longest:
            continue
        cross = np.array([u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]])
        area = cross @ cross
        if area > widest:
            widest, quad[1], quad[2] = area, others[k, 0], others[k, 1]
            normal = cross
    if widest <= apart_m**4:  # narrower than a square of that side is: all but a line
        return False, quad, 0.0, 0.0
    normal /= np.sqrt(widest)
    corners = np.empty((4, 3))
    for k in range(3):
        corners[k] = points[quad[k]]
    apart = apart_m * apart_m
    off_plane = np.full(len(points), np.inf)
    for i in range(len(points)):
        far = True
        for k in range(3):
            d = points[i] - corners[k]
            far = far and apart <= d @ d <= longest
        if far:
            off_plane[i] = abs((points[i] - a) @ normal)
    for i in np.argsort(off_plane, kind="mergesort"):
        if off_plane[i] > gap_m:
            break
        corners[3] = points[i]
        pairing, gap, r1, r2 = best_pairing(corners)
        # A segment that is met at its end has no ratio to compare.
        if gap <= gap_m and min(r1, r2) > 0.0 and max(r1, r2) < 1.0:
            quad[3] = i
            return True, quad[PAIRINGS[pairing]], r1, r2
    return False, quad, 0.0, 0.0
