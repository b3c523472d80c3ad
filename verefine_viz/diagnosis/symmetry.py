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


def nearby_symmetry(model: ObjectModel, T: Float) -> Float | None:
    """The transform (4, 4) near ``T`` that maps the model's surface onto itself; None where there is none.

    ``T`` is a transform of the object's frame, such as what lies between an estimate and the truth.
    """
    points, normals = model.points, model.point_normals
    tree = KDTree(points)
    S = np.array(T)
    for _ in range(STEPS):
        moved = apply(S, points)
        step = _step(moved, *_nearest(tree, points, normals, moved))
        S = step @ S
        if np.abs(step - np.eye(4)).max() < 1e-6:
            break
    moved = apply(S, points)
    to, n = _nearest(tree, points, normals, moved)
    aside_m = np.abs(np.einsum("ij,ij->i", moved - to, n))
    facing = np.einsum("ij,ij->i", normals @ S[:3, :3].T, n)
    apart_m = np.maximum(aside_m, np.linalg.norm(moved - to, axis=1) - _spacing_m(tree, points))
    same = np.quantile(apart_m, NEARLY_ALL) < SAME_SHARE * model.diameter_m and np.mean(facing > 0) > 0.95
    turned = angle_between(np.eye(3), S[:3, :3]) > LEAST_TURN_RAD
    return S if same and turned else None


def _nearest(tree: KDTree, points: Float, normals: Float, moved: Float) -> tuple[Float, Float]:
    found = tree.query(moved)[1]
    return points[found], normals[found]


def _spacing_m(tree: KDTree, points: Float) -> float:
    """How far a point of the surface can be from the nearest sample."""
    return float(np.quantile(tree.query(points, k=2)[0][:, 1], 0.99))


def _step(moved: Float, to: Float, n: Float) -> Float:
    """The small motion (4, 4) that brings points closer to the planes through others: point-to-plane ICP."""
    A = np.concatenate([np.cross(moved, n), n], axis=1)
    b = np.einsum("ij,ij->i", to - moved, n)
    x = np.linalg.lstsq(A, b, rcond=1e-4)[0]
    angle = float(np.linalg.norm(x[:3]))
    R = axis_angle(x[:3], angle) if angle > 1e-12 else np.eye(3)
    return transform(R, x[3:])
