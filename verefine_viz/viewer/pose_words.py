"""What lies between two poses, in numbers and plain words."""

from __future__ import annotations

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import apply, rotation_vector
from verefine_viz.evaluation.errors import PoseErrors
from verefine_viz.evaluation.turning import Turning

_AXES = ("x", "y", "z")
_NO_TURN_DEG = 0.05
_NO_MOVE_MM = 0.05
_WORTH_A_WAY_DEG = 1.0
"""Of a smaller rotation nobody needs to know which way it goes."""


def turn(T_from: Float, T_to: Float) -> tuple[float, str]:
    """The angle [deg] between two poses and the object axis it is about: "x", or "0.7, 0.0, −0.7"."""
    vector = rotation_vector(T_from[:3, :3].T @ T_to[:3, :3])
    angle = float(np.linalg.norm(vector))
    if angle < 1e-9:
        return 0.0, ""
    axis = vector / angle
    k = int(np.argmax(np.abs(axis)))
    components = (f"{x:.1f}".replace("-0.0", "0.0").replace("-", "−") for x in axis)
    name = _AXES[k] if abs(axis[k]) > 0.9 else ", ".join(components)
    return float(np.rad2deg(angle)), name


def shift_mm(T_from: Float, T_to: Float, points: Float) -> float:
    """How far the middle of the object's ``points`` (N, 3) moved between two poses [mm]."""
    centre = points.mean(axis=0)[None]
    return float(np.linalg.norm(apply(T_to, centre) - apply(T_from, centre))) * 1e3


def movement(T_from: Float, T_to: Float, points: Float) -> str:
    """What happened between two poses: "turned it 6.8° about x and moved it 4.1 mm"."""
    angle, axis = turn(T_from, T_to)
    distance = shift_mm(T_from, T_to, points)
    parts = []
    if angle >= _NO_TURN_DEG:
        parts.append(f"turned it {angle:.1f}° about {axis}" if axis in _AXES else f"turned it {angle:.1f}°")
    if distance >= _NO_MOVE_MM:
        parts.append(f"moved it {distance:.1f} mm")
    return " and ".join(parts) or "left it where it was"


def errors_in_words(errors: PoseErrors | None, way: Turning | None = None) -> str:
    """As in: 12.3° and 4.5 mm from the truth; nothing without ground truth.

    With ``way``, also as in: 9.5° (3.6° of tilt against the table, 8.8° of turn on it) and 4.5 mm from the truth.
    """
    if errors is None:
        return ""
    told = f" ({way.in_words()})" if way is not None and errors.rotation_deg >= _WORTH_A_WAY_DEG else ""
    return f"{errors.rotation_deg:.1f}°{told} and {errors.translation_mm:.1f} mm from the truth"
