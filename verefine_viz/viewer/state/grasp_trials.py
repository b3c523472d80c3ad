"""The grasps that were carried out on the page, and what of them is shown."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from verefine_viz.core.algorithm_settings import GraspSettings
from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import InputError
from verefine_viz.core.problem import Problem
from verefine_viz.core.progress_token import NEVER_CANCELLED, ProgressToken
from verefine_viz.viewer.grasp_commands import GraspedBy

if TYPE_CHECKING:
    from verefine_viz.grasping.grasp_answer import AnswerGrasps, GraspAttempt, GraspPair, GraspScene

_CACHED = 60
"""Grasps; each is some 100 kB per object of the frame."""


class GraspTrials:
    """Carries grasps out in the open frame and caches how they end.

    Args:
        progress: checked at each moment of a grasp.
    """

    def __init__(self, progress: ProgressToken = NEVER_CANCELLED) -> None:
        self._progress = progress
        self._scene: tuple[Problem, GraspSettings, GraspScene] | None = None
        self._attempts: OrderedDict[tuple[int, bytes], GraspAttempt] = OrderedDict()

    def carry_out(self, problem: Problem, settings: GraspSettings, instance_id: int, T_cam_obj: Float) -> GraspPair:
        """The grasp by a pose (4, 4), and by the ground truth.

        Raises:
            InputError: the frame has no support plane, an object no ground truth, or a file of grasps is unusable.
            Cancelled: it is no longer wanted.
        """
        from verefine_viz.grasping.grasp_answer import GraspPair

        scene = self._scene_of(problem, settings)
        T_gt = problem.target(instance_id).instance.T_cam_obj_gt
        assert T_gt is not None, "the scene has refused it"
        for T in (T_cam_obj, T_gt):
            key = (instance_id, T.tobytes())
            if key not in self._attempts:
                self._attempts[key] = scene.attempt(instance_id, T, self._progress)
        while len(self._attempts) > _CACHED:
            self._attempts.popitem(last=False)
        return GraspPair(self._attempts[instance_id, T_cam_obj.tobytes()], self._attempts[instance_id, T_gt.tobytes()])

    def known(
        self, problem: Problem, settings: GraspSettings, instance_id: int, T_cam_obj: Float | None
    ) -> GraspPair | None:
        """What :meth:`carry_out` returned if it was called before, else None."""
        T_gt = problem.target(instance_id).instance.T_cam_obj_gt
        if T_cam_obj is None or T_gt is None or not self._is_of(problem, settings):
            return None
        from verefine_viz.grasping.grasp_answer import GraspPair

        pair = [self._attempts.get((instance_id, T.tobytes())) for T in (T_cam_obj, T_gt)]
        return GraspPair(pair[0], pair[1]) if pair[0] is not None and pair[1] is not None else None

    def of_answers(self, problem: Problem, settings: GraspSettings, poses: Sequence[Float | None]) -> AnswerGrasps:
        """The grasps of a finished run's answers: those that are known, and all where the session asks for them.

        Args:
            problem: the frame.
            settings: of the session.
            poses: the answers T_cam_obj (4, 4) in the order of the objects; None = no answer.

        Raises:
            Cancelled: it is no longer wanted.
        """
        from verefine_viz.grasping.grasp_answer import AnswerGrasps

        pairs: dict[int, GraspPair] = {}
        notes: dict[str, None] = {}
        ask = self.carry_out if settings.answers else self.known
        for instance, T_cam_obj in zip(problem.instances, poses, strict=True):
            if T_cam_obj is not None:
                try:
                    pair = ask(problem, settings, instance.instance_id, T_cam_obj)
                except InputError as error:  # Of the frame, or of this object's file.
                    notes[f"no grasp: {error}"] = None
                    continue
                if pair is not None:
                    pairs[instance.instance_id] = pair
        return AnswerGrasps(pairs, tuple(notes))

    def _is_of(self, problem: Problem, settings: GraspSettings) -> bool:
        return self._scene is not None and self._scene[0] is problem and self._scene[1] == settings

    def _scene_of(self, problem: Problem, settings: GraspSettings) -> GraspScene:
        if self._scene is None or not self._is_of(problem, settings):
            from verefine_viz.grasping.grasp_answer import GraspScene  # Loads Bullet and open3d.

            self._progress.checkpoint("Preparing the grasp: convex parts of all objects.")
            self._scene = problem, settings, GraspScene(problem, settings)
            self._attempts.clear()
        return self._scene[2]


@dataclass(frozen=True, eq=False)
class ShownGrasp:
    """A grasp at one of its moments."""

    by: GraspedBy
    attempt: GraspAttempt
    moment: int
    """Of ``attempt.path``, from 0; 0 where no grasp was free."""

    @property
    def n_moments(self) -> int:
        """1 where no grasp was free."""
        return 1 if self.attempt.path is None else self.attempt.path.n_moments

    @property
    def stage(self) -> str:
        """Of the grasp; empty where none was free."""
        return "" if self.attempt.path is None else self.attempt.path.stages[self.moment]

    def at(self, moment: int) -> ShownGrasp:
        """The same at another moment; beyond its end at its last."""
        return ShownGrasp(self.by, self.attempt, int(np.clip(moment, 0, self.n_moments - 1)))


def shown_grasp(pair: GraspPair | None, by: GraspedBy, moment: int | None) -> ShownGrasp | None:
    """What of a pair is drawn; None where nothing is."""
    if pair is None or moment is None:
        return None
    return ShownGrasp(by, pair.answer if by == "pose" else pair.ground_truth, 0).at(moment)
