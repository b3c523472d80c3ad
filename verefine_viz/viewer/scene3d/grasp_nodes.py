"""A grasp in 3D: which grasps are free, and gripper, objects and contacts at one moment of the one carried out."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import viser

from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import apply
from verefine_viz.core.palette import GRASP_COLORS, RGB, STAGE_COLORS
from verefine_viz.grasping.gripper import finger, fork, palm
from verefine_viz.viewer.scene3d.object_nodes import muted
from verefine_viz.viewer.scene3d.pose_nodes import add_mesh, add_wireframe, display_mesh, outline_of, place
from verefine_viz.viewer.snapshot.snapshot import Snapshot
from verefine_viz.viewer.state.grasp_trials import ShownGrasp

GRIPPER_COLOR = (205, 210, 218)
CONTACT_COLOR = (255, 40, 40)
WIDTH_PX = {"blocked": 1.0, "free": 2.0, "chosen": 4.5}
CHOOSING = ("", "settle", "approach")
"""Stages in which the grasps to choose from and the cloud are drawn; later the object is no longer there."""
LAYERS = frozenset({"cloud", "camera image", "plane", "gravity"})
"""What of the other layers is drawn while a grasp is: objects stand where the grasp has moved them."""


class GraspNodes:
    """Made when a grasp is shown first; afterwards poses and visibility change. Call :meth:`show` after a new frame
    has taken older nodes away.
    """

    def __init__(self, scene: viser.SceneApi, T_world_cam: Float) -> None:
        self._scene, self._T_world_cam = scene, T_world_cam
        self._made = False
        self._forks: dict[str, viser.LineSegmentsHandle] = {}
        self._drawn: ShownGrasp | None = None
        self._contacts: viser.PointCloudHandle | None = None
        self._estimates: dict[tuple[int, RGB], viser.LineSegmentsHandle] = {}

    def show(self, snapshot: Snapshot) -> None:
        """Draws the moment that is chosen, or nothing."""
        shown = snapshot.shown_grasp
        if shown is None and not self._made:
            return
        if not self._made:
            self._make(snapshot)
        self._draw(snapshot, shown)

    def animation(self, snapshot: Snapshot) -> Iterator[ShownGrasp]:
        """The grasp moment by moment, from its first to its last."""
        shown = snapshot.shown_grasp
        if shown is None:
            return
        for moment in range(shown.n_moments):
            self._draw(snapshot, now := shown.at(moment))
            yield now

    def _make(self, snapshot: Snapshot) -> None:
        self._made = True
        self._palm = add_mesh(self._scene, "/world/grasp/palm", (palm().corners, palm().faces), GRIPPER_COLOR)
        self._fingers: dict[int, viser.MeshHandle] = {}
        for side, name in ((-1, "left"), (1, "right")):
            box = finger(0.0, side)
            mesh = (box.corners, box.faces)
            self._fingers[side] = add_mesh(self._scene, f"/world/grasp/{name}", mesh, GRIPPER_COLOR)
        self._objects = {
            o.instance_id: add_mesh(
                self._scene, f"/world/grasp/object_{o.instance_id}", display_mesh(o.target.model), muted(o.color)
            )
            for o in snapshot.scene.objects
        }

    def _draw(self, snapshot: Snapshot, shown: ShownGrasp | None) -> None:
        path = None if shown is None else shown.attempt.path
        for node in (self._palm, *self._fingers.values(), *self._objects.values()):
            node.visible = path is not None
        if shown is not None and path is not None:
            k = shown.moment
            T = path.Ts_world_gripper[k]
            place(self._palm, T)
            for side, node in self._fingers.items():
                place(node, _moved(T, [0.0, side * path.gaps_m[k] / 2, 0.0]))
            for instance_id, node in self._objects.items():
                place(node, path.Ts_world_obj[instance_id][k])
        self._draw_forks(shown, snapshot.session.grasp.opening_m)
        self._draw_estimate(snapshot, shown)
        self._draw_contacts(shown)

    def _draw_forks(self, shown: ShownGrasp | None, gap_m: float) -> None:
        is_drawn = shown is not None and shown.stage in CHOOSING
        if shown is not None and is_drawn and (self._drawn is None or self._drawn.attempt is not shown.attempt):
            for node in self._forks.values():
                node.remove()
            self._forks, self._drawn = {}, shown
            Ts = self._T_world_cam @ shown.attempt.T_cam_obj @ shown.attempt.grasps.T_obj_gripper
            for kind, indices in shown.attempt.kinds.items():
                if len(indices):
                    segments = np.concatenate(
                        [apply(T, fork(gap_m).reshape(-1, 3)).reshape(-1, 2, 3) for T in Ts[indices]]
                    )
                    self._forks[kind] = add_wireframe(
                        self._scene, f"/world/grasp/{kind}", segments.astype(np.float32), GRASP_COLORS[kind],
                        WIDTH_PX[kind],
                    )  # fmt: skip
        for node in self._forks.values():
            node.visible = is_drawn

    def _draw_estimate(self, snapshot: Snapshot, shown: ShownGrasp | None) -> None:
        """The outline of the object where the gripper takes it to be."""
        for node in self._estimates.values():
            node.visible = False
        if shown is None:
            return
        own, model = snapshot.target.instance.instance_id, snapshot.target.model
        trusted = "best" if snapshot.options.edited is None else "edited"
        color = STAGE_COLORS[trusted if shown.by == "pose" else "ground truth"]
        if (own, color) not in self._estimates:
            name = f"/cam/grasp_estimate/{len(self._estimates)}"
            self._estimates[own, color] = add_wireframe(self._scene, name, outline_of(model), color, 1.6)
        node = self._estimates[own, color]
        place(node, shown.attempt.T_cam_obj)
        node.visible = True

    def _draw_contacts(self, shown: ShownGrasp | None) -> None:
        path = None if shown is None else shown.attempt.path
        points = [] if shown is None or path is None else [c.point_world for c in path.contacts[shown.moment]]
        if self._contacts is not None:
            self._contacts.visible = bool(points)
        if points:
            self._contacts = self._scene.add_point_cloud(
                "/world/grasp/contacts", np.array(points, np.float32), CONTACT_COLOR, precision="float32",
                point_size=0.005, point_shape="circle", point_shading="flat",
            )  # fmt: skip


def _moved(T: Float, by_m: list[float]) -> Float:
    moved = T.copy()
    moved[:3, 3] += T[:3, :3] @ np.array(by_m)
    return moved
