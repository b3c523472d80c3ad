"""The grasps of a frame's answers, each beside the one that the ground-truth pose would have given."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from verefine_viz.core.algorithm_settings import GraspSettings
from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import InputError
from verefine_viz.core.problem import Problem
from verefine_viz.core.progress_token import NEVER_CANCELLED, ProgressToken
from verefine_viz.grasping.grasp_answer import GraspPair, GraspScene


@dataclass(frozen=True, eq=False)
class AnswerGrasps:
    """What became of a frame's answers."""

    pairs: Mapping[int, GraspPair] = field(default_factory=dict)
    """By instance_id; of objects with an answer."""
    notes: tuple[str, ...] = ()
    """Why objects are missing: no ground truth, no plane, no usable file of grasps."""


def answer_grasps(
    problem: Problem,
    poses: Sequence[Float | None],
    settings: GraspSettings,
    progress: ProgressToken = NEVER_CANCELLED,
) -> AnswerGrasps:
    """Carries out the chosen grasp of each answer, and of the ground truth, each in a world of its own.

    Args:
        problem: the frame.
        poses: the answers T_cam_obj (4, 4) [m] in the order of the targets; None = no answer.
        settings: gripper, grasps, masses.
        progress: checked at each moment of each grasp.

    Raises:
        Cancelled: through ``progress``.
    """
    try:
        scene = GraspScene(problem, settings)
    except InputError as error:
        return AnswerGrasps(notes=(f"no grasps: {error}",))
    pairs: dict[int, GraspPair] = {}
    notes: list[str] = []
    for target, T_cam_obj in zip(problem.targets, poses, strict=True):
        instance_id, T_gt = target.instance.instance_id, target.instance.T_cam_obj_gt
        if T_cam_obj is None or T_gt is None:
            continue
        try:
            pairs[instance_id] = GraspPair(
                scene.attempt(instance_id, T_cam_obj, progress), scene.attempt(instance_id, T_gt, progress)
            )
        except InputError as error:
            notes.append(f"no grasp of {target.model.name}: {error}")
    return AnswerGrasps(pairs, tuple(notes))
