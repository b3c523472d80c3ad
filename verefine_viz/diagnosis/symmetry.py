"""Tests whether an object looks the same after a turn that its model does not declare."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import angle_between, inverse, transform
from verefine_viz.core.model import ObjectModel
from verefine_viz.diagnosis.undeclared_turn import UndeclaredTurn
from verefine_viz.evaluation.near_symmetry import OrientedPoints
from verefine_viz.evaluation.pose_errors import ErrorOf, adds_mm
from verefine_viz.evaluation.proposed_symmetries import NEARLY_ALL, NOISE_M, colors_differ

SAME_SHARE = 0.02
"""Two surfaces are the same if nearly all of each lies closer to the other than this share of the diameter. What turns
by any angle may be off by as much more as a depth sensor is (``NOISE_M``): a can that is 2.3 to 3.7 mm from round is
round, but not the same upside down."""
LEAST_TURN_RAD = np.radians(5.0)
"""Least turn of a symmetry; a smaller one is an error."""
STEPS = 30


def undeclared_turn(model: ObjectModel, T_est: Float, T_gt: Float, threshold: float) -> UndeclaredTurn | None:
    """The turn that makes an estimate count as wrong though the object looks the same; None where that is not why.

    The error that decides knows declared symmetries only, so that such an answer counts as wrong everywhere. Whether it
    looks wrong is another question: colour, in which the sides may differ, is ignored.

    Args:
        model: the object.
        T_est: (4, 4) the estimate.
        T_gt: (4, 4) ground truth.
        threshold: an estimate is wrong if its ADD(-S) is at least this share of the diameter.
    """
    error_of = ErrorOf(model, T_gt)
    error = error_of(T_est)
    # A pose that looks the same has its surface at that of ground truth: a cheap test first.
    if error < threshold or adds_mm(model, T_est, T_gt) * 1e-3 >= threshold * model.diameter_m:
        return None
    S = nearby_symmetry(model, inverse(T_est) @ T_gt)
    if S is None:
        return None
    # The estimate p and the ground truth p S⁻¹ show the same surface.
    with_symmetry = error_of(T_est @ S)
    if with_symmetry >= threshold:
        return None
    turn_deg = float(np.rad2deg(angle_between(np.eye(3), S[:3, :3])))
    return UndeclaredTurn(turn_deg, error, with_symmetry, colors_differ(model, S))


def nearby_symmetry(model: ObjectModel, T: Float) -> Float | None:
    """The transform (4, 4) near ``T`` that maps the model's surface onto itself; None where there is none.

    ``T`` is a transform of the object's frame, such as what lies between an estimate and ground truth.
    """
    surface, n = OrientedPoints(model.points, model.point_normals, model.diameter_m), len(model.points)

    def apart_m(S: Float) -> float:
        """How far nearly all of the surface moved by ``S`` lies from the surface at most [m]."""
        return float(np.quantile(surface.apart_m(S[None], n), NEARLY_ALL))

    S = surface.aligned(T[None], n, STEPS)[0]
    if angle_between(np.eye(3), S[:3, :3]) <= LEAST_TURN_RAD:
        return None
    far_m, limit_m = apart_m(S), SAME_SHARE * model.diameter_m
    if far_m < limit_m:
        return S
    return S if far_m < limit_m + NOISE_M and apart_m(_half(S)) < limit_m + NOISE_M else None


def _half(S: Float) -> Float:
    """The motion (4, 4) that makes ``S`` when it is made twice, by half of its angle about the same axis."""
    R = Rotation.from_rotvec(0.5 * Rotation.from_matrix(S[:3, :3]).as_rotvec()).as_matrix()
    return transform(R, np.linalg.solve(R + np.eye(3), S[:3, 3]))
