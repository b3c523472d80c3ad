"""Snapping: finds the exact pose for a rough one that a person gave, with the object's pixels unknown.

Starts turned about the vertical are refined on what depth shows near each (ICP alone turns no can); all are
scored on the pixels of all of them together, so that none profits from explaining little. The best is refined, settled
and refined again (:func:`~verefine_viz.run.refined_pose.refined_pose`) on the pixels that are its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from verefine_viz.core.accuracy import CORRECT
from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import apply, as_rigid, axis_angle, transform
from verefine_viz.core.observation import Observation
from verefine_viz.core.problem import Placed, Target
from verefine_viz.evaluation.near_symmetry import flips, near_symmetries
from verefine_viz.evaluation.pose_errors import add_s_mm
from verefine_viz.labels.placing import target_at, target_of, up_of
from verefine_viz.methods.single_object import refined
from verefine_viz.run.refined_pose import RefinedPose, refined_pose
from verefine_viz.run.toolbox import Toolbox
from verefine_viz.scenes.own_pixels import fit_reach_m, own_pixels

TURNS_DEG = (0.0, 10.0, -10.0, 20.0, -20.0, 30.0, -30.0)
"""About the vertical: people place an object to within 25°."""
ALL_TURNS_DEG = tuple(float(deg) for deg in range(0, 360, 30))
"""Turns all around, for an object of unknown orientation."""
ROUGH_SHARE, ROUGH_M = 0.2, 0.03
"""How far off a pose that a person gave may be, as a share of the diameter, and at least."""
ROUGH_CALLS = 2
"""Calls of the refiner at each reach."""
FEWEST_POINTS = 30
"""Least number of measured points next to an object for refining it."""


@dataclass(frozen=True, eq=False)
class Rival:
    """A pose in which an object looks nearly the same."""

    T_cam_obj: Float
    """(4, 4) [m]."""
    gain: float
    """By how much it scores more."""


@dataclass(frozen=True, eq=False)
class Snapped:
    """An object after snapping."""

    target: Target
    """The object, with the pixels that are its own at the pose."""
    proposed: Float
    """(4, 4) the pose that was given, in the turn from which it was snapped [m]."""
    refined: RefinedPose
    """The pose, its score on those pixels, its contacts and what the image allows beside it."""
    rivals: tuple[Rival, ...] = ()
    """Poses turned so that the shape nearly looks the same, the one that scores most first."""


def snapped(
    tools: Toolbox,
    observation: Observation,
    proposed: Placed,
    others: Sequence[Placed] = (),
    turns_deg: Sequence[float] = TURNS_DEG,
) -> Snapped:
    """Refine a rough pose, settle it among the others, and verify it.

    Args:
        tools: of the session: refiner, simulator and verifier.
        observation: the frame; its masks are not looked at.
        proposed: the object with the pose that was given.
        others: the other objects of the frame, where they are.
        turns_deg: about the vertical from which it starts.

    Raises:
        ShapeError: the pose is not rigid, or no solid can be made of the model.
    """
    model, own, scene = proposed.model, proposed.instance_id, tools.session.scene
    given = [*_turned(observation, replace(proposed, T_cam_obj=as_rigid(proposed.T_cam_obj, "pose")), turns_deg)]
    starts = [_roughly_refined(tools, observation, start, others) for start in given]
    reach_m = fit_reach_m(model)
    seen = np.any([own_pixels(observation, model, T, others, reach_m) for T in starts], axis=0)
    together = target_of(observation, model, own, seen, scene)
    best = int(np.argmax(tools.verifier.score(together, np.stack(starts), others).score))
    target = target_at(observation, model, own, starts[best], others, scene)
    rested = refined_pose(tools, target, starts[best], others)
    target = target_at(observation, model, own, rested.T_cam_obj, others, scene)
    verified = refined_pose(tools, target, rested.T_cam_obj, others, with_allowed=True)
    rivals = rivals_of(tools, target, verified.T_cam_obj, others)
    return Snapped(target, given[best].T_cam_obj, verified, rivals)


def rivals_of(tools: Toolbox, target: Target, T_cam_obj: Float, others: Sequence[Placed]) -> tuple[Rival, ...]:
    """Poses apart from one by one of the turns after which the shape nearly looks the same, refined.

    Args:
        tools: of the session: refiner and verifier.
        target: the object, with the pixels that are its own.
        T_cam_obj: (4, 4) where it is [m].
        others: the other objects, where they are.
    """
    model, turns = target.model, flips(near_symmetries(target.model))
    if not len(turns):
        return ()
    turned = [refined(tools.refiner, target, T_cam_obj @ turn, others).T_cam_obj for turn in turns]
    apart = [T for T in turned if add_s_mm(model, T, T_cam_obj) > 1e3 * CORRECT * model.diameter_m]
    if not apart:
        return ()
    own, *scores = tools.verifier.score(target, np.stack([T_cam_obj, *apart]), others).score.tolist()
    found = (Rival(T, score - own) for T, score in zip(apart, scores, strict=True))
    return tuple(sorted(found, key=lambda rival: -rival.gain))


def _turned(observation: Observation, proposed: Placed, turns_deg: Sequence[float]) -> list[Placed]:
    up, T = up_of(observation), proposed.T_cam_obj
    middle = apply(T, proposed.model.middle_m[None])[0]
    turns = (axis_angle(up, float(np.radians(deg))) for deg in turns_deg)
    return [replace(proposed, T_cam_obj=transform(R, middle - R @ middle) @ T) for R in turns]


def _roughly_refined(tools: Toolbox, observation: Observation, start: Placed, others: Sequence[Placed]) -> Float:
    """A pose after a few calls of the refiner, first on what lies within a rough reach, then within half of that."""
    T, diameter_m = start.T_cam_obj, start.model.diameter_m
    for within_m in (max(ROUGH_M, ROUGH_SHARE * diameter_m), ROUGH_SHARE / 2 * diameter_m):
        target = target_at(observation, start.model, start.instance_id, T, others, tools.session.scene, within_m)
        if len(target.instance.points_cam) < FEWEST_POINTS:
            break
        for _ in range(ROUGH_CALLS):
            T = refined(tools.refiner, target, T, others).T_cam_obj
    return T
