"""The point measured at a pixel, and its distance to the objects at their poses: answer to the want ``point``."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import InputError
from verefine_viz.core.problem import Target
from verefine_viz.page import protocol as p
from verefine_viz.page.answers_to_wants import PointAnswer
from verefine_viz.page.blobs import Blobs

if TYPE_CHECKING:
    from verefine_viz.page.workspace import Workspace

DistanceOf = Callable[[Float, Target, Float, float], float]
"""Distance [m] of a point (3,) from the surface of a target at T_cam_obj, positive outside; NaN beyond reach, which
follows from the depth tolerance."""


def point(space: Workspace, want: p.PointWanted, blobs: Blobs, distance_of: DistanceOf) -> PointAnswer:
    """Return point, normal and residual at a pixel.

    Raises:
        InputError: there is no such pixel, branch or object.
    """
    branch = space.branch(want.branch)
    problem, (u, v) = branch.run.problem, want.pixel
    observation, camera = problem.observation, problem.observation.camera
    if u >= camera.width or v >= camera.height:
        raise InputError(f"there is no pixel {u}, {v} in an image of {camera.width}×{camera.height}")
    depth_m = float(observation.depth_m[v, u])
    if not depth_m > 0:
        return PointAnswer(None, None, None, None)
    at = depth_m * np.array([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, 1.0])
    tau_m, normal = branch.settings.score.tau_m, observation.normals_cam[v, u]
    distances_m = {
        one.obj: distance_of(at, problem.target(one.obj), p.pose_matrix(one.T), tau_m) for one in want.stands
    }
    near = {obj: distance_m for obj, distance_m in distances_m.items() if np.isfinite(distance_m)}
    nearest = min(near, key=lambda obj: abs(near[obj]), default=None)
    return PointAnswer(
        point_mm=tuple((1000 * at).tolist()),
        normal=tuple(normal.tolist()) if normal.any() else None,
        residual_mm=None if nearest is None else 1000 * near[nearest],
        obj=nearest,
    )
