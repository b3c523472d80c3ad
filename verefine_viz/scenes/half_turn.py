"""The half turn of an object that changes its shape least: it then lies where it lay, with its other side in front.

In half of the trials of the paper's grasping experiment objects are turned so (Sec. V-D).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import apply, axis_angle, transform
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.ray_scene import queries, ray_scene

if TYPE_CHECKING:
    import open3d as o3d

NEAR_SHARE = 0.03
"""A half turn about the vertical is taken if it leaves half of the surface nearer than this share of the diameter, …"""
PREFERENCE = 0.5
"""… or if no other half turn leaves it nearer than this share of that distance: a banana is turned over, a duck turned
round."""
SHIFTS = 10
"""How often the turned object is shifted onto its own surface, by the median distance: a mug is turned about its cup,
not about the middle of cup and handle."""


def half_turn(model: ObjectModel, up_obj: Float) -> Float:
    """The half turn (4, 4) in the object's frame [m]; ``T_world_obj @ half_turn`` lies nearly where ``T_world_obj``
    does.

    Args:
        model: the object's.
        up_obj: (3,) unit vector, the vertical in the object's frame.
    """
    surface = ray_scene(model.vertices, model.faces)
    corners = model.vertices[model.faces]
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    middle = np.average(corners.mean(axis=1), axis=0, weights=areas)
    principal = np.linalg.eigh(np.cov(model.points.T))[1].T
    turns = [_turned(model.points, surface, axis, middle) for axis in (up_obj, *np.eye(3), *principal)]
    upright, others = turns[0], turns[1:]
    best = min(others, key=lambda turn: turn[1])
    is_near = upright[1] < NEAR_SHARE * model.diameter_m
    return upright[0] if is_near or best[1] >= PREFERENCE * upright[1] else best[0]


def _turned(points: Float, surface: o3d.t.geometry.RaycastingScene, axis: Float, middle: Float) -> tuple[Float, float]:
    """The half turn (4, 4) about an axis of this direction near ``middle`` (3,), and the distance within which it
    leaves half of the surface [m].
    """
    R = axis_angle(axis, np.pi)
    T = transform(R, middle - R @ middle)
    for _ in range(SHIFTS):
        T[:3, 3] += np.median(_to_surface(apply(T, points), surface), axis=0)
    return T, float(np.median(np.linalg.norm(_to_surface(apply(T, points), surface), axis=1)))


def _to_surface(points: Float, surface: o3d.t.geometry.RaycastingScene) -> Float:
    """(N, 3) from each point to the nearest one of the surface [m]."""
    nearest = surface.compute_closest_points(queries(points))["points"]
    return nearest.numpy().astype(np.float64) - points
