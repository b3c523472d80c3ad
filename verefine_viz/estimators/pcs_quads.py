"""Congruent quads: four points of the model that a rigid motion lays on a base, and that motion."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import pdist

from verefine_viz.core.arrays import Float
from verefine_viz.core.kernels import kernel
from verefine_viz.estimators.pcs_bases import Base

TOLERANCE = 2.0
"""Tolerance, in δ, of the length of a pair, of its intermediate point and of the residual of the fit."""

MOST_ACROSS = 2.0**20
"""Most cells along an axis, so that their number fits an integer; where memory is short, an error says so."""

NEWTON_STEPS = 50
"""Most steps towards the largest root of a fit; it converges in about five."""


class DistanceTable(NamedTuple):
    """All pairs of points of a cloud, each once, by their distance."""

    distances_m: Float
    """(N·(N-1)/2,) ascending [m]."""
    pairs: NDArray[np.int32]
    """(N·(N-1)/2, 2) indices of the points."""

    @staticmethod
    def build(points: Float) -> DistanceTable:
        """The pairs of a cloud (N, 3)."""
        distances = pdist(points).astype(np.float64)
        order = np.argsort(distances, kind="stable")
        first, second = np.triu_indices(len(points), 1)  # the order of pdist
        return DistanceTable(distances[order], np.stack([first, second], axis=1)[order].astype(np.int32))

    def pairs_of_length(self, length_m: float, tolerance_m: float) -> NDArray[np.int32]:
        """Pairs (n, 2) that are longer than ``length_m - tolerance_m`` and shorter than ``length_m + tolerance_m``.

        Each is there once, in one direction.
        """
        begin = np.searchsorted(self.distances_m, length_m - tolerance_m, side="right")
        end = np.searchsorted(self.distances_m, length_m + tolerance_m, side="left")
        return self.pairs[begin:end]


def congruent_quads(
    base: Base,
    points: Float,
    pairs: DistanceTable,
    delta_m: float,
    most: int,
    rng: np.random.Generator,
) -> NDArray[np.int32]:
    """Quads (n, 4) of indices of ``points`` (M, 3) that may be the base's points, in the order of the base.

    Pairs as long as the base's two segments whose intermediate points, at r1 and r2, fall together, each within 2δ;
    the residual of the rigid fit is left to :func:`fitted`.

    Args:
        base: of the segment.
        points: of the model [m].
        pairs: all pairs of ``points``.
        delta_m: δ [m].
        most: number of quads at which the search ends.
        rng: shuffles the pairs, so that these quads are a random choice.
    """
    tolerance = TOLERANCE * delta_m
    first = pairs.pairs_of_length(float(np.linalg.norm(base.points[1] - base.points[0])), tolerance)
    second = pairs.pairs_of_length(float(np.linalg.norm(base.points[3] - base.points[2])), tolerance)
    if len(first) == 0 or len(second) == 0:
        return np.empty((0, 4), dtype=np.int32)
    points = np.array(points, dtype=np.float64, order="C")
    # Each pair may lie on the segment either way round.
    first, second = np.concatenate([first, first[:, ::-1]]), np.concatenate([second, second[:, ::-1]])
    second = second[rng.permutation(len(second))]
    first, starts, low, counts = _group_by_cell(points, first, base.r1, tolerance)
    return _meeting(points, first, starts, low, counts, second, base.points, base.r1, base.r2, tolerance, most)


@kernel()
def fitted(base: np.ndarray, points: np.ndarray, quads: np.ndarray, max_rms_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Poses (n, 4, 4) that lay quads (N, 4) of ``points`` on the base (4, 3), and which quads they belong to (n,).

    Only those whose root mean square residual is below ``max_rms_m``.
    """
    Ts = np.zeros((len(quads), 4, 4))
    of_quad = np.empty(len(quads), dtype=np.int64)
    corners, N, R = np.empty((4, 3)), np.empty((4, 4)), np.empty((3, 3))
    n = 0
    for q in range(len(quads)):
        for k in range(4):
            corners[k] = points[quads[q, k]]
        rms, root = fit_rms(base, corners, N)
        if not rms < max_rms_m or not rotation_of(N, root, R):
            continue
        for row in range(3):
            t = 0.0
            for k in range(4):
                t += base[k, row]
                for m in range(3):
                    t -= R[row, m] * corners[k, m]
            Ts[n, row, 3] = t / 4
            for m in range(3):
                Ts[n, row, m] = R[row, m]
        Ts[n, 3, 3] = 1.0
        of_quad[n] = q
        n += 1
    return Ts[:n], of_quad[:n]


@kernel()
def _group_by_cell(
    points: np.ndarray, pairs: np.ndarray, r: float, side: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The pairs, sorted by the cell in which their intermediate point lies; where each cell begins; the cells."""
    middle = np.empty((len(pairs), 3))
    for p in range(len(pairs)):
        for k in range(3):
            middle[p, k] = points[pairs[p, 0], k] + r * (points[pairs[p, 1], k] - points[pairs[p, 0], k])
    low, counts = np.empty(3), np.empty(3, dtype=np.int64)
    for k in range(3):
        low[k] = points[:, k].min()
        counts[k] = int(min((points[:, k].max() - low[k]) / side, MOST_ACROSS)) + 1
    cells = np.empty(len(pairs), dtype=np.int64)
    starts = np.zeros(counts[0] * counts[1] * counts[2] + 1, dtype=np.int64)
    for p in range(len(pairs)):
        cell = 0
        for k in range(3):
            cell = cell * counts[k] + int(min(max(0.0, (middle[p, k] - low[k]) / side), counts[k] - 1.0))
        cells[p] = cell
        starts[cell + 1] += 1
    for cell in range(len(starts) - 1):
        starts[cell + 1] += starts[cell]
    cursor = starts.copy()
    ordered = np.empty((len(pairs), 2), dtype=np.int32)
    for p in range(len(pairs)):
        ordered[cursor[cells[p]], 0] = pairs[p, 0]
        ordered[cursor[cells[p]], 1] = pairs[p, 1]
        cursor[cells[p]] += 1
    return ordered, starts, low, counts


@kernel()
def _meeting(
    points: np.ndarray,
    first: np.ndarray,
    starts: np.ndarray,
    low: np.ndarray,
    counts: np.ndarray,
    second: np.ndarray,
    base: np.ndarray,
    r1: float,
    r2: float,
    tolerance: float,
    most: int,
) -> np.ndarray:
    """Quads of a pair of each kind whose intermediate points lie within the tolerance, and which the fit may accept."""
    across = np.empty(4)
    for m in range(4):
        d = base[2 + m % 2] - base[m // 2]
        across[m] = np.sqrt(d @ d)
    # A residual below the tolerance in the root mean square leaves Σ (Δ length)² of two pairs without a common point
    # below 2 · 4 · tolerance²: what exceeds it is dropped before it costs a fit.
    limit = 8.0 * tolerance * tolerance
    out = np.empty((4096, 4), dtype=np.int32)
    n = 0
    cell = np.empty(3, dtype=np.int64)
    for s in range(len(second)):
        c, d = second[s, 0], second[s, 1]
        x = points[c, 0] + r2 * (points[d, 0] - points[c, 0])
        y = points[c, 1] + r2 * (points[d, 1] - points[c, 1])
        z = points[c, 2] + r2 * (points[d, 2] - points[c, 2])
        # From two below the first cell to two above the last: no neighbour of what lies there has any pair.
        cell[0] = int(min(max(-2.0, (x - low[0]) / tolerance), counts[0] + 1.0))
        cell[1] = int(min(max(-2.0, (y - low[1]) / tolerance), counts[1] + 1.0))
        cell[2] = int(min(max(-2.0, (z - low[2]) / tolerance), counts[2] + 1.0))
        for i in range(max(0, cell[0] - 1), min(counts[0], cell[0] + 2)):
            for j in range(max(0, cell[1] - 1), min(counts[1], cell[1] + 2)):
                row = (i * counts[1] + j) * counts[2]
                begin = starts[row + max(0, cell[2] - 1)]
                end = starts[row + min(counts[2], cell[2] + 2)]
                for p in range(begin, end):
                    a, b = first[p, 0], first[p, 1]
                    dx = points[a, 0] + r1 * (points[b, 0] - points[a, 0]) - x
                    dy = points[a, 1] + r1 * (points[b, 1] - points[a, 1]) - y
                    dz = points[a, 2] + r1 * (points[b, 2] - points[a, 2]) - z
                    if dx * dx + dy * dy + dz * dz > tolerance * tolerance:
                        continue
                    ac, ad = _distance(points, a, c) - across[0], _distance(points, a, d) - across[1]
                    bc, bd = _distance(points, b, c) - across[2], _distance(points, b, d) - across[3]
                    if ac * ac + bd * bd > limit or ad * ad + bc * bc > limit:
                        continue
                    if n == len(out):
                        larger = np.empty((2 * n, 4), dtype=np.int32)
                        larger[:n] = out
                        out = larger
                    out[n, 0], out[n, 1], out[n, 2], out[n, 3] = a, b, c, d
                    n += 1
                    if n == most:
                        return out[:n]
    return out[:n]


@kernel()
def _distance(points: np.ndarray, i: int, j: int) -> float:
    dx, dy, dz = points[i, 0] - points[j, 0], points[i, 1] - points[j, 1], points[i, 2] - points[j, 2]
    return np.sqrt(dx * dx + dy * dy + dz * dz)


@kernel()
def fit_rms(a: np.ndarray, b: np.ndarray, N: np.ndarray) -> tuple[float, float]:
    """Root mean square distance left between ``a`` (n, 3) and the best rigid motion of ``b`` (n, 3), and a root.

    Fills ``N`` (4, 4) with Horn's matrix; :func:`rotation_of` makes the rotation of N and the root. Thousands of fits a
    base: an iteration on the largest root of the characteristic polynomial is an order of magnitude faster than a
    singular value decomposition, and gives the residual before a rotation is made. Source: Theobald, Acta Cryst. A61
    (2005) 478, on Horn's quaternion matrix.
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


@kernel()
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


@kernel()
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


@kernel()
def _det4(M: np.ndarray) -> float:
    total = 0.0
    for column in range(4):
        total += M[0, column] * _cofactor(M, 0, column)
    return total
