"""Checks which grasps of an estimated pose are free: the open gripper's straight approach against the observed depth.

As with the octomap of Sec. V-D: voxels of the observed depth, the target's own included, so that a wrong
pose puts a finger where the object is. Unseen space counts as free.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.algorithm_settings import GraspSettings
from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import InputError
from verefine_viz.core.geometry import apply
from verefine_viz.core.observation import Observation, Support
from verefine_viz.grasping.gripper import APPROACH_M, is_blocked, lowest

VOXEL_M = 0.005
"""Side of the voxels of the observed depth [m]."""
FEWEST = 2
"""Least number of measured points in an occupied voxel: a flying pixel alone does not count."""
REACH_M = 0.35
"""Distance from an object beyond which voxels do not matter for its grasps [m]."""


@dataclass(frozen=True, eq=False)
class Obstacles:
    """Obstacles to an approach, in the world of the frame's support plane."""

    support: Support
    voxels: Float
    """(N, 3) centres of the occupied voxels that lie more than one voxel above the plane [m]."""


def obstacles(observation: Observation) -> Obstacles:
    """The obstacles of a frame.

    Raises:
        InputError: it has no support plane.
    """
    support = observation.support
    if support is None:
        raise InputError(f"{observation.support_note}; without a plane nothing can be grasped")
    seen = observation.camera.back_project(observation.depth_m)[observation.depth_m > 0].astype(np.float64)
    points = apply(support.T_world_cam, seen)
    points = points[points @ support.normal_world > VOXEL_M]
    cells, counts = np.unique(np.floor(points / VOXEL_M).astype(np.int64), axis=0, return_counts=True)
    voxels = (cells[counts >= FEWEST].astype(np.float64) + 0.5) * VOXEL_M
    return Obstacles(support, voxels)


def are_free(T_cam_grasps: Float, around: Obstacles, settings: GraspSettings) -> NDArray[np.bool_]:
    """Which grasps (N, 4, 4) meet neither a voxel nor the plane on their approach."""
    Ts = around.support.T_world_cam @ T_cam_grasps
    if not len(Ts):
        return np.zeros(0, dtype=bool)
    near = np.linalg.norm(around.voxels - Ts[:, :3, 3].mean(axis=0), axis=1) < REACH_M
    blocked = is_blocked(Ts, around.voxels[near], settings.opening_m, APPROACH_M)
    over = lowest(Ts, around.support.normal_world, settings.opening_m, APPROACH_M)
    return ~blocked & (over >= 0.0)
