"""Do two placed objects overlap, how deep, and where?"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import apply
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.problem import Placed
from verefine_viz.physics.proximity import Surface, nearness

OVERLAP_M = 0.0015
"""Less penetration than this is noise of poses and meshes [m]."""


@dataclass(frozen=True, eq=False)
class Overlap:
    """Two objects that are partly in the same place."""

    first: int
    """instance_id."""
    second: int
    depth_mm: float
    """How deep the deepest point of either lies inside the other [mm]."""
    points_cam: Float
    """(n, 3) where one surface lies inside the other [m]."""


def overlap(a: Placed, b: Placed, surface_of: Callable[[ObjectModel], Surface] = Surface) -> Overlap | None:
    """The overlap of two placed objects; None where it is less than ``OVERLAP_M``.

    Args:
        a: an object and its pose in the camera frame.
        b: another one.
        surface_of: makes the surface of a model; ``Surfaces()`` keeps them for the next call.
    """
    corners_a, corners_b = _box(a), _box(b)
    if (np.maximum(corners_a[0], corners_b[0]) > np.minimum(corners_a[1], corners_b[1])).any():
        return None
    found = nearness(surface_of(a.model), a.T_cam_obj, surface_of(b.model), b.T_cam_obj, 0.0)
    if found.penetration_m < OVERLAP_M:
        return None
    return Overlap(a.instance_id, b.instance_id, found.penetration_m * 1e3, found.points)


def _box(placed: Placed) -> Float:
    """(2, 3) lowest and highest coordinates in the camera frame."""
    vertices = apply(placed.T_cam_obj, placed.model.vertices)
    return np.stack([vertices.min(axis=0), vertices.max(axis=0)])
