"""How far one pose is from another, as six numbers that a person can type: along and about three axes."""

from __future__ import annotations

from typing import Literal

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import axis_angle, rotation_vector, transform

Axes = Literal["camera", "object"]
"""camera: x to the right, y down, z away from it. object: those of the model, as the first pose has them."""


def displacement(T_from: Float, T_to: Float, axes: Axes) -> tuple[Float, Float]:
    """Shift (3,) of the object's origin [mm], and the rotation about it as axis times angle (3,) [deg]."""
    shift_m = T_to[:3, 3] - T_from[:3, 3]
    turn_rad = rotation_vector(T_to[:3, :3] @ T_from[:3, :3].T)
    to_axes = T_from[:3, :3].T if axes == "object" else np.eye(3)
    return 1e3 * to_axes @ shift_m, np.rad2deg(to_axes @ turn_rad)


def displaced(T_from: Float, shift_mm: Float, turn_deg: Float, axes: Axes) -> Float:
    """The pose (4, 4) that is so far from ``T_from``; undoes :func:`displacement`."""
    from_axes = T_from[:3, :3] if axes == "object" else np.eye(3)
    turn_rad = from_axes @ np.deg2rad(turn_deg)
    angle_rad = float(np.linalg.norm(turn_rad))
    R = axis_angle(turn_rad, angle_rad) @ T_from[:3, :3] if angle_rad else T_from[:3, :3]
    return transform(R, T_from[:3, 3] + 1e-3 * from_axes @ shift_mm)
