"""A grasp by a pose and by the ground truth, moment by moment, seen from the side: answer to ``evaluate grasp``."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from msgspec.structs import replace

from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import apply
from verefine_viz.core.progress_token import ProgressToken
from verefine_viz.page import protocol as p
from verefine_viz.page.answers_to_wants import GraspAnswer, GraspFrame, GraspOutcome, Point
from verefine_viz.page.blobs import Blobs
from verefine_viz.page.frame_objects import labels_of
from verefine_viz.page.protocol import pose_matrix
from verefine_viz.page.views.physics import hull

if TYPE_CHECKING:
    from verefine_viz.core.problem import Problem
    from verefine_viz.grasping.grasp_answer import GraspAttempt
    from verefine_viz.page.workspace import Workspace

POINTS = 1500
"""Model points from which an outline seen from the side is made."""
NO_GRASP = "No grasp exists: the object is wider than the gripper opens."
BLOCKED = "No grasp was carried out: in each the gripper would meet what the sensor saw, or the plane."


def grasp(space: Workspace, verb: p.Evaluate, blobs: Blobs, progress: ProgressToken) -> GraspAnswer:
    """Grasp an object by a pose and by the ground truth; results are cached for the 3D view."""
    branch = space.branch(verb.branch)
    problem, settings = branch.run.problem, branch.settings.grasp
    pair = space.grasps.carry_out(problem, settings, verb.obj, pose_matrix(verb.T), progress)
    return GraspAnswer(_outcome(problem, pair.answer), _outcome(problem, pair.ground_truth))


def _outcome(problem: Problem, attempt: GraspAttempt) -> GraspOutcome:
    n, n_free = len(attempt.is_free), int(attempt.is_free.sum())
    path = attempt.path
    outcome = GraspOutcome(
        verdict=attempt.verdict,
        good=attempt.verdict == "success",
        source=attempt.grasps.source,
        free=n_free,
        blocked=n - n_free,
        words="" if path is not None else BLOCKED if n else NO_GRASP,
    )
    if path is None:
        return outcome
    labels = labels_of(problem)
    z_mm = 1e3 * path.Ts_world_obj[attempt.instance_id][:, 2, 3]
    touched = [
        sorted({"plane" if c.instance_id is None else labels[c.instance_id] for c in contacts})
        for contacts in path.contacts
    ]
    return replace(
        outcome,
        n=path.n_moments,
        stages=path.stages,
        gap_mm=np.round(1e3 * np.maximum(path.gaps_m, 0.0), 1).tolist(),
        force_n=np.round(path.forces_n, 2).tolist(),
        rise_mm=np.round(z_mm - z_mm[0], 1).tolist(),
        touches=touched,
        frames=_frames(problem, attempt),
    )


def _frames(problem: Problem, attempt: GraspAttempt) -> list[GraspFrame]:
    """Return the outlines of gripper and objects at every moment [mm], across and up, seen along the fingers' pads."""
    from verefine_viz.grasping.gripper import finger, palm

    path = attempt.path
    assert path is not None
    closing = path.stages.index("close") if "close" in path.stages else 0
    T = path.Ts_world_gripper[closing]
    across = np.array([*T[:2, 1], 0.0])
    if np.linalg.norm(across) < 0.3:  # The fingers close vertically.
        across = np.array([*T[:2, 2], 0.0])
    view = np.stack([across / max(float(np.linalg.norm(across)), 1e-9), [0.0, 0.0, 1.0]])
    models = {i.instance_id: problem.models[i.obj_id].points for i in problem.instances}
    corners = {own: _thinned(points) for own, points in models.items()}
    middle = view @ path.Ts_world_obj[attempt.instance_id][0, :3, 3]
    origin = np.array([middle[0], 0.0])

    def outline(points_world: Float) -> list[Point]:
        return np.round(1e3 * (hull(points_world @ view.T) - origin), 1).tolist()

    frames: list[GraspFrame] = []
    for k in range(path.n_moments):
        T, gap = path.Ts_world_gripper[k], float(path.gaps_m[k])
        frames.append(
            GraspFrame(
                gripper=[outline(apply(T, box.corners)) for box in (palm(), finger(gap, -1), finger(gap, 1))],
                objects=[
                    (own, outline(apply(path.Ts_world_obj[own][k], points)))
                    for own, points in corners.items()
                    if own in path.Ts_world_obj
                ],
            )
        )
    return frames


def _thinned(points: Float) -> Float:
    """Return the corners of the convex hull of some of a model's points, which every outline is made of."""
    from scipy.spatial import ConvexHull

    some = points[:: max(1, len(points) // POINTS)]
    return some[ConvexHull(some).vertices]
