"""The loop of trimmed ICP, compiled as one call. docs/methods.md 4.2. Single-threaded, same bits every time."""

from __future__ import annotations

import numpy as np
from numba import njit

from verefine_viz.refiners.icp_kernel import apply, point_step
from verefine_viz.refiners.nearest import NearestIndex, nearest_of_all
from verefine_viz.refiners.trimmed_afar import Leaves, nearest_from_afar

NEAR_ONLY = -1.0
"""A limit that no distance keeps: beyond its cubes the index then gives up at once."""


@njit(cache=True)
def trimmed_loop(
    source: np.ndarray, index: NearestIndex, leaves: Leaves, n_used: int, energy_ratio: float, max_passes: int
) -> tuple[np.ndarray, np.ndarray, int, float]:
    """Fits ``source`` onto the indexed cloud; returns R (3, 3), t (3,), passes and the energy of the last one [m²].

    Args:
        source: (N, 3) cloud that moves.
        index: of the cloud that stays.
        leaves: of the same cloud.
        n_used: how many of the source points, the best matching ones, a fit uses; 3 to N.
        energy_ratio: a pass that leaves more than this share of the energy before is the last.
        max_passes: most passes.
    """
    n = len(source)
    R, t = np.eye(3), np.zeros(3)
    match = np.zeros(n, dtype=np.int64)
    squared = np.empty(n)
    moved = np.empty((n, 3))
    kept = np.ones(n, dtype=np.bool_)
    energy, previous = 0.0, np.inf
    for k in range(max_passes):
        for i in range(n):
            moved[i, 0], moved[i, 1], moved[i, 2] = apply(R, t, source[i])
        nearest_of_all(moved, NEAR_ONLY, index, match, squared)
        for i in range(n):
            if squared[i] == np.inf:
                match[i], squared[i] = nearest_from_afar(moved[i, 0], moved[i, 1], moved[i, 2], leaves)
        energy = _keep_best(squared, n_used, kept)
        # From where the points were at first, not from where the last pass left them: errors do not add up.
        R, t = point_step(source, index.points, match, kept, n_used)
        if not energy < energy_ratio * previous:
            return R, t, k + 1, energy
        previous = energy
    return R, t, max_passes, energy


@njit(cache=True)
def _keep_best(squared: np.ndarray, n_used: int, kept: np.ndarray) -> float:
    """Marks the ``n_used`` smallest, the first ones where several are as large as the last; their sum."""
    n = len(squared)
    if n_used >= n:
        return squared.sum()
    limit = np.partition(squared, n_used - 1)[n_used - 1]
    total, n_kept = 0.0, 0
    for i in range(n):
        kept[i] = squared[i] < limit
        if kept[i]:
            total += squared[i]
            n_kept += 1
    for i in range(n):
        if n_kept == n_used:
            break
        if squared[i] == limit:
            kept[i] = True
            total += limit
            n_kept += 1
    return total


@njit(cache=True)
def unexplained(points: np.ndarray, index: NearestIndex, limit_m: float) -> np.ndarray:
    """Which of ``points`` (N, 3) have no point of the indexed cloud within ``limit_m``; (N,) bool."""
    limit_squared = limit_m * limit_m
    found, squared = np.empty(len(points), dtype=np.int64), np.empty(len(points))
    nearest_of_all(points, limit_squared, index, found, squared)
    return squared > limit_squared
