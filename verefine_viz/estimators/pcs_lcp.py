"""The largest common point set: how many of a model's points lie on the segment at a pose. Counted, not estimated."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float

MAX_CELLS = 2**22
"""Most cells of the grid; around a larger segment they grow beyond δ, which costs time only."""


class NearGrid(NamedTuple):
    """Cells around a cloud, each with those points that are near to some place in it."""

    points: Float
    """(N, 3) [m]."""
    radius_m: float
    """What "near" means: δ."""
    low: Float
    """(3,) where the cells begin."""
    side: float
    counts: NDArray[np.int64]
    """(3,) cells along x, y, z."""
    starts: NDArray[np.int32]
    """(cells + 1,) where each cell's points begin."""
    candidates: NDArray[np.int32]
    """Indices into ``points``."""

    @staticmethod
    def build(points: Float, radius_m: float) -> NearGrid:
        """The grid of a cloud (N, 3) of at least one point."""
        points = np.array(points, dtype=np.float64, order="C")
        low = points.min(axis=0) - radius_m
        extents = points.max(axis=0) + radius_m - low
        side = max(radius_m, float((extents.prod() / MAX_CELLS) ** (1 / 3)))
        counts = (extents / side).astype(np.int64) + 1
        starts, candidates = _fill(points, radius_m, low, side, counts)
        return NearGrid(points, radius_m, low, side, counts, starts, candidates)


def lcps(Ts_cam_obj: Float, model_points: Float, grid: NearGrid) -> Float:
    """Share of the model's points (M, 3) that lie within δ of a segment point, at each of the poses (N, 4, 4)."""
    points = np.array(model_points, dtype=np.float64, order="C")
    Ts = np.array(Ts_cam_obj, dtype=np.float64, order="C")
    return _counts(Ts, points, grid) / len(points)


@njit(cache=True)
def _counts(Ts: np.ndarray, points: np.ndarray, grid: NearGrid) -> np.ndarray:
    out = np.empty(len(Ts), dtype=np.int64)
    for i in range(len(Ts)):
        out[i] = count_near(Ts[i, :3, :3], Ts[i, :3, 3], points, grid)
    return out


@njit(cache=True)
def count_near(R: np.ndarray, t: np.ndarray, points: np.ndarray, grid: NearGrid) -> int:
    """How many of ``points`` (M, 3), turned by R (3, 3) and moved by t (3,), lie within δ of a point of the grid."""
    # Everything in locals: in the loop, a look into a tuple or a strided matrix costs more than the arithmetic.
    r00, r01, r02, r10, r11, r12 = R[0, 0], R[0, 1], R[0, 2], R[1, 0], R[1, 1], R[1, 2]
    r20, r21, r22, tx, ty, tz = R[2, 0], R[2, 1], R[2, 2], t[0], t[1], t[2]
    cloud, starts, candidates = grid.points, grid.starts, grid.candidates
    lx, ly, lz, per_side = grid.low[0], grid.low[1], grid.low[2], 1.0 / grid.side
    nx, ny, nz = grid.counts[0], grid.counts[1], grid.counts[2]
    limit = grid.radius_m * grid.radius_m
    n = 0
    for i in range(len(points)):
        a, b, c = points[i, 0], points[i, 1], points[i, 2]
        x = r00 * a + r01 * b + r02 * c + tx
        y = r10 * a + r11 * b + r12 * c + ty
        z = r20 * a + r21 * b + r22 * c + tz
        u, v, w = (x - lx) * per_side, (y - ly) * per_side, (z - lz) * per_side
        if u >= 0.0 and v >= 0.0 and w >= 0.0 and u < nx and v < ny and w < nz:
            cell = (int(u) * ny + int(v)) * nz + int(w)
            for k in range(starts[cell], starts[cell + 1]):
                p = candidates[k]
                dx, dy, dz = cloud[p, 0] - x, cloud[p, 1] - y, cloud[p, 2] - z
                if dx * dx + dy * dy + dz * dz <= limit:
                    n += 1
                    break
    return n


@njit(cache=True)
def _fill(
    points: np.ndarray, radius: float, low: np.ndarray, side: float, counts: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Where each cell's points begin, and the points: once to count them, once to enter them."""
    nx, ny, nz = counts[0], counts[1], counts[2]
    starts = np.zeros(nx * ny * nz + 1, dtype=np.int32)
    candidates = np.empty(0, dtype=np.int32)
    cursor = starts
    for entering in range(2):
        if entering == 1:
            for cell in range(nx * ny * nz):
                starts[cell + 1] += starts[cell]
            candidates = np.empty(starts[-1], dtype=np.int32)
            cursor = starts[:-1].copy()
        for p in range(len(points)):
            x, y, z = points[p, 0] - low[0], points[p, 1] - low[1], points[p, 2] - low[2]
            for i in range(max(0, int((x - radius) / side)), min(nx - 1, int((x + radius) / side)) + 1):
                dx = max(i * side - x, x - (i + 1) * side, 0.0)
                for j in range(max(0, int((y - radius) / side)), min(ny - 1, int((y + radius) / side)) + 1):
                    dy = max(j * side - y, y - (j + 1) * side, 0.0)
                    for k in range(max(0, int((z - radius) / side)), min(nz - 1, int((z + radius) / side)) + 1):
                        dz = max(k * side - z, z - (k + 1) * side, 0.0)
                        # A hair more than δ, so that rounding loses no point at a cell's border.
                        if dx * dx + dy * dy + dz * dz <= radius * radius * (1.0 + 1e-9):
                            cell = (i * ny + j) * nz + k
                            if entering == 1:
                                candidates[cursor[cell]] = p
                                cursor[cell] += 1
                            else:
                                starts[cell + 1] += 1
    return starts, candidates
