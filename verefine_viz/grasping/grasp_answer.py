"""Would an answer's pose have lifted the object? Its grasps, which are free, which one is chosen, and how it ends."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.algorithm_settings import GraspSettings
from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import InputError
from verefine_viz.core.geometry import apply
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.problem import Problem
from verefine_viz.core.progress_token import NEVER_CANCELLED, ProgressToken
from verefine_viz.grasping.grasp_check import Obstacles, are_free, obstacles
from verefine_viz.grasping.grasp_poses import Grasps, grasps_of
from verefine_viz.grasping.grasp_trial import Body, GraspPath, GraspWorld
from verefine_viz.grasping.grasp_verdict import Verdict
from verefine_viz.grasping.gripper import PINCH_M
from verefine_viz.physics.colliders import Collider, collider


@dataclass(frozen=True, eq=False)
class GraspAttempt:
    """Result of grasping by one pose."""

    instance_id: int
    T_cam_obj: Float
    """(4, 4) the pose that the gripper relies on [m]."""
    verdict: Verdict
    grasps: Grasps
    is_free: NDArray[np.bool_]
    """(N,) which grasps are free at the estimated pose."""
    chosen: int | None
    """Index of the grasp that was carried out; None: none is free."""
    path: GraspPath | None
    """Path of the grasp; None where none was carried out."""

    @property
    def kinds(self) -> dict[str, NDArray[np.intp]]:
        """Indices of the grasps that are blocked, free but not chosen, and chosen."""
        chosen = np.arange(len(self.is_free)) == self.chosen
        return {
            "blocked": np.flatnonzero(~self.is_free),
            "free": np.flatnonzero(self.is_free & ~chosen),
            "chosen": np.flatnonzero(chosen),
        }


@dataclass(frozen=True, eq=False)
class GraspPair:
    """One object, grasped by its answer and by its ground-truth pose."""

    answer: GraspAttempt
    ground_truth: GraspAttempt


class GraspScene:
    """One frame in which grasps are tried; its objects are at their ground-truth poses.

    Args:
        problem: the frame.
        settings: gripper, grasps, masses.
        collider_of: makes a model's collider; by default its convex decomposition, from the cache. It does
            not depend on the collider of the method's own physics.

    Raises:
        InputError: the frame has no support plane, or an object no ground truth.
    """

    def __init__(
        self,
        problem: Problem,
        settings: GraspSettings,
        collider_of: Callable[[ObjectModel], Collider] | None = None,
    ) -> None:
        self._problem, self._settings = problem, settings
        self.around: Obstacles = obstacles(problem.observation)
        make = collider_of or (lambda model: collider(model, "decomposition"))
        T_world_cam = self.around.support.T_world_cam
        bodies: list[Body] = []
        for i in problem.instances:
            if i.T_cam_obj_gt is None:
                raise InputError(
                    f"frame {problem.frame}: object {i.obj_id} has no ground truth; a simulated grasp needs it"
                )
            bodies.append(Body(i.instance_id, make(problem.models[i.obj_id]), T_world_cam @ i.T_cam_obj_gt))
        self.bodies: tuple[Body, ...] = tuple(bodies)

    def grasps(self, instance_id: int, progress: ProgressToken = NEVER_CANCELLED) -> Grasps:
        """The grasps of an object.

        Raises:
            InputError: its file cannot be used.
            Cancelled: through ``progress``.
        """
        return grasps_of(self._problem.target(instance_id).model, self._settings, progress)

    def check_any_grasp(self) -> None:
        """
        Raises:
            InputError: no object of the frame has a grasp, wherever it may lie.
        """
        if not any(len(self.grasps(i.instance_id).T_obj_gripper) for i in self._problem.instances):
            raise InputError(
                f"frame {self._problem.frame}: no object can be gripped, as all are wider than grasp.opening_m = "
                f"{self._settings.opening_m:g} allows; expected one at least: open the gripper further"
            )

    def attempt(self, instance_id: int, T_cam_obj: Float, progress: ProgressToken = NEVER_CANCELLED) -> GraspAttempt:
        """Chooses a grasp for the estimated pose (4, 4) [m] and carries it out.

        The free grasp whose pads are nearest to the object's centre of mass is chosen.

        Raises:
            InputError: the file of the object's grasps cannot be used.
            Cancelled: through ``progress``.
        """
        grasps = self.grasps(instance_id, progress)
        is_free = are_free(T_cam_obj @ grasps.T_obj_gripper, self.around, self._settings)
        if not is_free.any():
            return GraspAttempt(instance_id, T_cam_obj, "no collision-free grasp", grasps, is_free, None, None)
        com = next(b.collider.com_obj for b in self.bodies if b.instance_id == instance_id)
        pinch = np.array([apply(T, np.array([[0.0, 0.0, PINCH_M]]))[0] for T in grasps.T_obj_gripper])
        away = np.where(is_free, np.linalg.norm(pinch - com, axis=1), np.inf)
        chosen = int(np.argmin(away))
        path = self.carry_out(instance_id, T_cam_obj @ grasps.T_obj_gripper[chosen], progress=progress)
        return GraspAttempt(instance_id, T_cam_obj, path.verdict, grasps, is_free, chosen, path)

    def carry_out(
        self,
        instance_id: int,
        T_cam_grasp: Float,
        without_target: bool = False,
        progress: ProgressToken = NEVER_CANCELLED,
    ) -> GraspPath:
        """One grasp (4, 4) in the camera frame, free or not; ``without_target`` takes the object away before."""
        bodies = [b for b in self.bodies if not (without_target and b.instance_id == instance_id)]
        support = self.around.support
        world = GraspWorld(bodies, instance_id, support.normal_world, self._settings)
        return world.run(support.T_world_cam @ T_cam_grasp, progress)


@dataclass(frozen=True, eq=False)
class AnswerGrasps:
    """Results of grasping by a frame's answers."""

    pairs: Mapping[int, GraspPair] = field(default_factory=dict)
    """Results by instance_id, of objects with an answer."""
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
            notes += (note for note in pairs[instance_id].answer.grasps.notes if note not in notes)
        except InputError as error:
            notes.append(f"no grasp of {target.model.name}: {error}")
    return AnswerGrasps(pairs, tuple(notes))
