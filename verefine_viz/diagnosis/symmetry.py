"""Does an object look the same when it is turned, though its model does not say so?"""

from __future__ import annotations

import numpy as np
from scipy.spatial import KDTree

from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import angle_between, apply, axis_angle, transform
from verefine_viz.core.model import ObjectModel

SAME_SHARE = 0.02
"""Two surfaces are the same if nearly all of each lies closer to the other than this share of the diameter."""
NEARLY_ALL = 0.98
LEAST_TURN_RAD = np.radians(5.0)
"""Less of a turn is no symmetry but an error."""
STEPS = 30
NORMAL_WEIGHT = 0.1
"""A normal turned by 1 rad counts as this share of the diameter in the look-up."""


def nearby_symmetry(model: ObjectModel, T: Float) -> Float | None:
    """The transform (4, 4) near ``T`` that maps the model's surface onto itself; None where there is none.

    ``T`` is a transform of the object's frame, such as what lies between an estimate and the truth.
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
        found = self._tree.query(np.hstack([moved, self._weight_m * turned]))[1]
        return moved, self.points[found], self.normals[found]


def _step(moved: Float, to: Float, n: Float) -> Float:
    """The small motion (4, 4) that brings points closer to the planes through others: point-to-plane ICP."""
    A = np.concatenate([np.cross(moved, n), n], axis=1)
    b = np.einsum("ij,ij->i", to - moved, n)
    # A motion along which nothing changes, such as a can's turn about its axis, is left out.
    x = np.linalg.pinv(A.T @ A, rcond=1e-8, hermitian=True) @ (A.T @ b)
    angle = float(np.linalg.norm(x[:3]))
    R = axis_angle(x[:3], angle) if angle > 1e-12 else np.eye(3)
    return transform(R, x[3:])
