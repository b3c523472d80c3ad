"""What two oriented points have in common wherever they are, and the angle that is left. docs/methods.md 6."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True)
def angle(cosine: float) -> float:
    """The angle of a cosine that rounding may have pushed beyond 1 [rad]; π where it is NaN: it becomes an index."""
    return np.arccos(min(1.0, max(-1.0, cosine)))  # In this order: NaN is not larger than −1.


@njit(cache=True)
def pair_feature(p1: np.ndarray, n1: np.ndarray, p2: np.ndarray, n2: np.ndarray) -> tuple[float, float, float, float]:
    """Distance [m] and the angles n1-d, n2-d, n1-n2 [rad], where d points from the first to the second."""
    x, y, z = p2[0] - p1[0], p2[1] - p1[1], p2[2] - p1[2]
    distance = np.sqrt(x * x + y * y + z * z)
    if distance == 0.0:
        return 0.0, 0.0, 0.0, 0.0
    return (
        distance,
        angle((n1[0] * x + n1[1] * y + n1[2] * z) / distance),
        angle((n2[0] * x + n2[1] * y + n2[2] * z) / distance),
        angle(n1[0] * n2[0] + n1[1] * n2[1] + n1[2] * n2[2]),
    )


@njit(cache=True)
def local_rotation(normal: np.ndarray) -> np.ndarray:
    """The rotation (3, 3) that turns ``normal`` onto +x; which one of the many is fixed by the normal alone."""
    x, y, z = normal[0], normal[1], normal[2]
    # Duff et al. 2017: an orthonormal basis without a singular direction.
    sign = 1.0 if z >= 0.0 else -1.0
    a = -1.0 / (sign + z)
    b = x * y * a
    return np.array([[x, y, z], [1.0 + sign * x * x * a, sign * b, -sign * x], [b, sign + y * y * a, -y]])


@njit(cache=True)
def turn_about_normal(rotation: np.ndarray, p1: np.ndarray, p2: np.ndarray) -> float:
    """The angle of ``p2`` about the x axis of p1's local frame [rad], in (-π, π]."""
    x, y, z = p2[0] - p1[0], p2[1] - p1[1], p2[2] - p1[2]
    return np.arctan2(
        rotation[2, 0] * x + rotation[2, 1] * y + rotation[2, 2] * z,
        rotation[1, 0] * x + rotation[1, 1] * y + rotation[1, 2] * z,
    )


@njit(cache=True)
def pose_of_match(
    p_cam: np.ndarray, rotation_cam: np.ndarray, p_obj: np.ndarray, rotation_obj: np.ndarray, turn_rad: float
) -> np.ndarray:
    """``T_cam_obj`` (4, 4) that lays p_obj and its normal on p_cam and its normal, turned about them."""
    c, s = np.cos(turn_rad), np.sin(turn_rad)
    about_x = np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
    R = rotation_cam.T @ about_x @ rotation_obj
    T = np.eye(4)
    T[:3, :3] = R
    T[:3, 3] = p_cam - R @ p_obj
    return T
