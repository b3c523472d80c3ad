"""A parallel gripper of three boxes: its shape, and the space that it sweeps on a straight approach.

Its frame is that of the annotated grasps, the palm link of the Toyota HSR: z points to the object, the fingers close
along y. The grippers that come with pybullet do not open far enough for the annotated grasps (WSG 50: 102 mm, Panda:
80 mm; the potted meat can is 102 mm long), and Bullet gives the palm of the WSG 50 no shape to collide with.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import apply

PALM_M = (0.050, 0.175, 0.080)
"""Width, length along the closing direction, and depth of the palm [m]."""
PALM_FRONT_M = 0.005
"""End of the palm towards the object, along z [m]."""
TIP_M = 0.078
"""End of the fingers along z [m]: 2 mm above the table in the flattest annotated grasps of the gelatin box. Grasps of
the banana from above would need fingers about 10 mm shorter, which would hardly reach the gelatin box."""
FINGER_M = (0.020, 0.012)
"""Width and thickness of a finger [m]."""
PINCH_M = TIP_M - 0.015
"""Middle of a finger pad along z [m]."""
APPROACH_M = 0.10
"""Length of the straight approach along the grasp [m]."""


@dataclass(frozen=True)
class Box:
    """An upright box in the gripper's frame [m]."""

    low: tuple[float, float, float]
    high: tuple[float, float, float]

    @property
    def corners(self) -> Float:
        """(8, 3) corners [m]."""
        return np.array(np.meshgrid(*zip(self.low, self.high, strict=True), indexing="ij")).reshape(3, -1).T

    @property
    def faces(self) -> NDArray[np.int32]:
        """(12, 3) triangles of the corners."""
        quads = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
        return np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))], np.int32)

    def swept(self, back_m: float) -> Box:
        """The space that the box sweeps as it comes along z from ``back_m`` behind."""
        x, y, z = self.low
        return Box((x, y, z - back_m), self.high)

    def holds(self, points: Float) -> NDArray[np.bool_]:
        """Which points (N, 3) are in the box."""
        return np.logical_and.reduce((points >= self.low) & (points <= self.high), axis=1)


def palm() -> Box:
    """The palm, on which the fingers slide."""
    x, y, z = PALM_M
    return Box((-x / 2, -y / 2, PALM_FRONT_M - z), (x / 2, y / 2, PALM_FRONT_M))


def finger(gap_m: float, side: int) -> Box:
    """A finger while the fingers are ``gap_m`` apart; ``side`` -1 or 1 along y."""
    x, y = FINGER_M
    low, high = sorted((side * gap_m / 2, side * (gap_m / 2 + y)))
    return Box((-x / 2, low, PALM_FRONT_M), (x / 2, high, TIP_M))


def boxes(gap_m: float) -> tuple[Box, Box, Box]:
    """The boxes of palm and fingers."""
    return palm(), finger(gap_m, -1), finger(gap_m, 1)


def fork(gap_m: float) -> Float:
    """The gripper as lines to draw, (4, 2, 3) their ends [m]: stem, bar, two fingers."""
    y = gap_m / 2
    stem, bar = [0.0, 0.0, PALM_FRONT_M - PALM_M[2] / 2], [0.0, 0.0, PALM_FRONT_M]
    left, right = [[0.0, -y, PALM_FRONT_M], [0.0, -y, TIP_M]], [[0.0, y, PALM_FRONT_M], [0.0, y, TIP_M]]
    return np.array([[stem, bar], [left[0], right[0]], left, right])


def is_blocked(T_grasps: Float, points: Float, gap_m: float, back_m: float) -> NDArray[np.bool_]:
    """Which grasps (N, 4, 4) meet a point (M, 3) on a straight approach of ``back_m`` with open fingers."""
    swept = [box.swept(back_m) for box in boxes(gap_m)]
    blocked = np.zeros(len(T_grasps), dtype=bool)
    for k, T in enumerate(T_grasps):
        mine = (points - T[:3, 3]) @ T[:3, :3]
        blocked[k] = any(box.holds(mine).any() for box in swept)
    return blocked


def lowest(T_world_grasps: Float, normal_world: Float, gap_m: float, back_m: float) -> Float:
    """Height (N,) of the lowest corner on such an approach, over the plane through the origin [m]."""
    corners = np.concatenate([box.swept(back_m).corners for box in boxes(gap_m)])
    return np.array([(apply(T, corners) @ normal_world).min() for T in T_world_grasps])
