"""How far each iteration is from ground truth, as fast as a recording needs it."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numba import njit
from scipy.spatial import KDTree

from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import apply, inverse
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.problem import Target
from verefine_viz.core.records import Best, Iteration


class AgainstTruth:
    """Judges iterations one after another; remembers the best pose, which seldom changes."""

    def __init__(self) -> None:
        self._best: Best | None = None
        self._best_mm = float("nan")

    def errors(self, target: Target, iteration: Iteration) -> Float:
        """What ``Row.errors`` says. ADD(-S) goes over all points, so only when the best pose changed."""
        T_gt = target.instance.T_cam_obj_gt
        if T_gt is None:
            return _UNKNOWN
        best, T_kept = iteration.best, iteration.accepted_stage.T_cam_obj
        if self._best is not best:
            self._best, self._best_mm = best, _add_s_mm(target.model, best.T_cam_obj, T_gt)
        rotation_deg, translation_m = _turn_and_shift(T_kept, T_gt, target.model.symmetries)
        return np.array([rotation_deg, 1e3 * translation_m, self._best_mm])


_UNKNOWN = np.full(3, np.nan)


def _add_s_mm(model: ObjectModel, T_est: Float, T_gt: Float) -> float:
    """As ``pose_errors`` has it. Nearest points are looked for only where the object is symmetric, and in its
    own frame, for which one search tree lasts.
    """
    if model.is_symmetric:
        return 1e3 * float(_tree(model).query(apply(inverse(T_est) @ T_gt, model.points))[0].mean())
    return 1e3 * _mean_distance(model.points, T_est - T_gt)


@lru_cache(maxsize=64)
def _tree(model: ObjectModel) -> KDTree:
    return KDTree(model.points)


@njit(cache=True)
def _mean_distance(points: Float, D: Float) -> float:
    """Mean length of what ``D`` (4, 4), the difference of two poses, makes of points (n, 3)."""
    total = 0.0
    for p in points:
        x = D[0, 0] * p[0] + D[0, 1] * p[1] + D[0, 2] * p[2] + D[0, 3]
        y = D[1, 0] * p[0] + D[1, 1] * p[1] + D[1, 2] * p[2] + D[1, 3]
        z = D[2, 0] * p[0] + D[2, 1] * p[1] + D[2, 2] * p[2] + D[2, 3]
        total += math.sqrt(x * x + y * y + z * z)
    return total / len(points)


@njit(cache=True)
def _turn_and_shift(T_est: Float, T_gt: Float, symmetries: Float) -> tuple[float, float]:
    """Angle to the nearest of the poses that look the same [deg], from the traces alone (to 1e-5°, enough for a curve),
    and distance of the origins.
    """
    largest = -1.0
    for S in symmetries:
        trace = 0.0
        for i in range(3):
            for j in range(3):
                for k in range(3):
                    trace += T_est[k, i] * T_gt[k, j] * S[j, i]
        largest = max(largest, (trace - 1.0) / 2.0)
    square = 0.0
    for k in range(3):
        square += (T_est[k, 3] - T_gt[k, 3]) ** 2
    return math.degrees(math.acos(min(1.0, largest))), math.sqrt(square)
