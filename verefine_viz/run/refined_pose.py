"""Refines, settles and verifies one pose of an object that a person, or a program, proposes.

The paper's iteration (Sec. III-A, III-B) run to convergence: the refiner until it no longer moves the pose, the
simulator until the object lies among the placed objects, the refiner again from the simulated rotation. The answer is
the pose with the highest verification score among those on the way that sink no deeper into anything than the proposed
one. Ground truth is not looked at.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import angle_between, as_rigid, transform
from verefine_viz.core.problem import Placed, Target
from verefine_viz.core.protocols import Refiner
from verefine_viz.core.scores import PoseScore
from verefine_viz.methods.single_object import refined, simulate
from verefine_viz.physics.plausibility import Plausibility, plausibility

if TYPE_CHECKING:
    from verefine_viz.evaluation.allowed_poses import AllowedPoses
    from verefine_viz.run.toolbox import Toolbox

MOST_CALLS = 10
"""Most calls of the refiner, before the simulation and after it."""
REST_M, REST_RAD = 1e-4, np.radians(0.1)
"""A refiner that moves and turns a pose by less than this has converged."""
SETTLING_STEPS = 30
"""Steps of 1/60 s after which an object that began near its support lies on it."""


@dataclass(frozen=True, eq=False)
class RefinedPose:
    """A proposed pose, refined and settled, with its verification."""

    T_cam_obj: Float
    """(4, 4) [m]; the proposed pose itself where nothing scores higher."""
    score: PoseScore
    """With the fit of depth, normals and colour."""
    score_before: PoseScore
    """Score of the proposed pose."""
    physics: Plausibility | None
    """Contacts, deepest intersection, stability; None where no support is known or physics is off."""
    allowed: AllowedPoses | None = None
    """The poses that the image allows besides it; None where these were not asked for."""


def refined_pose(
    tools: Toolbox, target: Target, T_cam_obj: Float, placed: Sequence[Placed] = (), with_allowed: bool = False
) -> RefinedPose:
    """Refine a pose to convergence, settle it on its support, refine it again, and verify the best pose.

    Args:
        tools: of the session, whose refiner, simulator and verifier are used.
        target: the object; its hypotheses and ground truth are not looked at.
        T_cam_obj: (4, 4) the proposed pose [m].
        placed: other objects at their poses.
        with_allowed: whether to work out the poses that the image allows besides the answer, which takes a second.

    Raises:
        ShapeError: the pose is not rigid, or no solid can be made of the model.
    """
    proposed = as_rigid(T_cam_obj, "proposed pose")
    first = _rested(tools.refiner, target, proposed, placed)
    poses = [proposed, first]
    settled = simulate(tools.simulator, target, first, placed, SETTLING_STEPS)
    if settled is not None:
        T_settled = settled[0].T_cam_obj
        mixed = transform(T_settled[:3, :3], first[:3, 3])
        poses += [T_settled, _rested(tools.refiner, target, mixed, placed)]
    scores = tools.verifier.score(target, np.stack(poses), placed)
    most_mm = _too_deep_mm(_physics(tools, target, proposed, placed))
    ranked = ((k, _physics(tools, target, poses[k], placed)) for k in np.argsort(-scores.score, kind="stable"))
    k, physics = next(
        (k, physics) for k, physics in ranked if _too_deep_mm(physics) <= most_mm
    )  # The proposed pose last.
    allowed = _allowed(tools, target, poses[k], placed) if with_allowed else None
    return RefinedPose(poses[k], scores[k], scores[0], physics, allowed)


def _rested(refiner: Refiner, target: Target, T_cam_obj: Float, placed: Sequence[Placed]) -> Float:
    """The pose at which the refiner has converged."""
    for _ in range(MOST_CALLS):
        T_before, T_cam_obj = T_cam_obj, refined(refiner, target, T_cam_obj, placed).T_cam_obj
        moved_m = np.linalg.norm(T_cam_obj[:3, 3] - T_before[:3, 3])
        if moved_m < REST_M and angle_between(T_cam_obj[:3, :3], T_before[:3, :3]) < REST_RAD:
            break
    return T_cam_obj


def _physics(tools: Toolbox, target: Target, T_cam_obj: Float, placed: Sequence[Placed]) -> Plausibility | None:
    support = target.observation.support
    if support is None or tools.simulator is None:
        return None
    moving = Placed(target.instance.instance_id, target.model, T_cam_obj)
    return plausibility(moving, placed, support, tools.session.physics, surface_of=tools.surfaces)


def _too_deep_mm(physics: Plausibility | None) -> float:
    """How much deeper the pose sinks into something than is tolerated [mm]."""
    return 0.0 if physics is None else max(physics.penetration_mm - physics.tolerance_mm, 0.0)


def _allowed(tools: Toolbox, target: Target, T_cam_obj: Float, placed: Sequence[Placed]) -> AllowedPoses:
    from verefine_viz.evaluation.allowed_search import allowed_poses

    return allowed_poses(tools.verifier, target, T_cam_obj, placed)
