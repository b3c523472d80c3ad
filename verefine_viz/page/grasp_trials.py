"""Grasps that were carried out in the open frame, and how they ended."""

from __future__ import annotations

from collections import OrderedDict
from typing import TYPE_CHECKING

from verefine_viz.core.algorithm_settings import GraspSettings
from verefine_viz.core.arrays import Float
from verefine_viz.core.problem import Problem
from verefine_viz.core.progress_token import NEVER_CANCELLED, ProgressToken

if TYPE_CHECKING:
    from verefine_viz.grasping.grasp_answer import GraspAttempt, GraspPair, GraspScene

_CACHED = 60
"""Grasps; each is some 100 kB per object of the frame."""


class GraspTrials:
    """Carries grasps out in the open frame and caches how they end."""

    def __init__(self) -> None:
        self._scene: tuple[Problem, GraspSettings, GraspScene] | None = None
        self._attempts: OrderedDict[tuple[int, bytes], GraspAttempt] = OrderedDict()

    def carry_out(
        self,
        problem: Problem,
        settings: GraspSettings,
        instance_id: int,
        T_cam_obj: Float,
        progress: ProgressToken = NEVER_CANCELLED,
    ) -> GraspPair:
        """Grasp an object by a pose (4, 4), and by the ground truth.

        Raises:
            InputError: the frame has no support plane, an object no ground truth, or a file of grasps is unusable.
            Cancelled: it is no longer wanted.
        """
        from verefine_viz.grasping.grasp_answer import GraspPair

        scene = self._scene_of(problem, settings, progress)
        T_gt = problem.target(instance_id).instance.T_cam_obj_gt
        assert T_gt is not None, "the scene has refused it"
        for T in (T_cam_obj, T_gt):
            key = (instance_id, T.tobytes())
            if key not in self._attempts:
                self._attempts[key] = scene.attempt(instance_id, T, progress)
        pair = GraspPair(self._attempts[instance_id, T_cam_obj.tobytes()], self._attempts[instance_id, T_gt.tobytes()])
        while len(self._attempts) > _CACHED:
            self._attempts.popitem(last=False)
        return pair

    def known(
        self, problem: Problem, settings: GraspSettings, instance_id: int, T_cam_obj: Float | None
    ) -> GraspPair | None:
        """Return what :meth:`carry_out` returned if it was called before, else None."""
        T_gt = problem.target(instance_id).instance.T_cam_obj_gt
        if T_cam_obj is None or T_gt is None or not self._is_of(problem, settings):
            return None
        from verefine_viz.grasping.grasp_answer import GraspPair

        one, other = (self._attempts.get((instance_id, T.tobytes())) for T in (T_cam_obj, T_gt))
        return GraspPair(one, other) if one is not None and other is not None else None

    def _is_of(self, problem: Problem, settings: GraspSettings) -> bool:
        return self._scene is not None and self._scene[0] is problem and self._scene[1] == settings

    def _scene_of(self, problem: Problem, settings: GraspSettings, progress: ProgressToken) -> GraspScene:
        if self._scene is None or not self._is_of(problem, settings):
            from verefine_viz.grasping.grasp_answer import GraspScene  # Loads Bullet and open3d.

            progress.checkpoint("Preparing the grasp: convex parts of all objects.")
            self._scene = problem, settings, GraspScene(problem, settings)
            self._attempts.clear()
        return self._scene[2]
