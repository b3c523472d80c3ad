"""Whole objects in 3D: those not in focus with names and overlaps, and those of two compared runs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import viser

from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import apply
from verefine_viz.core.palette import RGB, SIDE_COLORS
from verefine_viz.core.problem import Problem, Target
from verefine_viz.viewer.commands import Command, Focus
from verefine_viz.viewer.scene3d.pose_nodes import add_mesh, add_skin, add_wireframe, display_mesh, outline_of, place
from verefine_viz.viewer.snapshot.scene_state import ObjectState, Phase
from verefine_viz.viewer.snapshot.snapshot import Snapshot
from verefine_viz.viewer.text.display_names import verdict_mark

OPACITY: dict[Phase, float] = {
    "waiting": 0.16,
    "working": 0.55,
    "placed": 0.8,
    "rolled out": 0.3,
    "done": 0.8,
    "no pose": 0.0,
}
MUTED = 0.45
"""Share of grey in the colour of a placed object."""
GREY = np.array([128, 128, 128])
MARKER_M, ABOVE_M = 0.005, 0.012
LABEL, LABEL_IN_FOCUS = 0.6, 0.75
"""Size of a name against viser's own: objects stand close, and names must not hide each other."""
LETTER_PX, LINE_PX, FRAME_PX = 7.0, 17.0, 5.0
"""Width and height of viser's letters on the screen, and what a label has around its name."""
FOCAL_PX = 260.0
"""Of the first look, in a 3D view 400 pixels high; in a higher one names stand a little further apart than needed."""
OVERLAP_COLOR = (255, 30, 30)
OVERLAP_PX = 4.0


@dataclass
class _Nodes:
    """One object's handles, and how they look now."""

    mesh: viser.MeshHandle
    marker: viser.IcosphereHandle
    label: viser.LabelHandle
    skin: viser.GlbHandle | None
    """With its texture, instead of ``mesh`` once it is placed; None without one."""
    points: Float
    """(n, 3) of the model: its highest point carries the label."""
    look: tuple[float, RGB] | None = None
    pose: bytes = b""
    above_cam: Float = field(default_factory=lambda: np.zeros(3))
    """Where the label stands as long as no other is there."""


class ObjectNodes:
    """Made once per frame; afterwards poses, colours and visibility change."""

    def __init__(
        self, server: viser.ViserServer, snapshot: Snapshot, T_world_cam: Float, send: Callable[[Command], None]
    ) -> None:
        self._scene, self._first_look, self._T_world_cam = server.scene, server.initial_camera, T_world_cam
        self._up_cam = T_world_cam[:3, :3].T @ np.array([0.0, 0.0, 1.0])
        self._nodes: dict[int, _Nodes] = {}
        self._overlap_points: viser.PointCloudHandle | None = None
        self._overlaps_shown: tuple[Any, ...] = ()
        if len(snapshot.scene.objects) > 1:
            for o in snapshot.scene.objects:
                self._nodes[o.instance_id] = self._make(o.target, o.label, o.color, send)

    def _make(self, target: Target, label: str, color: RGB, send: Callable[[Command], None]) -> _Nodes:
        own = target.instance.instance_id
        name = f"/cam/objects/{own}"
        mesh = add_mesh(self._scene, name, display_mesh(target.model), color, OPACITY["waiting"])
        skin = add_skin(self._scene, f"{name}_skin", target.model)
        for node in (mesh, skin):
            if node is not None:
                node.on_click(lambda _: send(Focus(own)))
        marker = self._scene.add_icosphere(f"{name}_marker", MARKER_M, color, visible=False, cast_shadow=False)
        text = self._scene.add_label(
            f"{name}_name", label, font_screen_scale=LABEL, anchor="bottom-center", visible=False
        )
        return _Nodes(mesh, marker, text, skin, target.model.points[::4])

    def show(self, snapshot: Snapshot) -> None:
        """Poses and looks at the cursor."""
        drawn = "others" in snapshot.options.layers
        for o in snapshot.scene.objects:
            nodes = self._nodes.get(o.instance_id)
            if nodes is None:
                continue
            in_focus = o.instance_id == snapshot.target.instance.instance_id
            T_cam_obj = self._pose(snapshot, o, in_focus)
            nodes.marker.visible = nodes.label.visible = drawn and T_cam_obj is not None
            nodes.mesh.visible = drawn and T_cam_obj is not None and (snapshot.is_answer or not in_focus)
            if nodes.skin is not None:
                nodes.skin.visible = nodes.mesh.visible and o.phase in ("placed", "done")
                nodes.mesh.visible = nodes.mesh.visible and not nodes.skin.visible
            if T_cam_obj is not None:
                self._move(nodes, T_cam_obj)
                self._dress(nodes, o)
                # What is still worked on is neither right nor wrong yet.
                mark = verdict_mark(o.errors) if o.phase in ("placed", "done") else ""
                nodes.label.text = f"{o.label} {mark}".strip()
                nodes.label.font_screen_scale = LABEL_IN_FOCUS if in_focus else LABEL
        self._place_labels([nodes for nodes in self._nodes.values() if nodes.label.visible])

    def _place_labels(self, shown: list[_Nodes]) -> None:
        """Each above its object, or above the labels that are there already as seen from the first look."""
        if not shown:
            return
        look = self._first_look
        ahead = np.asarray(look.look_at) - np.asarray(look.position)
        ahead = ahead / np.linalg.norm(ahead)
        right = np.cross(ahead, [0.0, 0.0, 1.0])
        right /= max(float(np.linalg.norm(right)), 1e-9)
        upward = np.cross(right, ahead)
        seen = apply(self._T_world_cam, np.array([nodes.above_cam for nodes in shown])) - np.asarray(look.position)
        distances = np.maximum(seen @ ahead, 1e-3)
        places_px = FOCAL_PX * np.stack([seen @ right, seen @ upward], axis=1) / distances[:, None]
        scales = np.array([nodes.label.font_screen_scale for nodes in shown])
        letters = np.array([len(nodes.label.text) for nodes in shown])
        sizes_px = np.stack([LETTER_PX * letters * scales + FRAME_PX, LINE_PX * scales + FRAME_PX], axis=1)
        lifts_m = lifts_px(places_px, sizes_px) / FOCAL_PX * distances / max(float(upward[2]), 0.2)
        for nodes, lift_m in zip(shown, lifts_m, strict=True):
            nodes.label.position = nodes.above_cam + lift_m * self._up_cam

    def _pose(self, snapshot: Snapshot, o: ObjectState, in_focus: bool) -> Float | None:
        """Where the object stands; a waiting one without an iteration at its best hypothesis, which is its answer."""
        if in_focus and not snapshot.is_answer:
            shown = snapshot.poses.get("accepted") or snapshot.poses.get("current") or snapshot.poses.get("best")
            return shown.T_cam_obj if shown else o.T_cam_obj
        return o.T_cam_obj

    def _move(self, nodes: _Nodes, T_cam_obj: Float) -> None:
        pose = T_cam_obj.tobytes()
        if pose == nodes.pose:
            return
        nodes.pose = pose
        place(nodes.mesh, T_cam_obj)
        if nodes.skin is not None:
            place(nodes.skin, T_cam_obj)
        points = apply(T_cam_obj, nodes.points)
        heights = points @ self._up_cam
        middle = points.mean(axis=0)
        top = middle + (float(heights.max()) - float(middle @ self._up_cam) + ABOVE_M) * self._up_cam
        nodes.marker.position = top
        nodes.above_cam = top + ABOVE_M * self._up_cam

    def _dress(self, nodes: _Nodes, o: ObjectState) -> None:
        look = (OPACITY[o.phase], muted(o.color) if o.phase in ("placed", "done") else o.color)
        if look != nodes.look:
            nodes.look = look
            nodes.mesh.opacity, nodes.mesh.color = look

    def show_overlaps(self, snapshot: Snapshot) -> None:
        """Red points where objects are partly in the same place."""
        overlaps = snapshot.physics.overlaps if "overlaps" in snapshot.options.layers else ()
        if [id(one) for one in overlaps] == [id(one) for one in self._overlaps_shown]:
            return
        self._overlaps_shown = overlaps
        points = [one.points_cam for one in overlaps if len(one.points_cam)]
        if self._overlap_points is not None:
            self._overlap_points.visible = bool(points)
        if points:
            together = np.concatenate(points).astype(np.float32)
            colors = np.tile(np.array(OVERLAP_COLOR, np.uint8), (len(together), 1))
            size = float(np.median(together[:, 2])) / snapshot.problem.observation.camera.fx * OVERLAP_PX
            self._overlap_points = self._scene.add_point_cloud(
                "/cam/overlaps", together, colors, precision="float32", point_size=size, point_shape="circle",
                point_shading="flat",
            )  # fmt: skip


def lifts_px(places_px: Float, sizes_px: Float) -> Float:
    """How far up each of several labels (n,) is moved so that none covers another.

    Args:
        places_px: (n, 2) the middle of each lower edge, right and up.
        sizes_px: (n, 2) widths and heights.
    """
    lifts = np.zeros(len(places_px))
    placed: list[int] = []
    for k in np.argsort(places_px[:, 1]):
        for j in sorted(placed, key=lambda j: places_px[j, 1] + lifts[j]):
            (x, y), (width, height) = places_px[k], sizes_px[k]
            bottom = places_px[j, 1] + lifts[j]
            is_beside = abs(x - places_px[j, 0]) >= (width + sizes_px[j, 0]) / 2
            if not is_beside and y + lifts[k] < bottom + sizes_px[j, 1] and y + lifts[k] + height > bottom:
                lifts[k] = bottom + sizes_px[j, 1] - y
        placed.append(int(k))
    return lifts


def muted(color: RGB) -> RGB:
    """The colour of an object that is placed."""
    r, g, b = (int(x) for x in np.round((1 - MUTED) * np.array(color) + MUTED * GREY))
    return r, g, b


# Two runs in 3D: every object where A has it, solid, and where B has it, as an outline.

COMPARED_OPACITY = 0.78
OUTLINE_PX = 2.2


class ComparisonNodes:
    """Holds the handles of a comparison's objects; nothing is made before something is compared."""

    def __init__(self, server: viser.ViserServer) -> None:
        self._scene = server.scene
        self._problem: Problem | None = None
        self._pairs: dict[int, tuple[viser.SceneNodeHandle, viser.SceneNodeHandle]] = {}
        """By instance: as A has it, as B has it."""

    def show(self, snapshot: Snapshot) -> None:
        """Poses and visibility; call it after the frame was drawn, which takes older nodes away."""
        if snapshot.problem is not self._problem:
            self._pairs, self._problem = {}, snapshot.problem
        sides = snapshot.comparison
        if sides is None:
            for node in (node for pair in self._pairs.values() for node in pair):
                node.visible = False
            return
        for own in (i.instance_id for i in snapshot.problem.instances):
            if own not in self._pairs:
                self._pairs[own] = self._make(snapshot.problem.target(own))
            poses = sides.poses.get(own, (None, None))
            for node, T_cam_obj, side in zip(self._pairs[own], poses, "AB", strict=True):
                if T_cam_obj is not None:
                    place(node, T_cam_obj)
                node.visible = T_cam_obj is not None and side in sides.shown

    def _make(self, target: Target) -> tuple[viser.SceneNodeHandle, viser.SceneNodeHandle]:
        own, model = target.instance.instance_id, target.model
        return (
            add_mesh(self._scene, f"/cam/sides/a_{own}", display_mesh(model), SIDE_COLORS["A"], COMPARED_OPACITY),
            add_wireframe(self._scene, f"/cam/sides/b_{own}", outline_of(model), SIDE_COLORS["B"], OUTLINE_PX),
        )
