"""Rigid transforms as 4×4 float64 matrices.

``T_a_b`` maps points of frame b into frame a: ``p_a = T_a_b @ p_b``. Chains cancel inside:
``T_world_obj = T_world_cam @ T_cam_obj``; the inverse swaps the names.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike

from verefine_viz.core.arrays import Float, finite, frozen, writable
from verefine_viz.core.errors import ShapeError

RIGID_TOLERANCE = 0.05
"""How far RᵀR may be from the identity in a pose from outside [-]. Published files have rounded rotations: LINEMOD's
are 0.01 off."""

ROUNDED = 1e-3
"""Deviation of RᵀR from which rotations of a file are counted, for one note [-]."""

ORTHONORMAL_TOLERANCE = 1e-9
"""Deviation of RᵀR below which a pose is left as it is [-]."""

FARTHEST_M = 100.0
"""Largest distance of an object from the camera [m]. A pose beyond comes from an estimator that failed, or from
millimetres taken for metres; the simulator cannot take it."""


def transform(R: ArrayLike, t: ArrayLike) -> Float:
    """The 4×4 transform of a rotation (3, 3) and a translation (3,)."""
    T = np.zeros((4, 4))
    T[:3, :3] = R
    T[:3, 3] = t
    T[3, 3] = 1.0
    return T


def inverse(T: Float) -> Float:
    """The inverse of one rigid transform (4, 4) or of many (…, 4, 4)."""
    R_t = np.swapaxes(T[..., :3, :3], -1, -2)
    out = np.zeros_like(T)
    out[..., :3, :3] = R_t
    out[..., :3, 3] = -(R_t @ T[..., :3, 3:])[..., 0]
    out[..., 3, 3] = 1.0
    return out


def distance_m(T_cam_obj: Float) -> float:
    """How far an object's origin is from the camera [m]."""
    x, y, z = T_cam_obj[:3, 3].tolist()
    return math.sqrt(x * x + y * y + z * z)


def apply(T: Float, points: Float) -> Float:
    """``points`` (N, 3) of frame b in frame a, given ``T_a_b``."""
    return points @ T[:3, :3].T + T[:3, 3]


def as_rigid(value: ArrayLike, name: str) -> Float:
    """A read-only rigid transform with the rotation nearest to the given one: the rule for all poses from outside.

    Raises:
        ShapeError: not 4×4, not finite, mirrored, or further from a rotation than ``RIGID_TOLERANCE``.
    """
    T = frozen(value, name, (4, 4))
    if _is_orthonormal(T):
        return T
    deviation, determinant, last_row = _deviations(T)
    exact = deviation <= ORTHONORMAL_TOLERANCE and last_row <= ORTHONORMAL_TOLERANCE and determinant > 0
    if exact and math.isfinite(float(T.sum())):
        return T  # Unchanged bits, so that checking a pose twice never changes it.
    finite(T, name, (4, 4))
    if deviation > RIGID_TOLERANCE or determinant <= 0:
        wrong = "it is a mirror image" if determinant < 0 else f"RᵀR is {deviation:.2g} from the identity"
        raise ShapeError(
            f"{name} is not rigid: det(R) = {determinant:.3f}, {wrong}; expected a rotation matrix with det +1, off by "
            f"{RIGID_TOLERANCE:g} at most"
        )
    if last_row > ORTHONORMAL_TOLERANCE:
        raise ShapeError(f"{name} is not rigid: last row is {T[3].tolist()}, expected [0, 0, 0, 1]")
    T = T.copy()
    T[:3, :3] = nearest_rotation(T[:3, :3])
    T.flags.writeable = False
    return T


def rounding_note(
    what: str, rotations: Iterable[ArrayLike], use: str = "the nearest exact ones are taken"
) -> tuple[str, ...]:
    """A note about the rotations of a file that :func:`as_rigid` takes although they are off by ``ROUNDED`` or more.

    Args:
        what: what the file is called.
        rotations: all rotations of the file, (3, 3) each, as written; matrices that are no rotation do not count.
        use: what becomes of them.

    Returns:
        The note: how many, and the largest deviation, in brackets at its end; empty where there are none.
    """
    R = np.array([*rotations], dtype=np.float64).reshape(-1, 3, 3)
    off = rotation_faults(R)
    off = off[off <= RIGID_TOLERANCE]
    rounded = off[off >= ROUNDED]
    if not len(rounded):
        return ()
    how = f"{len(rounded)} of {len(off)}, RᵀR up to {rounded.max():.2g} from the identity"
    return (f"{what}: rounded rotations; {use} ({how})",)


def rotation_faults(R: Float) -> Float:
    """How far RᵀR is from the identity (N,), given R (N, 3, 3); infinite where R is mirrored or not finite."""
    is_finite = np.all(np.abs(R) < 1e100, axis=(1, 2))
    R = np.where(is_finite[:, None, None], R, 0.0)
    off = np.abs(R.transpose(0, 2, 1) @ R - np.eye(3)).max(axis=(1, 2), initial=0.0)
    return np.where(is_finite & (np.linalg.det(R) > 0), off, np.inf)


def check_reach(t_m: Float, name: str) -> None:
    """Raises ShapeError where a position (3,) [m] is further away than ``FARTHEST_M``, or not finite."""
    away_m = math.hypot(*t_m.tolist())
    if not away_m <= FARTHEST_M:
        raise ShapeError(f"{name} is {away_m:.4g} m away, expected at most {FARTHEST_M:g} m; is it in millimetres?")


def _is_orthonormal(T: Float) -> bool:
    """Whether T is rigid beyond doubt. Every pose of every record is tested here, most of them several times.

    Plain floats are used, as numpy takes ten times as long on 3×3; each comparison is false for NaN.
    """
    (a, b, c, x), (d, e, f, y), (g, h, i, z), last = T.tolist()
    small = ORTHONORMAL_TOLERANCE
    return (
        -small <= a * a + d * d + g * g - 1 <= small
        and -small <= b * b + e * e + h * h - 1 <= small
        and -small <= c * c + f * f + i * i - 1 <= small
        and -small <= a * b + d * e + g * h <= small
        and -small <= a * c + d * f + g * i <= small
        and -small <= b * c + e * f + h * i <= small
        and a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g) > 0
        and last == [0.0, 0.0, 0.0, 1.0]
        and math.isfinite(x + y + z)
    )


def _deviations(T: Float) -> tuple[float, float, float]:
    """How far RᵀR is from the identity, det(R), and how far the last row is from (0, 0, 0, 1)."""
    (a, b, c, _), (d, e, f, _), (g, h, i, _), (p, q, r, s) = T.tolist()
    deviation = max(
        abs(a * a + d * d + g * g - 1),
        abs(b * b + e * e + h * h - 1),
        abs(c * c + f * f + i * i - 1),
        abs(a * b + d * e + g * h),
        abs(a * c + d * f + g * i),
        abs(b * c + e * f + h * i),
    )
    determinant = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)
    return deviation, determinant, max(abs(p), abs(q), abs(r), abs(s - 1))


def nearest_rotation(M: Float) -> Float:
    """The rotation closest to ``M`` (3, 3) in the Frobenius norm."""
    U, _, Vt = np.linalg.svd(M)
    if np.linalg.det(U @ Vt) < 0:
        U[:, -1] *= -1
    return U @ Vt


def axis_angle(axis: ArrayLike, angle_rad: float) -> Float:
    """The rotation (3, 3) by ``angle_rad`` about ``axis`` (3,), right-handed (Rodrigues)."""
    a = np.asarray(axis, dtype=np.float64)
    x, y, z = a / np.linalg.norm(a)
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle_rad) * K + (1 - np.cos(angle_rad)) * (K @ K)


def rotation_vector(R: Float) -> Float:
    """Axis times angle [rad] of a rotation (3, 3); the inverse of :func:`axis_angle`."""
    w, x, y, z = quat_wxyz(R)
    v = np.array([x, y, z])
    s = float(np.linalg.norm(v))
    if s < 1e-300:
        return np.zeros(3)
    return v / s * 2.0 * np.arctan2(s, w)


def angle_between(R_a: Float, R_b: Float) -> float:
    """The angle of the rotation that turns one into the other [rad]."""
    (a, b, c), (d, e, f), (g, h, i) = (R_a.T @ R_b).tolist()
    # The sine from the antisymmetric part keeps small angles exact, where acos loses half of its digits.
    sine = math.sqrt((h - f) ** 2 + (c - g) ** 2 + (d - b) ** 2)
    return math.atan2(sine, a + e + i - 1)


def quat_wxyz(R: Float) -> Float:
    """Unit quaternion (w, x, y, z), w ≥ 0, of a rotation (3, 3)."""
    # The eigenvector of Bar-Itzhack's symmetric matrix: well conditioned at every angle, near 0 and near π alike.
    m = R
    K = np.array(
        [
            [m[0, 0] + m[1, 1] + m[2, 2], m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]],
            [m[2, 1] - m[1, 2], m[0, 0] - m[1, 1] - m[2, 2], m[0, 1] + m[1, 0], m[0, 2] + m[2, 0]],
            [m[0, 2] - m[2, 0], m[0, 1] + m[1, 0], m[1, 1] - m[0, 0] - m[2, 2], m[1, 2] + m[2, 1]],
            [m[1, 0] - m[0, 1], m[0, 2] + m[2, 0], m[1, 2] + m[2, 1], m[2, 2] - m[0, 0] - m[1, 1]],
        ]
    )
    q = np.linalg.eigh(K)[1][:, -1]
    return q if q[0] >= 0 else -q


def rotation_of_quat_wxyz(quat: ArrayLike) -> Float:
    """The rotation (3, 3) of a quaternion (w, x, y, z) of any non-zero length."""
    q = np.asarray(quat, dtype=np.float64)
    w, x, y, z = q / np.linalg.norm(q)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def random_unit_vector(rng: np.random.Generator) -> Float:
    """A direction (3,), uniform on the sphere."""
    v = rng.normal(size=3)
    return v / np.linalg.norm(v)


def n_within_reach(Ts_cam_obj: Float) -> int:
    """Number of poses (N, 4, 4) of a path before the first too far away or not finite; the start always counts."""
    far = np.flatnonzero(~(np.linalg.norm(Ts_cam_obj[1:, :3, 3], axis=1) <= FARTHEST_M))
    return 1 + int(far[0]) if len(far) else len(Ts_cam_obj)


def as_poses(Ts_cam_obj: Float) -> Float:
    """A copy of the poses as a contiguous (N, 4, 4) array.

    Raises:
        ShapeError: another shape.
    """
    Ts = writable(Ts_cam_obj)
    if Ts.ndim != 3 or Ts.shape[1:] != (4, 4):
        raise ShapeError(f"the poses to score have shape {Ts.shape}, expected n×4×4")
    return Ts
