"""Rotation errors of an estimated pose: how far it is turned from ground truth, and which way."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import apply, axis_angle, quat_wxyz
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.problem import Target

ROLLS = 0.05
"""Change of height, as a share of an object's size, that does not count."""
LEAST_TILT = 1e-6
"""Sine of the least tilt that counts."""


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
    if sine < LEAST_TILT:
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
