"""The 3D scene: the frame with its cloud, plane and camera; the object in focus with its poses; the gizmo."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import viser

from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import apply, inverse, rotation_of_quat_wxyz, transform
from verefine_viz.core.observation import Observation
from verefine_viz.core.palette import STAGE_COLORS
from verefine_viz.core.problem import Problem
from verefine_viz.core.records import Contacts
from verefine_viz.viewer.commands import Command, DragPose, ProbePixel
from verefine_viz.viewer.drawing.image_layers import posed_objects
from verefine_viz.viewer.drawing.plausibility_picture import LIGHTS, drawn_stage
from verefine_viz.viewer.scene3d.frame_nodes import (
    IMAGE_PLANE_M,
    CameraNodes,
    Cloud,
    GroundNodes,
    clicked_pixel,
    cloud_colors,
    cloud_of,
    distance_colors,
    measured_points,
)
from verefine_viz.viewer.scene3d.grasp_nodes import CHOOSING, LAYERS, GraspNodes
from verefine_viz.viewer.scene3d.object_nodes import ObjectNodes
from verefine_viz.viewer.scene3d.pose_nodes import PoseNodes, add_mesh, display_mesh, place
from verefine_viz.viewer.snapshot.snapshot import Snapshot
from verefine_viz.viewer.state.edited_pose import SentPoses
from verefine_viz.viewer.text.display_names import in_focus
from verefine_viz.viewer.text.plausibility_verdict import plausibility_verdict

# Where the camera is when a frame is opened.


def aim(server: viser.ViserServer, snapshot: Snapshot, T_world_cam: Float) -> None:
    """The first look: from beside the sensor, with the objects in the middle."""
    points = measured_points(snapshot.problem)
    middle = points.mean(axis=0)
    extent = 2 * float(np.percentile(np.linalg.norm(points - middle, axis=1), 90))
    distance = max(0.17, 1.0 * extent)
    towards_sensor = -middle / np.linalg.norm(middle)
    beside = np.array([0.75, -0.35, 0.0])
    direction = towards_sensor + beside
    eye_cam = middle + distance * direction / np.linalg.norm(direction)
    eye, target = apply(T_world_cam, np.array([eye_cam, middle]))
    camera = server.initial_camera
    camera.position, camera.look_at, camera.up = eye, target, np.array([0.0, 0.0, 1.0])
    camera.near = UNCUT_NEAR_M
    for client in server.get_clients().values():
        look_again(server, client)


def look_again(server: viser.ViserServer, client: viser.ClientHandle) -> None:
    """Takes one browser's camera back to the first look."""
    first = server.initial_camera
    if first.up is not None:
        client.camera.up_direction = first.up
    client.camera.position, client.camera.look_at, client.camera.fov = first.position, first.look_at, first.fov


def look_through(client: viser.ClientHandle, observation: Observation, T_world_cam: Float) -> None:
    """Puts one browser's camera exactly where the sensor was, looking along its axis, as high an image as it took."""
    points = observation.camera.back_project(observation.depth_m)[observation.depth_m > 0]
    ahead = float(np.median(points[:, 2])) if len(points) else 1.0
    eye, target = apply(T_world_cam, np.array([[0.0, 0.0, 0.0], [0.0, 0.0, ahead]]))
    client.camera.up_direction = -T_world_cam[:3, 1]
    client.camera.position, client.camera.look_at = eye, target
    client.camera.fov = 2 * math.atan2(observation.camera.height / 2, observation.camera.fy)


def look_at_object(client: viser.ClientHandle, points_world: Float) -> None:
    """Takes one browser's camera close to points (n, 3), from the side from which it looks now."""
    low, high = points_world.min(axis=0), points_world.max(axis=0)
    middle, size = (low + high) / 2, float(np.linalg.norm(high - low))
    back = np.asarray(client.camera.position) - np.asarray(client.camera.look_at)
    distance = 1.2 * size / (2 * math.tan(client.camera.fov / 2)) + size / 2
    client.camera.position = middle + back / max(float(np.linalg.norm(back)), 1e-9) * distance
    client.camera.look_at = middle


UNCUT_NEAR_M = 0.005
"""From where on the view is drawn [m]."""


@dataclass(frozen=True, eq=False)
class Cut:
    """What is cut off in front of a ball: a plane that is square to the view moves through it."""

    centre_world: Float
    """(3,) [m]."""
    diameter_m: float
    percent: int
    """Of the diameter; 0 = nothing is cut off."""

    def show(self, camera: viser.CameraHandle) -> None:
        """Draws the view of one browser from the plane on."""
        near_m = UNCUT_NEAR_M
        if self.percent:
            ahead = camera.look_at - camera.position
            depth_m = (self.centre_world - camera.position) @ ahead / max(float(np.linalg.norm(ahead)), 1e-9)
            near_m = max(float(depth_m) + (self.percent / 100 - 0.5) * self.diameter_m, UNCUT_NEAR_M)
        camera.near = near_m  # The same as before is not sent.


_UP_FROM_CAMERA = transform(np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]), np.zeros(3))
"""World from camera where no support is known: up is the image's up."""


class SceneView:
    """Holds the handles of the scene; :meth:`show` is the only way to change it."""

    def __init__(self, server: viser.ViserServer, send: Callable[[Command], None]) -> None:
        self._server, self._send = server, send
        self._problem: Problem | None = None
        self._nodes: PoseNodes | None = None
        self._all_nodes: dict[int, PoseNodes] = {}
        self._gizmo: viser.TransformControlsHandle | None = None
        self._dragged = SentPoses()
        self._snapshot: Snapshot | None = None
        # An environment map costs software renderers many seconds and shows nothing here.
        server.scene.configure_environment_map(None)
        server.scene.configure_default_lights(True, cast_shadow=False)
        server.scene.world_axes.visible = False
        server.scene.on_click()(self._on_click)
        self._cut = Cut(np.zeros(3), 0.0, 0)

        @server.on_client_connect
        def _(client: viser.ClientHandle) -> None:
            @client.camera.on_update
            def _(camera: viser.CameraHandle) -> None:
                if self._cut.percent:  # The plane goes with the camera.
                    self._cut.show(camera)

    def show(self, snapshot: Snapshot) -> None:
        """Draws a snapshot: new nodes for a new frame or object, otherwise poses, colours and visibility only."""
        if snapshot.problem is not self._problem:
            self._load_frame(snapshot)
        self._choose_nodes(snapshot)
        self._snapshot = snapshot
        self._grasp.show(snapshot)
        if snapshot.shown_grasp is not None:
            drawn = replace(snapshot.options, layers=snapshot.options.layers & LAYERS)
            snapshot = replace(snapshot, options=drawn)
        assert self._nodes is not None
        self._nodes.show(snapshot)
        self._others.show(snapshot)
        self._show_contacts(snapshot)
        self._show_gizmo(snapshot)
        self._show_cut(snapshot)
        self.show_deep(snapshot)
        self._ground.show(snapshot)

    def show_deep(self, snapshot: Snapshot) -> None:
        """What needs score maps or plausibility; the rest is left as it is, be it an animation."""
        shown = snapshot.shown_grasp
        self._points.visible = "cloud" in snapshot.options.layers and (shown is None or shown.stage in CHOOSING)
        self._camera.show(snapshot)
        if snapshot.deep:
            self._show_cloud(snapshot)
            self._camera.show_map(snapshot)
        if snapshot.has_plausibility:
            self._show_polygon(snapshot)
        self._others.show_overlaps(snapshot)

    def show_physics(self, snapshot: Snapshot) -> None:
        """What was worked out about the whole scene since."""
        self._show_polygon(snapshot)
        self._others.show_overlaps(snapshot)

    def _choose_nodes(self, snapshot: Snapshot) -> None:
        """The nodes of the object in focus: made once, since a run may go from object to object all the time."""
        key = snapshot.target.instance.instance_id
        nodes = self._all_nodes.get(key)
        if nodes is not None and nodes.n_arms != snapshot.n_arms:  # Another branch may have other initial poses.
            nodes.hide()
            nodes = None
        if nodes is None:
            nodes = PoseNodes(self._server, snapshot.target.model, snapshot.n_arms, self._send, key)
            self._all_nodes[key] = nodes
        if self._nodes is not None and self._nodes is not nodes:
            self._nodes.hide()
        self._nodes = nodes

    def animation(self, snapshot: Snapshot) -> Iterator[None]:
        """The iteration at the cursor, picture by picture."""
        assert self._nodes is not None
        yield from self._nodes.animation(snapshot)

    def path_animation(self, snapshot: Snapshot) -> Iterator[None]:
        """The simulated path with its contacts, pose by pose."""
        assert self._nodes is not None
        for k in self._nodes.path_animation(snapshot):
            self._draw_contacts(snapshot, k)
            yield
            yield

    def grasp_animation(self, snapshot: Snapshot) -> Iterator[None]:
        """The grasp that is shown, moment by moment."""
        for now in self._grasp.animation(snapshot):
            self._points.visible = "cloud" in snapshot.options.layers and now.stage in CHOOSING
            yield

    def look_at_grasp(self, snapshot: Snapshot) -> None:
        """Takes the camera of every browser to where the gripper and the object are, from the start to the end."""
        attempt = snapshot.shown_grasp.attempt if snapshot.shown_grasp is not None else None
        if attempt is None or attempt.path is None:
            return
        points = snapshot.problem.target(attempt.instance_id).model.points
        Ts = attempt.path.Ts_world_obj[attempt.instance_id]
        places = [apply(Ts[0], points), apply(Ts[-1], points), attempt.path.Ts_world_gripper[:, :3, 3]]
        for client in self._server.get_clients().values():
            look_at_object(client, np.concatenate(places))

    def move_camera(self, client: viser.ClientHandle, to: Literal["sensor", "object"], snapshot: Snapshot) -> None:
        """The view of one browser, to the sensor or close to the object in focus."""
        if to == "sensor":
            look_through(client, snapshot.problem.observation, self._T_world_cam)
            return
        look_at_object(client, self._posed_points(snapshot))

    def _posed_points(self, snapshot: Snapshot) -> Float:
        """Points of the object in focus, or of all objects of the scene (n, 3), in the world [m]."""
        posed = snapshot.b or snapshot.a
        points = [apply(T, target.model.points) for target, T in posed_objects(snapshot, posed)] if posed else []
        points_cam = np.concatenate(points) if points else measured_points(snapshot.problem)
        return apply(self._T_world_cam, points_cam)

    def _show_cut(self, snapshot: Snapshot) -> None:
        percent, before = snapshot.options.cut_percent, self._cut
        if percent == 0 and before.percent == 0:
            return
        points = self._posed_points(snapshot)
        low, high = points.min(axis=0), points.max(axis=0)
        self._cut = Cut((low + high) / 2, float(np.linalg.norm(high - low)), percent)
        for client in self._server.get_clients().values():
            self._cut.show(client.camera)

    # The frame

    def _load_frame(self, snapshot: Snapshot) -> None:
        scene, observation = self._server.scene, snapshot.problem.observation
        for name in ("/cam", "/world"):
            scene.remove_by_name(name)
        self._gizmo = self._nodes = None
        self._all_nodes = {}
        support = observation.support
        T_world_cam = support.T_world_cam if support else _UP_FROM_CAMERA
        self._T_world_cam = T_world_cam
        cam = scene.add_frame("/cam", show_axes=False)
        place(cam, T_world_cam)
        self._cloud: Cloud = cloud_of(observation)
        z = float(np.median(self._cloud.points_cam[:, 2])) if len(self._cloud.points_cam) else 1.0
        self._points = scene.add_point_cloud(
            "/cam/cloud", self._cloud.points_cam, self._cloud.natural, precision="float32",
            point_size=(1.1 + 0.5 * self._cloud.spacing_px) * z / observation.camera.fx,
            point_shape="square", point_shading="flat",
        )  # fmt: skip
        self._colors = self._cloud.natural
        self._camera = CameraNodes(scene, snapshot)
        self._ground = GroundNodes(scene, snapshot, T_world_cam)
        self._contacts = None
        self._contacts_shown: Contacts | None = None
        self._balance = scene.add_line_segments(
            "/cam/balance", np.zeros((1, 2, 3)), np.zeros((1, 2, 3), np.uint8), thickness=3, thickness_units="screen"
        )
        self._grasp = GraspNodes(scene, T_world_cam)
        self._others = ObjectNodes(self._server, snapshot, T_world_cam, self._send)
        self._problem = snapshot.problem
        aim(self._server, snapshot, T_world_cam)

    # What changes with every snapshot

    def _show_cloud(self, snapshot: Snapshot) -> None:
        maps = snapshot.b.maps if snapshot.b else snapshot.a.maps if snapshot.a else None
        by, tau_m = snapshot.options.cloud, snapshot.session.score.tau_m
        side = snapshot.b or snapshot.a
        if by == "error" and side is not None:
            colors = distance_colors(self._cloud, posed_objects(snapshot, side), tau_m)
        else:
            colors = cloud_colors(self._cloud, by, maps, tau_m)
        if colors is not self._colors:
            self._points.colors = colors
            self._colors = colors

    def _show_contacts(self, snapshot: Snapshot) -> None:
        """The contacts at the pose of the path that is shown; those of its end where none is chosen."""
        path = snapshot.shown.path if snapshot.shown and not snapshot.is_answer else None
        k = snapshot.options.path_pose
        self._draw_contacts(snapshot, len(path.contacts) if path is not None and k is None else k or 0)

    def _draw_contacts(self, snapshot: Snapshot, pose: int) -> None:
        """Arrows onto the object where it touches something, at one pose of the path; none touches at the first."""
        path = snapshot.shown.path if snapshot.shown else None
        contacts = path.contacts[min(pose, len(path.contacts)) - 1] if path and path.contacts and pose else None
        is_shown = contacts is not None and len(contacts.depths_m) > 0 and "contacts" in snapshot.options.layers
        if self._contacts is not None:
            self._contacts.visible = is_shown
        if contacts is None or not is_shown or (contacts is self._contacts_shown and self._contacts is not None):
            return
        self._contacts_shown = contacts
        length = 0.35 * snapshot.target.model.diameter_m
        ends = np.stack([contacts.points_cam - length * contacts.normals_cam, contacts.points_cam], axis=1)
        deep = contacts.depths_m > 0.001
        colors = np.where(deep[:, None], (220, 50, 47), (255, 140, 0)).astype(np.uint8)
        self._contacts = self._server.scene.add_arrows(
            "/cam/contacts", ends, colors, shaft_radius=0.008 * length, head_radius=0.03 * length,
            head_length=0.12 * length,
        )  # fmt: skip

    def _show_polygon(self, snapshot: Snapshot) -> None:
        """The support polygon on the plane, and a line down from the centre of mass."""
        name = drawn_stage(snapshot)
        plausibility = snapshot.plausible[name] if name else None
        self._balance.visible = plausibility is not None and "contacts" in snapshot.options.layers
        if plausibility is None:
            return
        corners = plausibility.polygon_cam
        segments = [(corners[k], corners[(k + 1) % len(corners)]) for k in range(len(corners))]
        segments.append((plausibility.com_cam, plausibility.com_on_plane_cam))
        points = np.array(segments, np.float32)
        colors = np.empty((len(points), 2, 3), np.uint8)
        colors[:] = LIGHTS[plausibility_verdict(plausibility, in_focus(snapshot), snapshot.scene).light]
        self._balance.points = points
        self._balance.colors = colors

    def _show_gizmo(self, snapshot: Snapshot) -> None:
        T = snapshot.options.T_cam_obj_edited
        if T is None or snapshot.options.edited is None:
            if self._gizmo is not None:
                self._gizmo.remove()
                self._gizmo = None
                self._dragged.clear()
            return
        is_news = self._dragged.is_news(snapshot.options.edited)
        if self._gizmo is None:
            self._gizmo = self._make_gizmo(snapshot, T)
        elif is_news:  # Numbers were typed.
            place(self._gizmo, T)

    def _make_gizmo(self, snapshot: Snapshot, T_cam_obj: Float) -> viser.TransformControlsHandle:
        scene, model = self._server.scene, snapshot.target.model
        gizmo = scene.add_transform_controls("/cam/gizmo", scale=0.9 * model.diameter_m, depth_test=False)
        place(gizmo, T_cam_obj)
        add_mesh(scene, "/cam/gizmo/mesh", display_mesh(model), STAGE_COLORS["edited"], 0.7).visible = True

        @gizmo.on_update
        def _(event: viser.TransformControlsEvent) -> None:
            T = transform(rotation_of_quat_wxyz(event.target.wxyz), event.target.position)
            pose = tuple(float(x) for x in T.ravel())
            self._dragged.add(pose)
            self._send(DragPose(pose))

        return gizmo

    def _on_click(self, event: viser.SceneClickEvent) -> None:
        snapshot = self._snapshot
        if snapshot is None:
            return
        T_cam_world = inverse(self._T_world_cam)
        origin = apply(T_cam_world, np.array([event.ray_origin]))[0]
        direction = T_cam_world[:3, :3] @ np.array(event.ray_direction)
        plane = IMAGE_PLANE_M if "camera image" in snapshot.options.layers else None
        pixel = clicked_pixel(snapshot.problem.observation, origin, direction, plane)
        if pixel is not None:
            self._send(ProbePixel(*pixel))
