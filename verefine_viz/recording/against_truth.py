"""How far each iteration is from ground truth, as fast as a recording needs it."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from verefine_viz.core.arrays import Float
from verefine_viz.core.problem import Target
from verefine_viz.core.records import Best, Iteration
from verefine_viz.evaluation.errors import add_s_mm


class AgainstTruth:
    """Judges iterations one after another; remembers each object's best pose, which seldom changes."""

    def __init__(self) -> None:
        self._best: dict[int, tuple[Best, float]] = {}

    def errors(self, target: Target, iteration: Iteration) -> Float:
        """What ``Entry.errors`` says. ADD(-S) goes over all points, so only when the best pose changed."""
        T_gt = target.instance.T_cam_obj_gt
        if T_gt is None:
            return _UNKNOWN
        best, T_kept = iteration.best, iteration.accepted_stage.T_cam_obj
        known, best_mm = self._best.get(iteration.instance_id, (None, 0.0))
        if known is not best:
            best_mm = add_s_mm(target.model, best.T_cam_obj, T_gt)
            self._best[iteration.instance_id] = best, best_mm
        rotation_deg, translation_m = _turn_and_shift(T_kept, T_gt, target.model.symmetries)
        return np.array([rotation_deg, 1e3 * translation_m, best_mm])


_UNKNOWN = np.full(3, np.nan)


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
