"""Finds poses of an object that a person marked in the photo, by the program's own estimators, best first.

Point pair features and views of the model propose; the session's refiner and verifier choose. Offered are a few that
differ, so that a flip that scores more does not hide the right pose. docs/methods.md 9.1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from verefine_viz.core.arrays import Float, Mask
from verefine_viz.core.geometry import apply, axis_angle, inverse, transform
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.observation import Observation
from verefine_viz.core.problem import Placed, Target
from verefine_viz.core.progress_token import NEVER_CANCELLED, ProgressToken
from verefine_viz.estimators.clouds import segment_cloud as every_pixel
from verefine_viz.estimators.ppf_agreement import PADDING, surface_field
from verefine_viz.evaluation.pose_errors import add_s_mm
from verefine_viz.labels.placing import target_of, up_of
from verefine_viz.methods.single_object import refined
from verefine_viz.observation.observed_frame import segment_cloud
from verefine_viz.scenes.segments import FEWEST_MASK_PX

if TYPE_CHECKING:
    from verefine_viz.run.toolbox import Toolbox

N_OFFERED = 5
"""Poses that are offered, by default: as many as are looked at in a glance."""
DIFFERS = 0.1
"""Poses whose surfaces are apart by more than this share of the diameter in the mean are worth offering both."""
N_ESTIMATED = 10
"""Poses requested from point pair features."""
N_TURNS = 12
"""Turns about the vertical, of each face down."""
NEAR_SHARE = PADDING
"""Distance from a pose, as a share of the diameter, up to which pixels influence it."""
N_TRIED = 48
"""Best of the proposed poses, for which the refiner is called once."""
N_REFINED = 10
"""Best of these, all apart, for which it is called more often:"""
N_CALLS = 4
"""so many times."""
DOWN = (
    np.eye(3),
    *(axis_angle(np.array(axis, float), angle) for axis in ((1, 0, 0), (0, 1, 0)) for angle in (np.pi / 2, -np.pi / 2)),
    axis_angle(np.array([1.0, 0.0, 0.0]), np.pi),
)
"""Rotations that turn each side of the model's box down, the lower one first."""


@dataclass(frozen=True, eq=False)
class FoundPose:
    """A candidate pose."""

    T_cam_obj: Float
    """(4, 4) [m]."""
    score: float
    """In [0, 1] (Eq. 1), on the pixels that were marked."""
    source: str
    """Origin of the pose, as shown to the user: "ppf #1", "upright 30°"."""


def found(
    tools: Toolbox,
    observation: Observation,
    model: ObjectModel,
    instance_id: int,
    region: Mask,
    others: Sequence[Placed] = (),
    n: int = N_OFFERED,
    progress: ProgressToken = NEVER_CANCELLED,
) -> tuple[FoundPose, ...]:
    """The best poses of an object in a marked region, no two of which are nearly the same.

    Args:
        tools: of the session, whose refiner and verifier are used.
        observation: the frame.
        model: of the object.
        instance_id: number of the object in its frame.
        region: (H, W) its pixels, as :mod:`marked_region` has them.
        others: objects that are labelled already.
        n: how many are wanted.
        progress: has checkpoints, also while a model's point pairs are learnt, which happens once.

    Raises:
        Cancelled: through ``progress``.
    """
    target = target_of(observation, model, instance_id, region, tools.session.scene)
    estimated = tools.point_pairs.hypotheses(target, N_ESTIMATED, progress)
    proposed = [*((h.T_cam_obj, h.source) for h in estimated), *views(target)]
    progress.checkpoint(f"Refining and scoring poses of {model.name}.")
    return best(tools, target, proposed, others, n)


def best(
    tools: Toolbox, target: Target, proposed: Sequence[tuple[Float, str]], others: Sequence[Placed], n: int
) -> tuple[FoundPose, ...]:
    """The best of proposed poses after they were refined a little, no two of which are nearly the same.

    Args:
        tools: of the session.
        target: the object, with the pixels that score all of them.
        proposed: poses (4, 4) [m], each with what proposed it.
        others: objects that are labelled already.
        n: how many are wanted.
    """
    if not proposed:
        return ()
    pixels, poses = _Pixels(target), _scored(tools, target, proposed, others)[:N_TRIED]
    poses = _scored(tools, target, [_moved(tools, pixels, one, others, 1) for one in poses], others)
    poses = _differing(target.model, poses, N_REFINED)
    poses += _scored(tools, target, [_moved(tools, pixels, one, others, N_CALLS) for one in poses], others)
    return tuple(_differing(target.model, sorted(poses, key=lambda one: -one.score), n))


class _Pixels:
    """The pixels of a target, of which each pose sees those near it: a box also holds what touches the object."""

    def __init__(self, target: Target) -> None:
        self._target, self._points = target, every_pixel(target)
        self._field = surface_field(target.model.points, target.model.diameter_m)

    def near(self, T_cam_obj: Float) -> Target:
        """The target with the pixels that are near the model at a pose (4, 4); with all where those are too few."""
        target, field, one = self._target, self._field, self._target.instance
        cells = ((apply(inverse(T_cam_obj), self._points) - field.low) / field.side_m).astype(np.int64)
        # Beyond the field nothing is near.
        at = np.clip(cells, 0, np.array(field.distance_m.shape) - 1)
        is_near = field.distance_m[tuple(at.T)] < NEAR_SHARE * target.model.diameter_m
        is_near &= (cells == at).all(axis=1)
        mask = one.mask & (target.observation.depth_m > 0)
        mask[mask] = is_near
        if np.count_nonzero(mask) < FEWEST_MASK_PX:
            return target
        seen = target.observation
        cloud = segment_cloud(seen.depth_m, seen.camera, mask, len(one.points_cam), 0)
        return replace(target, instance=replace(one, mask=mask, points_cam=cloud))


def _moved(
    tools: Toolbox, pixels: _Pixels, pose: FoundPose, others: Sequence[Placed], n_calls: int
) -> tuple[Float, str]:
    """The pose after some calls of the refiner."""
    T, target = pose.T_cam_obj, pixels.near(pose.T_cam_obj)
    for _ in range(n_calls):
        T = refined(tools.refiner, target, T, others).T_cam_obj
    return T, pose.source


def _scored(
    tools: Toolbox, target: Target, proposed: Sequence[tuple[Float, str]], others: Sequence[Placed]
) -> list[FoundPose]:
    """The poses with their scores, highest first."""
    scores = tools.verifier.score(target, np.stack([T for T, _ in proposed]), others).score
    return [FoundPose(proposed[k][0], float(scores[k]), proposed[k][1]) for k in np.argsort(-scores, kind="stable")]


def _differing(model: ObjectModel, poses: Sequence[FoundPose], n: int) -> list[FoundPose]:
    """The first ``n`` that are apart from all before."""
    chosen, apart_mm = list[FoundPose](), 1e3 * DIFFERS * model.diameter_m
    for one in poses:
        if len(chosen) == n:
            break
        if all(add_s_mm(model, one.T_cam_obj, other.T_cam_obj) > apart_mm for other in chosen):
            chosen.append(one)
    return chosen


def views(target: Target) -> list[tuple[Float, str]]:
    """The model on each side of its box, in turns about the vertical, where the target's pixels are; with names.

    A view lies where the middle of what it shows is the middle of what was measured; near its support it stands on it.
    """
    observation, cloud = target.observation, target.instance.points_cam
    if not len(cloud):
        return []
    up, middle = up_of(observation), np.median(cloud, axis=0)
    towards = middle - (middle @ up) * up
    y = towards / max(float(np.linalg.norm(towards)), 1e-9)
    R_cam_world = np.column_stack([np.cross(y, up), y, up])
    out = []
    for side, R_down in enumerate(DOWN):
        for k in range(N_TURNS):
            turn = 2 * np.pi * k / N_TURNS
            R = R_cam_world @ axis_angle(np.array([0.0, 0.0, 1.0]), turn) @ R_down
            name = f"{'upright' if side == 0 else f'side {side} down'} {np.degrees(turn):.0f}°"
            out.append((_put(target, R, up, middle), name))
    return out


def _put(target: Target, R: Float, up: Float, middle: Float) -> Float:
    """The pose (4, 4) with a rotation at which the model shows its middle where it was measured."""
    model, support = target.model, target.observation.support
    points = model.points @ R.T
    facing = (model.point_normals @ R.T) @ middle < 0
    T = transform(R, middle - np.median(points[facing] if facing.any() else points, axis=0))
    if support is not None:
        heights = apply(support.T_world_cam, apply(T, model.points)) @ support.normal_world
        if abs(heights.min()) < np.ptp(heights) / 2:  # Near enough to stand on the support.
            T[:3, 3] -= heights.min() * up
    return T
