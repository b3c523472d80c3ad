"""Errors of an estimated pose against ground truth, on sampled points; and which way it is turned."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import KDTree

from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import apply, axis_angle, quat_wxyz
from verefine_viz.core.kernels import kernel
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.problem import Target
from verefine_viz.refiners.nearest import mean_distance, model_index

ROLLS = 0.05
"""Heights that change by less of an object's size do not change."""
ROUNDED = 1e-6
"""How far RᵀR of a rotation may be from the identity before distances differ from frame to frame."""


@dataclass(frozen=True)
class PoseErrors:
    """How far an estimate is from ground truth."""

    rotation_deg: float
    """Angle to the nearest of the poses that look the same [deg]."""
    translation_mm: float
    """Distance of the object's origin [mm]."""
    add_mm: float
    """Mean distance of corresponding model points [mm] (Hinterstoisser 2012)."""
    adds_mm: float
    """Mean distance of ground-truth points to the nearest estimated point [mm] (Xiang 2018)."""
    add_s_mm: float
    """ADD-S for symmetric objects, ADD for the others [mm]: the usual ADD(-S)."""
    relative: float
    """ADD(-S) as a share of the diameter; below 0.1 counts as correct."""


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


def add_over_symmetries_mm(model: ObjectModel, T_est: Float, T_gt: Float) -> float:
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
    add_mm = add_over_symmetries_mm(model, T_est, T_gt)
    return None if add_mm < limit_mm else add_mm / (model.diameter_m * 1e3)


def rotation_error_deg(model: ObjectModel, T_est: Float, T_gt: Float) -> float:
    """Smallest angle [deg] between the estimate and ground truth turned by any of the model's symmetries."""
    return float(np.rad2deg(symmetric_angles_rad(model, T_est, T_gt).min()))


def symmetric_angles_rad(model: ObjectModel, T_est: Float, T_gt: Float) -> Float:
    """(S,) angle between the estimate and ground truth turned by each of the model's symmetries [rad]."""
    R_rest = T_est[:3, :3].T @ T_gt[:3, :3] @ model.symmetries[:, :3, :3]
    # sin from the antisymmetric part: exact near 0, where acos loses half of its digits.
    sine = np.linalg.norm(
        [R_rest[:, 2, 1] - R_rest[:, 1, 2], R_rest[:, 0, 2] - R_rest[:, 2, 0], R_rest[:, 1, 0] - R_rest[:, 0, 1]],
        axis=0,
    )
    cosine = np.trace(R_rest, axis1=1, axis2=2) - 1
    return np.arctan2(sine, cosine)


@dataclass(frozen=True)
class Turning:
    """A rotation R as a turn about an axis, then a tilt of that axis: R = tilt · turn.

    The tilt is about an axis at right angles to the first one; both angles are from 0 to 180°. They do not add up:
    cos(R / 2) = cos(tilt / 2) · cos(turn / 2), so that small ones add up like the sides of a right angle.
    """

    tilt_deg: float
    """Angle between the axis and where R takes it [deg]."""
    turn_deg: float
    """Angle of the turn about the axis; 0 where the tilt is 180°, which leaves none [deg]."""
    rolls: bool = False
    """Whether the tilt leaves the object as high as it is, as a lying can that rolls."""

    def describe(self, digits: int = 1) -> str:
        """Both parts: "3.6° of tilt against the table, 8.8° of turn on it"."""
        none_deg = 0.5 * 10.0**-digits
        tilt = "roll on the table" if self.rolls else "tilt against the table"
        if self.turn_deg < none_deg:
            return f"all of it {tilt}"
        if self.tilt_deg < none_deg:
            return "all of it a turn on the table"
        return f"{self.tilt_deg:.{digits}f}° of {tilt}, {self.turn_deg:.{digits}f}° of turn on it"


def turning(model: ObjectModel, T_est: Float, T_gt: Float, up_cam: Float) -> Turning:
    """The rotation from ground truth to the estimate, apart into tilt and turn.

    Of the poses that look like ground truth the one counts that the rotation error is measured against
    (:func:`rotation_error_deg`).

    Args:
        model: the object, with its symmetries.
        T_est: (4, 4) the estimate.
        T_gt: (4, 4) ground truth.
        up_cam: (3,) unit normal of the support plane, camera frame.
    """
    nearest = model.symmetries[np.argmin(symmetric_angles_rad(model, T_est, T_gt)), :3, :3]
    R = T_est[:3, :3] @ (T_gt[:3, :3] @ nearest).T
    return replace(turning_of(R, up_cam), rolls=_rolls(apply(T_gt, model.points), R, up_cam))


def _rolls(points_cam: Float, R: Float, up_cam: Float) -> bool:
    """Whether an object is as high above the middle of its points, and as deep below, all the way round a tilt."""
    middle = points_cam.mean(axis=0)
    size_m = float(np.linalg.norm(points_cam - middle, axis=1).max())
    across = np.cross(up_cam, R @ up_cam)
    sine = float(np.linalg.norm(across))
    if sine < ROUNDED:
        return False
    # The height after a turn, n · R x, is that of x along Rᵀ n.
    ups = np.array([axis_angle(across / sine, np.deg2rad(deg)).T @ up_cam for deg in range(0, 180, 30)])
    heights = (points_cam - middle) @ ups.T
    return bool(max(np.ptp(heights.max(axis=0)), np.ptp(heights.min(axis=0))) < ROLLS * size_m)


def turning_on(target: Target, T_est: Float) -> Turning | None:
    """Tilt and turn on the support plane; None where it, or ground truth, is unknown."""
    T_gt, support = target.instance.T_cam_obj_gt, target.observation.support
    if T_gt is None or support is None:
        return None
    return turning(target.model, T_est, T_gt, support.T_world_cam[:3, :3].T @ support.normal_world)


def turning_of(R: Float, axis: Float) -> Turning:
    """A rotation (3, 3) apart into its turn about a unit ``axis`` (3,) and the tilt of the axis."""
    w, *v = quat_wxyz(R)
    along = float(np.dot(v, axis))
    across = float(np.linalg.norm(np.array(v) - along * axis))
    tilt, turn = 2 * np.arctan2(across, np.hypot(w, along)), 2 * np.arctan2(abs(along), w)
    return Turning(float(np.rad2deg(tilt)), float(np.rad2deg(turn)))
