"""Which way an estimate is turned against ground truth: tilted against the support plane, or turned round on it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import quat_wxyz
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.problem import Target
from verefine_viz.evaluation.errors import symmetric_angles_rad


@dataclass(frozen=True)
class Turning:
    """A rotation R as a turn about an axis, then a tilt of that axis: R = tilt · turn.

    The tilt is about an axis at right angles to the first one; both angles are from 0 to 180°. They do not add up:
    cos(R / 2) = cos(tilt / 2) · cos(turn / 2), so that small ones add up like the sides of a right angle.
    """

    tilt_deg: float
    """Angle between the axis and where R takes it [deg]."""
    turn_deg: float
    """Angle of the turn about the axis; 0 where the tilt is 180° and none can be told [deg]."""

    def in_words(self, digits: int = 1) -> str:
        """As in: 3.6° of tilt against the table, 8.8° of turn on it."""
        none_deg = 0.5 * 10.0**-digits
        if self.turn_deg < none_deg:
            return "all of it tilt against the table"
        if self.tilt_deg < none_deg:
            return "all of it a turn on the table"
        return f"{self.tilt_deg:.{digits}f}° of tilt against the table, {self.turn_deg:.{digits}f}° of turn on it"


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
    return turning_of(T_est[:3, :3] @ (T_gt[:3, :3] @ nearest).T, up_cam)


def turning_on(target: Target, T_est: Float) -> Turning | None:
    """The same on the support plane that was found; None where it, or ground truth, is not known."""
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
