"""Does an object look the same when it is turned, though its model does not say so?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import angle_between, apply, axis_angle, inverse, transform
from verefine_viz.core.model import ObjectModel
from verefine_viz.diagnosis.case import ErrorOf
from verefine_viz.diagnosis.causes import instead
from verefine_viz.evaluation.pose_errors import adds_mm

SAME_SHARE = 0.02
"""Two surfaces are the same if nearly all of each lies closer to the other than this share of the diameter."""
NEARLY_ALL = 0.98
LEAST_TURN_RAD = np.radians(5.0)
"""Less of a turn is no symmetry but an error."""
STEPS = 30
NORMAL_WEIGHT = 0.1
"""A normal turned by 1 rad counts as this share of the diameter in the look-up."""


@dataclass(frozen=True)
class UndeclaredTurn:
    """An estimate that is right but for a turn after which the object has the same shape."""

    turn_deg: float
    error: float
    """Of the estimate, as a share of the diameter."""
    error_with_symmetry: float
    """What it would be if the model declared that turn."""

    def in_words(self, name: str) -> str:
        """What it means for the answer of the object ``name``."""
        return (
            f"The {name} has the same shape when turned by {self.turn_deg:.0f}°, but its model declares no such "
            "symmetry, so that the turn counts as an error: with it declared, "
            f"{instead(self.error_with_symmetry, self.error)}."
        )


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
    return UndeclaredTurn(float(np.rad2deg(angle_between(np.eye(3), S[:3, :3]))), error, with_symmetry)


def nearby_symmetry(model: ObjectModel, T: Float) -> Float | None:
    """The transform (4, 4) near ``T`` that maps the model's surface onto itself; None where there is none.

    ``T`` is a transform of the object's frame, such as what lies between an estimate and ground truth.
    """
    surface = _Surface(model)
    S = np.array(T)
    for _ in range(STEPS):
        moved, to, n = surface.matched(S)
        step = _step(moved, to, n)
        S = step @ S
        if np.abs(step - np.eye(4)).max() < 1e-6:
            break
    moved, to, n = surface.matched(S)
    aside_m = np.abs(np.einsum("ij,ij->i", moved - to, n))
    apart_m = np.maximum(aside_m, np.linalg.norm(moved - to, axis=1) - surface.spacing_m)
    same = np.quantile(apart_m, NEARLY_ALL) < SAME_SHARE * model.diameter_m
    turned = angle_between(np.eye(3), S[:3, :3]) > LEAST_TURN_RAD
    return S if same and turned else None


class _Surface:
    """Points of a model that are looked up by place and normal, so that the sides of a thin wall stay apart."""

    def __init__(self, model: ObjectModel) -> None:
        self.points, self.normals = model.points, model.point_normals
        self._weight_m = NORMAL_WEIGHT * model.diameter_m
        self._tree = KDTree(np.hstack([self.points, self._weight_m * self.normals]))
        nearest_m = KDTree(self.points).query(self.points, k=2)[0][:, 1]
        self.spacing_m = 2 * float(np.quantile(nearest_m, 0.99))
        """How far a point of the surface can be from the nearest sample [m]."""

    def matched(self, S: Float) -> tuple[Float, Float, Float]:
        """The points moved by ``S``, and the points and normals that they fall upon."""
        moved, turned = apply(S, self.points), self.normals @ S[:3, :3].T
        nearest = self._tree.query(np.hstack([moved, self._weight_m * turned]))[1]
        return moved, self.points[nearest], self.normals[nearest]


def _step(moved: Float, to: Float, n: Float) -> Float:
    """The small motion (4, 4) that brings points closer to the planes through others: point-to-plane ICP."""
    A = np.concatenate([np.cross(moved, n), n], axis=1)
    b = np.einsum("ij,ij->i", to - moved, n)
    # A motion along which nothing changes, such as a can's turn about its axis, is left out.
    x = np.linalg.pinv(A.T @ A, rcond=1e-8, hermitian=True) @ (A.T @ b)
    angle = float(np.linalg.norm(x[:3]))
    R = axis_angle(x[:3], angle) if angle > 1e-12 else np.eye(3)
    return transform(R, x[3:])
