"""Does an object look the same when it is turned, though its model does not say so?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import angle_between, apply, axis_angle, inverse, transform
from verefine_viz.core.model import ObjectModel
from verefine_viz.diagnosis.case import ErrorOf
from verefine_viz.diagnosis.causes import instead
from verefine_viz.evaluation.pose_errors import adds_mm

SAME_SHARE, NOISE_M = 0.02, 0.0015
"""Two surfaces are the same if nearly all of each lies closer to the other than this share of the diameter. What turns
by any angle may be off by as much more as a depth sensor is [m] (real depth is 0.7 to 1.6 mm from true models): a can
that is 2.3 to 3.7 mm from round is round, but not the same upside down."""
NEARLY_ALL = 0.98
LEAST_TURN_RAD = np.radians(5.0)
"""Less of a turn is no symmetry but an error."""
STEPS = 30
SLIDES = 0.03
"""A motion is not made along which the surface changes less than this share of what it does along the others: about its
axis a can that is nearly round would be turned back to where it came from."""
TEXTURE = 0.05
"""Colours that differ by more in the mean can tell a turn."""
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
    colors_differ: float | None = None
    """By how much the colours of the model differ after the turn, in [0, 1]; None where it has none."""

    def in_words(self, name: str) -> str:
        """What it means for the answer of the object ``name``."""
        return (
            f"The {name} has the same shape when turned by {self.turn_deg:.0f}°, but its model declares no such "
            "symmetry, so that the turn counts as an error: with it declared, "
            f"{instead(self.error_with_symmetry, self.error)}.{self._of_texture()}"
        )

    def _of_texture(self) -> str:
        if self.colors_differ is None:
            return " Whether texture could tell is not known: the model has no colours."
        if self.colors_differ < TEXTURE:
            return " Its colours are alike as well."
        return " Its texture could tell, as colours differ there; depth cannot."


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
    return UndeclaredTurn(turn_deg, error, with_symmetry, _colors_differ(model, S))


def _colors_differ(model: ObjectModel, S: Float) -> float | None:
    """Mean difference of a vertex' colour to that of the nearest one after the turn, in [0, 1]."""
    if model.vertex_colors is None:
        return None
    nearest = KDTree(model.vertices).query(apply(S, model.vertices))[1]
    colors = model.vertex_colors / 255.0
    return float(np.abs(colors - colors[nearest]).mean())


def nearby_symmetry(model: ObjectModel, T: Float) -> Float | None:
    """The transform (4, 4) near ``T`` that maps the model's surface onto itself; None where there is none.

    ``T`` is a transform of the object's frame, such as what lies between an estimate and ground truth.
    """
    surface = _Surface(model)
    S = np.array(T)
    for _ in range(STEPS):
        moved, to, n = surface.matched(S)
        step = _step(moved, to, n, surface.middle, surface.size_m)
        S = step @ S
        if np.abs(step - np.eye(4)).max() < 1e-6:
            break
    if angle_between(np.eye(3), S[:3, :3]) <= LEAST_TURN_RAD:
        return None
    apart_m, limit_m = surface.apart_m(S), SAME_SHARE * model.diameter_m
    if apart_m < limit_m:
        return S
    is_nearly = apart_m < limit_m + NOISE_M
    return S if is_nearly and surface.apart_m(_half(S)) < limit_m + NOISE_M else None


def _half(S: Float) -> Float:
    """The motion (4, 4) that makes ``S`` when it is made twice, by half of its angle about the same axis."""
    R = Rotation.from_rotvec(0.5 * Rotation.from_matrix(S[:3, :3]).as_rotvec()).as_matrix()
    return transform(R, np.linalg.solve(R + np.eye(3), S[:3, 3]))


class _Surface:
    """Points of a model that are looked up by place and normal, so that the sides of a thin wall stay apart."""

    def __init__(self, model: ObjectModel) -> None:
        self.points, self.normals = model.points, model.point_normals
        self.middle = self.points.mean(axis=0)
        self.size_m = float(np.linalg.norm(self.points - self.middle, axis=1).mean())
        """Mean distance of the surface from its middle [m]."""
        self._weight_m = NORMAL_WEIGHT * model.diameter_m
        self._tree = KDTree(np.hstack([self.points, self._weight_m * self.normals]))
        nearest_m = KDTree(self.points).query(self.points, k=2)[0][:, 1]
        self.spacing_m = 2 * float(np.quantile(nearest_m, 0.99))
        """How far a point of the surface can be from the nearest sample [m]."""

    def apart_m(self, S: Float) -> float:
        """How far nearly all of the surface moved by ``S`` lies from the surface at most [m]."""
        moved, to, n = self.matched(S)
        aside_m = np.abs(np.einsum("ij,ij->i", moved - to, n))
        apart_m = np.maximum(aside_m, np.linalg.norm(moved - to, axis=1) - self.spacing_m)
        return float(np.quantile(apart_m, NEARLY_ALL))

    def matched(self, S: Float) -> tuple[Float, Float, Float]:
        """The points moved by ``S``, and the points and normals that they fall upon."""
        moved, turned = apply(S, self.points), self.normals @ S[:3, :3].T
        nearest = self._tree.query(np.hstack([moved, self._weight_m * turned]))[1]
        return moved, self.points[nearest], self.normals[nearest]


def _step(moved: Float, to: Float, n: Float, pivot: Float, size_m: float) -> Float:
    """The small motion (4, 4) that brings points closer to the planes through others: point-to-plane ICP.

    Turns are about ``pivot`` and measured by how far they move a point at ``size_m`` from it.
    """
    A = np.concatenate([np.cross((moved - pivot) / size_m, n), n], axis=1)
    b = np.einsum("ij,ij->i", to - moved, n)
    x = np.linalg.pinv(A.T @ A, rcond=SLIDES, hermitian=True) @ (A.T @ b)
    rotation = x[:3] / size_m
    angle = float(np.linalg.norm(rotation))
    R = axis_angle(rotation, angle) if angle > 1e-12 else np.eye(3)
    return transform(R, pivot + x[3:] - R @ pivot)
