"""Turns under which a model's shape nearly looks the same: what depth alone can hardly tell apart.

They are searched for on the mesh: a grid of all rotations is compared in a distance field, the best are aligned with
the surface (point-to-plane ICP of the surface onto itself), and what stays apart by little in the mean is listed.
Nothing that a data set declares is used (docs/methods.md 1.11). Cached on disk by the hash of the mesh.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from weakref import WeakKeyDictionary

import numpy as np
import platformdirs
from numpy.typing import ArrayLike
from scipy.ndimage import distance_transform_edt
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from verefine_viz.core.array_cache import Arrays, cached
from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import axis_angle, inverse, rotation_vector, transform
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.progress_token import NEVER_CANCELLED, ProgressToken

FORMAT = 1
"""Part of the cache's file names; raise it when the same mesh would give another list."""
NEAR_SHARE = 0.018
"""A shape nearly looks the same if its surface stays apart by less than this share of the diameter in the mean. Of
YCB-V, turned about their axes, the mug is at 1.0 % and the pitcher at 1.7 %, the power drill turned over at 2.4 %."""
LEAST_TURN_RAD = np.radians(30.0)
"""Least turn that is searched; smaller ones are left to the refiner."""
SAME_RAD = np.radians(25.0)
"""Angle below which two turns, or two axes, count as one."""
SAME_AXIS = float(np.cos(SAME_RAD))

N_POINTS = 6000
"""Points of the mesh that represent its surface."""
N_ROTATIONS = 4000
"""Rotations of the grid: at most 15° from any other rotation."""
N_STARTS, START_SHARE = 60, 0.08
"""Most rotations of the grid that are aligned, and how far apart they may leave the surface [diameters]."""
START_APART_RAD = np.radians(18.0)
FIELD_CELLS = 64
"""Cells of the distance field along a diameter."""
LEVELS = ((150, 8, 0.04), (400, 8, 0.025))
"""Points and steps of each round of the alignment, and what share of the diameter may be left after it."""
ROBUST_SHARE = 0.02
"""Points further from the surface than this share of the diameter count little: handles and spouts."""
SLIDES = 0.03
"""A motion is not made along which the surface changes less than this share of what it does along the others: about its
axis a can that is nearly round would be turned back to where it came from."""
N_MEASURED = 1000
"""Points whose distances make the mean."""
PROFILE_DEG = np.arange(10.0, 181.0, 10.0)
"""Turns about an axis, all of which must leave the surface near if any turn is to count."""
MOST_AXES, AXES_OF_BALL = 6, 3
"""Different axes that are tried as continuous ones, and how many are enough of a ball's."""
LARGEST_ORDER = 12
TURNS_DEG = (4, 8, 16, 32, 64, 96, 128, 160, 180, -160, -128, -96, -64, -32, -16, -8, -4)
"""Turns that represent all turns about a continuous axis: dense where a pose is nearly right."""
DIGITS = 6
"""Decimals of rotation vectors and translations, so that machines that round otherwise agree."""


@dataclass(frozen=True, eq=False)
class NearSymmetry:
    """One turn, or all turns about an axis, after which the shape nearly looks the same."""

    T_obj_obj: Float
    """(4, 4) moves the object in its own frame [m]; the half turn of a continuous axis. Not the identity."""
    distance_m: float
    """Mean distance between the surface and the moved surface, both ways [m]; of a continuous axis the largest."""
    is_continuous: bool = False

    @cached_property
    def axis(self) -> Float:
        """(3,) unit vector of the axis, object frame; that of a half turn, which is both ways the same, looks up."""
        vector = rotation_vector(self.T_obj_obj[:3, :3])
        is_down = self.angle_deg > 179 and vector[np.argmax(np.abs(vector))] < 0
        return vector / np.linalg.norm(vector) * (-1 if is_down else 1)

    @cached_property
    def centre_m(self) -> Float:
        """(3,) the point of the axis that is next to the frame's origin [m]."""
        return _centre(self.T_obj_obj)

    @property
    def angle_deg(self) -> float:
        return float(np.degrees(np.linalg.norm(rotation_vector(self.T_obj_obj[:3, :3]))))

    @property
    def order(self) -> int | None:
        """n, where it is one of the turns of an n-fold axis; None for any turn, or one that is no part of a circle."""
        if self.is_continuous:
            return None
        return next((n for n in range(2, LARGEST_ORDER) if abs(math.remainder(n * self.angle_deg, 360)) < n), None)

    def turned(self, angle_rad: float) -> Float:
        """The turn (4, 4) about the axis by another angle."""
        R = axis_angle(self.axis, angle_rad)
        return transform(R, self.centre_m - R @ self.centre_m)


_known: WeakKeyDictionary[ObjectModel, tuple[NearSymmetry, ...]] = WeakKeyDictionary()
"""Near-symmetries of the models of all frames, which share them."""


def near_symmetries(
    model: ObjectModel, folder: Path | None = None, progress: ProgressToken = NEVER_CANCELLED
) -> tuple[NearSymmetry, ...]:
    """Near-symmetries of a model: continuous axes first, then by distance. Takes about a second, once per mesh.

    Args:
        model: only its mesh and its diameter are used.
        folder: the cache; None = the user's. A damaged or unwritable cache costs time only.
        progress: asked on the way.

    Raises:
        Cancelled: through ``progress``; nothing is cached.
    """
    if folder is None and model in _known:
        return _known[model]
    known = _cached(model, folder, progress)
    if folder is None:
        _known[model] = known
    return known


def _cached(model: ObjectModel, folder: Path | None, progress: ProgressToken) -> tuple[NearSymmetry, ...]:
    folder = folder or Path(platformdirs.user_cache_dir("verefine-viz")) / "symmetries"
    file = folder / f"{model.mesh_hash}-{1e6 * model.diameter_m:.0f}um-v{FORMAT}.npz"
    return cached(
        file,
        lambda: sought(model, progress),
        _unpacked,
        _packed,
        progress.checkpoint,
        preparing=f"Seeking the near-symmetries of {model.name}; cached once they are known.",
        waiting=f"Waiting for the near-symmetries of {model.name}, which another process seeks.",
    )


def flips(symmetries: Sequence[NearSymmetry]) -> Float:
    """Turns (N, 4, 4) of the object's frame that stand for all near-symmetries: ``T_cam_obj @ flip`` looks alike."""
    about = [s.turned(np.radians(deg)) for s in symmetries if s.is_continuous for deg in TURNS_DEG]
    single = [s.T_obj_obj @ T for s in symmetries if not s.is_continuous for T in (np.eye(4), *about)]
    return np.array([*about, *single]).reshape(-1, 4, 4)


def sought(model: ObjectModel, progress: ProgressToken = NEVER_CANCELLED) -> tuple[NearSymmetry, ...]:
    """:func:`near_symmetries` without the cache.

    Raises:
        Cancelled: through ``progress``.
    """
    surface = OrientedPoints(*sampled(model), model.diameter_m)
    limit_m = NEAR_SHARE * model.diameter_m
    progress.checkpoint()
    T = _starts(surface)
    for n_points, n_steps, share in LEVELS:
        progress.checkpoint()
        T = surface.aligned(T, n_points, n_steps)
        T = T[surface.apart_m(T, n_points).mean(axis=1) < share * model.diameter_m]
    progress.checkpoint()
    turns = [_rounded(one) for one in T if Rotation.from_matrix(one[:3, :3]).magnitude() > LEAST_TURN_RAD]
    distance_m = surface.distance_m(np.array(turns).reshape(-1, 4, 4))
    near = [NearSymmetry(turns[k], float(distance_m[k])) for k in np.argsort(distance_m, kind="stable")]
    near = [one for one in near if one.distance_m < limit_m]
    axes = _continuous(surface, near, limit_m, progress)
    if len(axes) > 1:  # About more than one axis: a ball.
        return tuple(axes)
    single: list[NearSymmetry] = []
    for one in near:
        if not any(_is_same(one, other, axes) for other in single) and not any(_is_about(one, axis) for axis in axes):
            single.append(one)
    return (*axes, *single)


class OrientedPoints:
    """Points of a surface that are looked up by place and normal, so that the sides of a thin wall stay apart."""

    NORMAL_WEIGHT = 0.05
    """A normal turned by 1 rad counts as this share of the diameter in the look-up."""

    def __init__(self, points: Float, normals: Float, diameter_m: float) -> None:
        """
        Args:
            points: (N, 3), in an order in which any first part is spread over the surface [m].
            normals: (N, 3) outward.
            diameter_m: of the object [m].
        """
        self.points, self.normals, self.diameter_m = points, normals, diameter_m
        self.middle = points.mean(axis=0)
        self._tree = KDTree(np.hstack([points, self.NORMAL_WEIGHT * diameter_m * normals]))
        nearest_m = KDTree(points).query(points, k=2)[0][:, 1]
        self.spacing_m = 2 * float(np.quantile(nearest_m, 0.99))
        """How far a point of the surface can be from the nearest sample [m]."""

    def matched(self, T: Float, n: int) -> tuple[Float, Float, Float]:
        """The first ``n`` points moved by each of (k, 4, 4), and the points and normals that they fall upon, (k, n, 3)
        each.
        """
        moved = np.einsum("kij,nj->kni", T[:, :3, :3], self.points[:n]) + T[:, None, :3, 3]
        turned = np.einsum("kij,nj->kni", T[:, :3, :3], self.normals[:n])
        both = np.concatenate([moved, self.NORMAL_WEIGHT * self.diameter_m * turned], axis=-1)
        nearest = self._tree.query(both.reshape(-1, 6))[1].reshape(moved.shape[:2])
        return moved, self.points[nearest], self.normals[nearest]

    def apart_m(self, T: Float, n: int) -> Float:
        """(k, n) how far the first ``n`` points, moved by each of (k, 4, 4), are from the surface [m]."""
        moved, to, normals = self.matched(T, n)
        aside_m = np.abs(np.einsum("kni,kni->kn", moved - to, normals))
        return np.maximum(aside_m, np.linalg.norm(moved - to, axis=-1) - self.spacing_m)

    def distance_m(self, T: Float) -> Float:
        """(k,) mean distance of the surface moved by each of (k, 4, 4) from the surface, and back [m]."""
        if len(T) == 0:
            return np.zeros(0)
        both = np.array([*T, *(inverse(one) for one in T)])
        return self.apart_m(both, N_MEASURED).mean(axis=1).reshape(2, -1).mean(axis=0)

    def aligned(self, T: Float, n: int, n_steps: int) -> Float:
        """Each of (k, 4, 4) after ``n_steps`` that bring the first ``n`` points closer to the planes through those that
        they fall upon: point-to-plane ICP. Turns are about the middle; what slides along the surface stays.
        """
        lever_m = float(np.linalg.norm(self.points - self.middle, axis=1).mean())
        T = np.array(T)
        for _ in range(n_steps if len(T) else 0):
            moved, to, normals = self.matched(T, n)
            weight = 1 / (1 + (np.linalg.norm(moved - to, axis=-1) / (ROBUST_SHARE * self.diameter_m)) ** 2)
            A = np.concatenate([np.cross((moved - self.middle) / lever_m, normals), normals], axis=-1)
            b = np.einsum("kni,kni->kn", to - moved, normals)
            H = np.einsum("kn,kni,knj->kij", weight, A, A)
            x = np.einsum(
                "kij,kn,knj,kn->ki", np.linalg.pinv(H, rcond=SLIDES, hermitian=True), weight, A, b, optimize=True
            )
            R = Rotation.from_rotvec(x[:, :3] / lever_m).as_matrix()
            T[:, :3, 3] = np.einsum("kij,kj->ki", R, T[:, :3, 3] - self.middle) + self.middle + x[:, 3:]
            T[:, :3, :3] = R @ T[:, :3, :3]
        return T


def sampled(model: ObjectModel) -> tuple[Float, Float]:
    """Points (N, 3) spread evenly over the mesh in random order, and their normals: the same at each call."""
    a, b, c = (model.vertices[model.faces[:, k]] for k in range(3))
    cross = np.cross(b - a, c - a)
    double_area = np.linalg.norm(cross, axis=1)
    share = np.cumsum(double_area) / double_area.sum()
    i = np.minimum(np.searchsorted(share, (np.arange(N_POINTS) + 0.5) / N_POINTS), len(share) - 1)
    rng = np.random.default_rng(0)
    r, s = np.sqrt(rng.random((N_POINTS, 1))), rng.random((N_POINTS, 1))
    points = (1 - r) * a[i] + r * (1 - s) * b[i] + r * s * c[i]
    order = rng.permutation(N_POINTS)
    return points[order], (cross[i] / double_area[i, None])[order]


def _rotation_grid(n: int) -> Float:
    """``n`` rotations (n, 3, 3) that are spread evenly over all: a super-Fibonacci spiral (Alexa, CVPR 2022)."""
    phi, psi = math.sqrt(2), 1.533751168755204288118041
    s = np.arange(n) + 0.5
    r, R, a, b = np.sqrt(s / n), np.sqrt(1 - s / n), 2 * np.pi * s / phi, 2 * np.pi * s / psi
    return Rotation.from_quat(
        np.stack([r * np.sin(a), r * np.cos(a), R * np.sin(b), R * np.cos(b)], axis=1)
    ).as_matrix()


def _starts(surface: OrientedPoints) -> Float:
    """Turns about the middle (k, 4, 4) after which the surface is not far from where it was, apart from each other."""
    points, d = surface.points - surface.middle, surface.diameter_m
    low, cell_m = points.min(axis=0) - 0.3 * d, d / FIELD_CELLS
    shape = np.ceil((np.ptp(points, axis=0) + 0.6 * d) / cell_m).astype(int) + 1
    is_empty = np.ones(shape, bool)
    is_empty[tuple(((points - low) / cell_m).astype(int).T)] = False
    field_m = np.asarray(distance_transform_edt(is_empty)) * cell_m
    R = _rotation_grid(N_ROTATIONS)
    at = [((np.einsum("kij,nj->kni", part, points[:200]) - low) / cell_m).astype(int) for part in np.split(R, 8)]
    far_m = np.concatenate([field_m[tuple(np.moveaxis(np.clip(i, 0, shape - 1), -1, 0))].mean(axis=1) for i in at])
    quats = Rotation.from_matrix(R).as_quat()
    is_free = np.abs(quats[:, 3]) < np.cos(LEAST_TURN_RAD / 4)
    chosen: list[int] = []
    for k in np.argsort(far_m, kind="stable").tolist():
        if far_m[k] > START_SHARE * d or len(chosen) == N_STARTS:
            break
        if is_free[k]:
            chosen.append(k)
            is_free &= np.abs(quats @ quats[k]) < np.cos(START_APART_RAD / 2)
    return np.array([transform(R[k], surface.middle - R[k] @ surface.middle) for k in chosen]).reshape(-1, 4, 4)


def _continuous(
    surface: OrientedPoints, near: Sequence[NearSymmetry], limit_m: float, progress: ProgressToken
) -> list[NearSymmetry]:
    """The axes of some turns about which any turn leaves the surface near."""
    tried: list[NearSymmetry] = []
    axes: list[NearSymmetry] = []
    for one in near:
        if len(tried) == MOST_AXES or len(axes) == AXES_OF_BALL:
            break
        if any(abs(one.axis @ other.axis) > SAME_AXIS for other in tried):
            continue
        progress.checkpoint()
        tried.append(one)
        profile_m = surface.distance_m(np.array([one.turned(np.radians(deg)) for deg in PROFILE_DEG]))
        if profile_m.max() < limit_m:
            axes.append(NearSymmetry(_rounded(one.turned(np.pi)), float(profile_m.max()), is_continuous=True))
    return axes


def _is_about(one: NearSymmetry, axis: NearSymmetry) -> bool:
    """Whether a turn is one of those about an axis."""
    return bool(axis.axis @ one.T_obj_obj[:3, :3] @ axis.axis > SAME_AXIS)


def _is_same(one: NearSymmetry, other: NearSymmetry, axes: Sequence[NearSymmetry]) -> bool:
    """Whether two turns differ by little, or by a turn about one of the axes."""
    between = NearSymmetry(inverse(one.T_obj_obj) @ other.T_obj_obj, 0.0)
    is_close = Rotation.from_matrix(between.T_obj_obj[:3, :3]).magnitude() < SAME_RAD
    return bool(is_close) or any(_is_about(between, axis) for axis in axes)


def _centre(T: Float) -> Float:
    """The fixed point of a turn that is next to the origin, without its motion along the axis."""
    return np.linalg.pinv(np.eye(3) - T[:3, :3], rcond=1e-6) @ T[:3, 3]


def _rounded(T: Float) -> Float:
    """The pose rounded to a few digits."""
    vector = np.round(rotation_vector(T[:3, :3]), DIGITS)
    return transform(axis_angle(vector, float(np.linalg.norm(vector))), np.round(T[:3, 3], DIGITS))


def _unpacked(arrays: Arrays) -> tuple[NearSymmetry, ...]:
    T, distance_m, is_continuous = arrays["T_obj_obj"], arrays["distance_m"], arrays["is_continuous"]
    n = len(distance_m) if distance_m.ndim == 1 else -1
    if T.shape != (n, 4, 4) or is_continuous.shape != (n,) or not (np.isfinite(T).all() and (distance_m >= 0).all()):
        raise ValueError("no list of near-symmetries")
    return tuple(NearSymmetry(T[k], float(distance_m[k]), bool(is_continuous[k])) for k in range(n))


def _packed(known: Sequence[NearSymmetry]) -> dict[str, ArrayLike]:
    return {
        "T_obj_obj": np.array([one.T_obj_obj for one in known]).reshape(-1, 4, 4),
        "distance_m": np.array([one.distance_m for one in known], np.float64),
        "is_continuous": np.array([one.is_continuous for one in known], bool),
    }
