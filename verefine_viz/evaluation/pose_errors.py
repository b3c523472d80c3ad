"""Errors of an estimated pose against ground truth, on sampled points."""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial import KDTree

from verefine_viz.core.accuracy import PoseErrors
from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import apply, inverse
from verefine_viz.core.kernels import kernel
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.problem import Target
from verefine_viz.evaluation.rotation_errors import rotation_error_deg
from verefine_viz.refiners.nearest import mean_distance, model_index

ROUNDED = 1e-6
"""How far RᵀR of a rotation may be from the identity before distances differ from frame to frame."""


def pose_errors(model: ObjectModel, T_est: Float, T_gt: Float) -> PoseErrors:
    """Errors of ``T_est`` (4, 4) against ``T_gt`` (4, 4), measured on the model's sampled points."""
    add, adds = add_mm(model, T_est, T_gt), adds_mm(model, T_est, T_gt)
    add_s = adds if model.is_symmetric else add
    return PoseErrors(
        rotation_error_deg(model, T_est, T_gt),
        float(np.linalg.norm(T_est[:3, 3] - T_gt[:3, 3])) * 1e3,
        add,
        adds,
        add_s,
        add_s / (model.diameter_m * 1e3),
    )


def add_s_mm(model: ObjectModel, T_est: Float, T_gt: Float) -> float:
    """``PoseErrors.add_s_mm`` alone: only symmetric objects need a search, so for others it is far cheaper."""
    return adds_mm(model, T_est, T_gt) if model.is_symmetric else add_mm(model, T_est, T_gt)


def add_mm(model: ObjectModel, T_est: Float, T_gt: Float) -> float:
    """``PoseErrors.add_mm`` alone."""
    return 1e3 * _mean_length(model.points, T_est - T_gt)


def adds_mm(model: ObjectModel, T_est: Float, T_gt: Float) -> float:
    """``PoseErrors.adds_mm`` alone; searched in the model's frame, for which one index lasts."""
    T_est_gt, skew = _relative(T_est, T_gt)
    if skew > ROUNDED:
        return 1e3 * float(KDTree(apply(T_est, model.points)).query(apply(T_gt, model.points))[0].mean())
    return 1e3 * mean_distance(model.points, T_est_gt, model_index(model))


@kernel()
def _relative(T_est: Float, T_gt: Float) -> tuple[Float, float]:
    """``T_gt`` as seen from ``T_est`` (4, 4), and the largest element of RᵀR − I of the latter."""
    out = np.eye(4)
    skew = 0.0
    for i in range(3):
        for j in range(4):
            out[i, j] = 0.0
            for k in range(3):
                out[i, j] += T_est[k, i] * (T_gt[k, j] - (T_est[k, 3] if j == 3 else 0.0))
        for j in range(3):
            product = -1.0 if i == j else 0.0
            for k in range(3):
                product += T_est[k, i] * T_est[k, j]
            skew = max(skew, abs(product))
    return out, skew


@kernel()
def _mean_length(points: Float, D: Float) -> float:
    """Mean length of what ``D`` (4, 4), the difference of two poses, makes of points (n, 3)."""
    total = 0.0
    for p in points:
        x = D[0, 0] * p[0] + D[0, 1] * p[1] + D[0, 2] * p[2] + D[0, 3]
        y = D[1, 0] * p[0] + D[1, 1] * p[1] + D[1, 2] * p[2] + D[1, 3]
        z = D[2, 0] * p[0] + D[2, 1] * p[1] + D[2, 2] * p[2] + D[2, 3]
        total += math.sqrt(x * x + y * y + z * z)
    return total / len(points)


def _add_over_symmetries_mm(model: ObjectModel, T_est: Float, T_gt: Float) -> float:
    """The smallest ADD over the poses that look like ground truth by the declared symmetries [mm]; ADD-S is no larger.

    ADD-S takes each point's nearest neighbour, and so a slim object for right that is clearly turned.
    """
    return min(add_mm(model, T_est, T_gt @ S) for S in model.symmetries)


def add_where_add_s_is_below(target: Target, T_est: Float, share: float) -> float | None:
    """ADD over the declared symmetries as a share of the diameter, where ADD-S is below ``share`` and it is not.

    None where both agree, the model has no symmetry, or ground truth is unknown.
    """
    model, T_gt = target.model, target.instance.T_cam_obj_gt
    limit_mm = share * model.diameter_m * 1e3
    if T_gt is None or not model.is_symmetric or adds_mm(model, T_est, T_gt) >= limit_mm:
        return None
    add_mm = _add_over_symmetries_mm(model, T_est, T_gt)
    return None if add_mm < limit_mm else add_mm / (model.diameter_m * 1e3)


class ErrorOf:
    """ADD(-S) of many poses of a model against one ground-truth pose, as a share of the diameter."""

    def __init__(self, model: ObjectModel, T_cam_obj_gt: Float) -> None:
        self._model = model
        self._points_gt = apply(T_cam_obj_gt, model.points)
        # The nearest estimated point is searched in the model's frame, where one tree serves all poses.
        self._tree = KDTree(model.points) if model.is_symmetric else None

    def __call__(self, T_cam_obj: Float) -> float:
        """As :func:`pose_errors` has it in ``relative``."""
        if self._tree is not None:
            distance_m = self._tree.query(apply(inverse(T_cam_obj), self._points_gt))[0]
        else:
            distance_m = np.linalg.norm(apply(T_cam_obj, self._model.points) - self._points_gt, axis=1)
        return float(np.mean(distance_m)) / self._model.diameter_m
