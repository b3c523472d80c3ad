"""Bases: four points of the segment, far apart and almost in one plane, and what no rigid motion changes about them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from verefine_viz.core.arrays import Float

TRIANGLES = 1000
"""Random triangles of which the one with the largest area becomes a base. docs/methods.md 3.2."""
APART = 0.2
"""The fourth point is at least this share of the longest distance away from the other three. docs/methods.md 3.2."""
ATTEMPTS = 10
"""First points that are tried for one base; a segment without a fourth point for any of them gives no base."""
PAIRINGS = np.array([[0, 1, 2, 3], [0, 2, 1, 3], [0, 3, 1, 2]])
"""The three ways to join four points by two segments."""


class Base(NamedTuple):
    """Four points, joined by the two segments 0-1 and 2-3, which meet or almost meet."""

    points: Float
    """(4, 3) [m]."""
    r1: float
    """Where on 0-1 it is nearest to 2-3: 0 at point 0, 1 at point 1. Affine maps do not change it."""
    r2: float
    """The same on 2-3."""


def diameter(points: Float) -> float:
    """Largest distance between two of the points (N, 3); 0 for fewer than two."""
    return float(_diameter(np.array(points, dtype=np.float64, order="C")))


def draw_base(points: Float, longest_m: float, gap_m: float, rng: np.random.Generator) -> Base | None:
    """One random base of a cloud, or None where the cloud is too small or too thin for any.

    A first point is drawn; of 1000 random triangles with it the widest is taken; the fourth point is the most coplanar
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
        found, quad, r1, r2 = _widest(points, first, others, APART * longest_m, longest_m, gap_m)
        if found:
            return Base(points[quad], r1, r2)
    return None


@njit(cache=True)
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


@njit(cache=True)
def best_pairing(quad: np.ndarray) -> tuple[int, float, float, float]:
    """Which of ``PAIRINGS`` joins the four points (4, 3) by the two segments that come nearest; their gap, r1, r2."""
    best, least, r1, r2 = 0, np.inf, 0.0, 0.0
    for k in range(3):
        gap, s, t = segment_gap(quad[PAIRINGS[k, 0]], quad[PAIRINGS[k, 1]], quad[PAIRINGS[k, 2]], quad[PAIRINGS[k, 3]])
        if gap < least:
            best, least, r1, r2 = k, gap, s, t
    return best, least, r1, r2


@njit(cache=True)
def _diameter(points: np.ndarray) -> float:
    largest = 0.0
    for i in range(len(points)):
        for j in range(i):
            dx, dy, dz = points[i, 0] - points[j, 0], points[i, 1] - points[j, 1], points[i, 2] - points[j, 2]
            largest = max(largest, dx * dx + dy * dy + dz * dz)
    return np.sqrt(largest)


@njit(cache=True)
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
        # A segment that is met at its end leaves nothing to compare there.
        if gap <= gap_m and min(r1, r2) > 0.0 and max(r1, r2) < 1.0:
            quad[3] = i
            return True, quad[PAIRINGS[pairing]], r1, r2
    return False, quad, 0.0, 0.0


# The rigid motion that lays four points on four others with the least sum of squared distances, in closed form.
#
# Thousands of fits a base: an iteration on the largest root of the characteristic polynomial is an order of magnitude
# faster than a singular value decomposition, and tells the residual before a rotation is made. Source: Theobald, Acta
# Cryst. A61 (2005) 478, on Horn's quaternion matrix.

NEWTON_STEPS = 50
"""Most steps towards the largest root; it converges in about five."""


@njit(cache=True)
def fit_rms(a: np.ndarray, b: np.ndarray, N: np.ndarray) -> tuple[float, float]:
    """Root mean square distance left between ``a`` (n, 3) and the best rigid motion of ``b`` (n, 3), and a root.

    Fills ``N`` (4, 4) with Horn's matrix; :func:`rotation_of` makes the rotation of N and the root.
    """
    n = len(a)
    am, bm = np.zeros(3), np.zeros(3)
    for i in range(n):
        for k in range(3):
            am[k] += a[i, k] / n
            bm[k] += b[i, k] / n
    S = np.zeros((3, 3))
    energy = 0.0
    for i in range(n):
        for k in range(3):
            p = b[i, k] - bm[k]
            energy += p * p + (a[i, k] - am[k]) ** 2
            for m in range(3):
                S[k, m] += p * (a[i, m] - am[m])
    xx, xy, xz = S[0, 0], S[0, 1], S[0, 2]
    yx, yy, yz = S[1, 0], S[1, 1], S[1, 2]
    zx, zy, zz = S[2, 0], S[2, 1], S[2, 2]
    N[0, 0], N[1, 1], N[2, 2], N[3, 3] = xx + yy + zz, xx - yy - zz, -xx + yy - zz, -xx - yy + zz
    N[0, 1], N[0, 2], N[0, 3] = yz - zy, zx - xz, xy - yx
    N[1, 2], N[1, 3], N[2, 3] = xy + yx, zx + xz, yz + zy
    N[1, 0], N[2, 0], N[3, 0], N[2, 1], N[3, 1], N[3, 2] = N[0, 1], N[0, 2], N[0, 3], N[1, 2], N[1, 3], N[2, 3]
    squares = 0.0
    for k in range(3):
        for m in range(3):
            squares += S[k, m] * S[k, m]
    c2 = -2.0 * squares
    c1 = -8.0 * (xx * (yy * zz - yz * zy) - xy * (yx * zz - yz * zx) + xz * (yx * zy - yy * zx))
    c0 = _det4(N)
    root = 0.5 * energy  # never below the largest root, from where Newton's steps descend to it
    for _ in range(NEWTON_STEPS):
        slope = (4.0 * root * root + 2.0 * c2) * root + c1
        if slope == 0.0:
            break
        step = ((root * root + c2) * root * root + c1 * root + c0) / slope
        root -= step
        if abs(step) <= 1e-14 * root:
            break
    return np.sqrt(max(0.0, (energy - 2.0 * root) / n)), root


@njit(cache=True)
def rotation_of(N: np.ndarray, root: float, R: np.ndarray) -> bool:
    """Fills ``R`` with the rotation of N's largest root; False if there is not one, but many (points in a line).

    The quaternion is any column of the adjugate of N - root·1; the longest is the one that rounding hurts least.
    """
    M = N.copy()
    for k in range(4):
        M[k, k] -= root
    best = np.zeros(4)
    longest = 0.0
    q = np.empty(4)
    for row in range(4):
        for column in range(4):
            q[column] = _cofactor(M, row, column)
        length = q @ q
        if length > longest:
            longest = length
            best[:] = q
    scale = max(abs(root), 1e-300)
    if longest <= (1e-10 * scale * scale * scale) ** 2:
        return False
    w, x, y, z = best / np.sqrt(longest)
    R[0, 0], R[0, 1], R[0, 2] = 1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)
    R[1, 0], R[1, 1], R[1, 2] = 2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)
    R[2, 0], R[2, 1], R[2, 2] = 2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)
    return True


@njit(cache=True)
def _cofactor(M: np.ndarray, row: int, column: int) -> float:
    r0, r1, r2 = (row + 1) % 4, (row + 2) % 4, (row + 3) % 4
    c0, c1, c2 = (column + 1) % 4, (column + 2) % 4, (column + 3) % 4
    minor = (
        M[r0, c0] * (M[r1, c1] * M[r2, c2] - M[r1, c2] * M[r2, c1])
        - M[r0, c1] * (M[r1, c0] * M[r2, c2] - M[r1, c2] * M[r2, c0])
        + M[r0, c2] * (M[r1, c0] * M[r2, c1] - M[r1, c1] * M[r2, c0])
    )
    # The three rows that are left come in a circle, which is an even permutation of their order; the columns likewise.
    return minor if (row + column) % 2 == 0 else -minor


@njit(cache=True)
def _det4(M: np.ndarray) -> float:
    total = 0.0
    for column in range(4):
        total += M[0, column] * _cofactor(M, 0, column)
    return total
