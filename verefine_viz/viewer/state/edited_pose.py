"""The edited pose as six numbers, and telling what a control has sent itself from what is new to it."""

from __future__ import annotations

from collections import deque
from typing import Literal

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import axis_angle, rotation_vector, transform
from verefine_viz.viewer.commands import Pose

Axes = Literal["camera", "object"]
"""camera: x to the right, y down, z away from it. object: those of the model, as the initial pose has them."""


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


# Poses that a handle on the page sent itself: it shows them already, or a later one that is still on its way.


class SentPoses:
    """Keeps what a handle shows from being overwritten by its own echo, and lets all other poses through."""

    def __init__(self) -> None:
        self._sent: deque[Pose] = deque(maxlen=200)
        self._shown: Pose | None = None

    def add(self, pose: Pose) -> None:
        """The handle sends a pose."""
        self._sent.append(pose)

    def is_news(self, pose: Pose) -> bool:
        """Whether the handle has to be moved to ``pose``; it counts as moved then."""
        if pose == self._shown:
            return False
        self._shown = pose
        if pose in self._sent:
            return False
        self._sent.clear()
        return True

    def clear(self) -> None:
        """Nothing is edited any more."""
        self._sent.clear()
        self._shown = None
