"""A grasp in 3D: the gripper at one of its moments, the possible grasps, and where it presses."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import viser

from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import apply, inverse
from verefine_viz.core.palette import GRASP_COLORS
from verefine_viz.grasping.gripper import finger, fork, palm
from verefine_viz.page.scene3d.drawn_models import add_outline, add_solid, show_at

if TYPE_CHECKING:
    from verefine_viz.grasping.grasp_answer import GraspAttempt  # Loads Bullet.

CHOOSING = ("settle", "approach")
"""Stages in which the possible grasps and the cloud are drawn; later the object has moved away."""
_GRIPPER_COLOR = (205, 210, 218)
_CONTACT_COLOR = (255, 40, 40)
_WIDTH_PX = {"blocked": 1.0, "free": 2.0, "chosen": 4.5}


class GraspDrawing:
    """Made when a grasp is first shown."""

    def __init__(self, scene: viser.SceneApi, T_world_cam: Float) -> None:
        self._scene, self._T_world_cam = scene, T_world_cam
        boxes = {"palm": palm(), "left": finger(0.0, -1), "right": finger(0.0, 1)}
        self._gripper = {
            name: add_solid(scene, f"/world/grasp/{name}", (box.corners, box.faces), _GRIPPER_COLOR)
            for name, box in boxes.items()
        }
        self.is_choosing = False
        """Whether the gripper has not closed yet."""
        self._forks: dict[str, viser.LineSegmentsHandle] = {}
        self._attempt: GraspAttempt | None = None
        self._contacts = scene.add_point_cloud(
            "/world/grasp/contacts", np.zeros((0, 3), np.float32), _CONTACT_COLOR, precision="float32",
            point_size=0.005, point_shape="circle", point_shading="flat", visible=False,
        )  # fmt: skip

    def show(self, attempt: GraspAttempt | None, moment: int, opening_m: float) -> dict[int, Float]:
        """Draw a moment of a grasp, or nothing; return T_cam_obj of the objects at that moment, by instance."""
        path = None if attempt is None else attempt.path
        k = 0 if path is None else min(moment, path.n_moments - 1)
        for name, node in self._gripper.items():
            T = None
            if path is not None:
                T = path.Ts_world_gripper[k].copy()
                T[:3, 3] += {"palm": 0, "left": -0.5, "right": 0.5}[name] * path.gaps_m[k] * T[:3, 1]
            show_at(node, T)
        self.is_choosing = path is None or path.stages[k] in CHOOSING
        self._show_forks(attempt, opening_m)
        points = np.array([c.point_world for c in path.contacts[k]] if path is not None else [], np.float32)
        self._contacts.visible = len(points) > 0
        if len(points):
            self._contacts.points = points
            self._contacts.colors = np.tile(np.array(_CONTACT_COLOR, np.uint8), (len(points), 1))
        if path is None:
            return {}
        T_cam_world = inverse(self._T_world_cam)
        return {instance_id: T_cam_world @ Ts[k] for instance_id, Ts in path.Ts_world_obj.items()}

    def _show_forks(self, attempt: GraspAttempt | None, opening_m: float) -> None:
        """Draw the grasps at the pose that the gripper relies on: blocked, free, and the one carried out."""
        if attempt is not None and attempt is not self._attempt:
            for node in self._forks.values():
                node.remove()
            self._attempt, self._forks = attempt, {}
            segments = fork(opening_m).reshape(-1, 3)
            Ts = self._T_world_cam @ attempt.T_cam_obj @ attempt.grasps.T_obj_gripper
            for kind, indices in attempt.kinds.items():
                if len(indices):
                    lines = np.concatenate([apply(T, segments).reshape(-1, 2, 3) for T in Ts[indices]])
                    self._forks[kind] = add_outline(
                        self._scene,
                        f"/world/grasp/{kind}",
                        lines.astype(np.float32),
                        GRASP_COLORS[kind],
                        _WIDTH_PX[kind],
                    )
        for node in self._forks.values():
            node.visible = attempt is not None and self.is_choosing
