"""The 3D scene: the frame with its cloud, plane and camera; the object in focus with its poses; the gizmo."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import viser

from verefine_viz.core.arrays import Float
from verefine_viz.core.colormaps import Image
from verefine_viz.core.geometry import apply, inverse, rotation_of_quat_wxyz, transform
from verefine_viz.core.palette import STAGE_COLORS
from verefine_viz.core.problem import Problem
from verefine_viz.core.records import Contacts
from verefine_viz.viewer.cloud import Cloud, clicked_pixel, cloud_colors, cloud_of
from verefine_viz.viewer.commands import Command, DragPose, ProbePixel
from verefine_viz.viewer.maps import map_image
from verefine_viz.viewer.other_nodes import OtherNodes
from verefine_viz.viewer.stage_nodes import StageNodes, display_mesh, place
from verefine_viz.viewer.standing import LIGHTS, telling
from verefine_viz.viewer.verdict import verdict
from verefine_viz.viewer.view import View

IMAGE_PLANE_M = 0.12
"""How far before the sensor its image hangs in the scene [m]."""
_UP_FROM_CAMERA = transform(np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]), np.zeros(3))
"""World from camera where no support is known: up is the image's up."""


class SceneView:
    """Holds the handles of the scene; :meth:`show` is the only way to change it."""

    def __init__(self, server: viser.ViserServer, send: Callable[[Command], None]) -> None:
        self._server, self._send = server, send
        self._problem: Problem | None = None
        self._nodes: StageNodes | None = None
        self._all_nodes: dict[int, StageNodes] = {}
        self._gizmo: viser.TransformControlsHandle | None = None
        self._image_shown: Image | None = None
        self._view: View | None = None
        # An environment map costs software renderers many seconds and shows nothing here.
        server.scene.configure_environment_map(None)
        server.scene.configure_default_lights(True, cast_shadow=False)
        server.scene.world_axes.visible = False
        server.scene.on_click()(self._on_click)

    def show(self, view: View) -> None:
        """Draws a view: new nodes for a new frame or object, otherwise poses, colours and visibility only."""
        if view.problem is not self._problem:
            self._load_frame(view)
        self._choose_nodes(view)
        self._view = view
        assert self._nodes is not None
        self._nodes.show(view)
        self._others.show(view)
        self._show_contacts(view)
        self._show_gizmo(view)
        self.show_deep(view)
        layers = view.look.layers
        self._plane.visible = self._grid.visible = "plane" in layers and view.problem.observation.support is not None
        self._gravity.visible = "gravity" in layers and view.problem.observation.support is not None

    def show_deep(self, view: View) -> None:
        """What needs score maps or plausibility; the rest is left as it is, be it an animation."""
        self._points.visible = "cloud" in view.look.layers
        self._image.visible = self._frustum.visible = "camera image" in view.look.layers
        if view.deep:
            self._show_cloud(view)
            self._show_image(view)
            self._show_polygon(view)
        self._others.show_overlaps(view)

    def show_physics(self, view: View) -> None:
        """What was worked out about the whole scene since."""
        self._show_polygon(view)
        self._others.show_overlaps(view)

    def _choose_nodes(self, view: View) -> None:
        """The nodes of the object in focus: kept once made, since a run may go from object to object all the time."""
        key = view.target.instance.instance_id
        nodes = self._all_nodes.get(key)
        if nodes is not None and nodes.n_arms != view.n_arms:  # Another branch may have other first poses.
            nodes.hide()
            nodes = None
        if nodes is None:
            nodes = StageNodes(self._server, view.target.model, view.n_arms, self._send, key)
            self._all_nodes[key] = nodes
        if self._nodes is not None and self._nodes is not nodes:
            self._nodes.hide()
        self._nodes = nodes

    def animation(self, view: View) -> Iterator[None]:
        """The iteration at the cursor, picture by picture."""
        assert self._nodes is not None
        yield from self._nodes.animation(view)

    def path_animation(self, view: View) -> Iterator[None]:
        """The simulated path with its contacts, pose by pose."""
        assert self._nodes is not None
        for k in self._nodes.path_animation(view):
            self._draw_contacts(view, k)
            yield
            yield

    # The frame

    def _load_frame(self, view: View) -> None:
        scene, observation = self._server.scene, view.problem.observation
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
        self._add_camera(view)
        self._add_ground(view)
        self._contacts = None
        self._contacts_shown: Contacts | None = None
        self._balance = scene.add_line_segments(
            "/cam/balance", np.zeros((1, 2, 3)), np.zeros((1, 2, 3), np.uint8), thickness=3, thickness_units="screen"
        )
        up_cam = T_world_cam[:3, :3].T @ np.array([0.0, 0.0, 1.0])
        self._others = OtherNodes(self._server, view, up_cam, self._send)
        self._problem = view.problem
        self._aim(view)

    def _add_camera(self, view: View) -> None:
        scene, camera = self._server.scene, view.problem.observation.camera
        height = camera.height / camera.fy * IMAGE_PLANE_M
        width = camera.width / camera.fx * IMAGE_PLANE_M
        left, right = -camera.cx / camera.fx, (camera.width - camera.cx) / camera.fx
        top, bottom = -camera.cy / camera.fy, (camera.height - camera.cy) / camera.fy
        corners = np.array([[left, top, 1], [right, top, 1], [right, bottom, 1], [left, bottom, 1]]) * IMAGE_PLANE_M
        edges = [(np.zeros(3), corner) for corner in corners] + [(corners[k], corners[(k + 1) % 4]) for k in range(4)]
        self._frustum = scene.add_line_segments(
            "/cam/frustum", np.array(edges), (140, 140, 140), thickness=1.5, thickness_units="screen"
        )
        photo = view.problem.observation.rgb
        image = photo if photo is not None else np.full((*camera.shape, 3), 90, np.uint8)
        centre = (
            ((camera.width - 1) / 2 - camera.cx) / camera.fx * IMAGE_PLANE_M,
            ((camera.height - 1) / 2 - camera.cy) / camera.fy * IMAGE_PLANE_M,
            IMAGE_PLANE_M,
        )
        self._image = scene.add_image(
            "/cam/image", image, width, height, format="jpeg", jpeg_quality=85, position=centre, cast_shadow=False,
            receive_shadow=False,
        )  # fmt: skip
        self._image_shown = image

    def _add_ground(self, view: View) -> None:
        scene, support = self._server.scene, view.problem.observation.support
        centre = apply(self._T_world_cam, _all_points(view).mean(axis=0)[None])[0]
        up = support.normal_world if support else np.array([0.0, 0, 1])
        across = np.cross(up, [0.0, 1, 0]) if abs(up[1]) < 0.9 else np.cross(up, [1.0, 0, 0])
        across /= np.linalg.norm(across)
        R_world_plane = np.stack([across, np.cross(up, across), up], axis=-1)
        foot = centre - (centre @ up) * up
        T = transform(R_world_plane, foot)
        side = 0.8
        self._grid = scene.add_grid(
            "/world/grid", side, side, cell_size=0.05, section_size=0.2, cell_color=(170, 170, 170),
            section_color=(120, 120, 120), cell_thickness=0.5, section_thickness=1.0, shadow_opacity=0.0,
        )  # fmt: skip
        place(self._grid, T)
        corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * side / 2
        self._plane = scene.add_mesh_simple(
            "/world/plane", corners, np.array([[0, 1, 2], [0, 2, 3]]), color=(120, 150, 190), opacity=0.22,
            side="double", cast_shadow=False, receive_shadow=False,
        )  # fmt: skip
        place(self._plane, T)
        radius = float(np.percentile(np.linalg.norm(_all_points(view) - _all_points(view).mean(axis=0), axis=1), 90))
        away = apply(self._T_world_cam, np.zeros((1, 3)))[0] - centre
        beside = np.cross(away, [0.0, 0.0, 1.0])
        beside *= (1.6 * radius + 0.03) / max(float(np.linalg.norm(beside)), 1e-9)
        tail = foot + np.array([0.0, 0.0, 0.16]) - beside
        # Lines, since they keep their colour in the shade.
        tip = tail - [0, 0, 0.10]
        back = np.array([[0.008, 0, 0.02], [-0.008, 0, 0.02], [0, 0.008, 0.02], [0, -0.008, 0.02]])
        barbs = tip + back
        strokes = np.array([(tail, tip), *((tip, barb) for barb in barbs)])
        self._gravity = scene.add_line_segments(
            "/world/gravity", strokes, (250, 220, 90), thickness=3, thickness_units="screen"
        )

    def _aim(self, view: View) -> None:
        """The first look: from beside the sensor, with the objects in the part that no panel covers."""
        points = _all_points(view)
        middle = points.mean(axis=0)
        extent = 2 * float(np.percentile(np.linalg.norm(points - middle, axis=1), 90))
        several = len(view.problem.instances) > 1
        distance = max(0.42, (2.75 if several else 2.5) * extent)
        towards_sensor = -middle / np.linalg.norm(middle)
        beside = np.array([0.75, -0.35, 0.0])
        direction = towards_sensor + beside
        eye_cam = middle + distance * direction / np.linalg.norm(direction)
        eye, target = apply(self._T_world_cam, np.array([eye_cam, middle]))
        # The free part is the upper half: look below the objects, so that they appear above the middle.
        target = target - np.array([0.0, 0.0, 0.38 * distance])
        if several:  # The list of objects covers the right: look past them on that side.
            right = np.cross(target - eye, [0.0, 0.0, 1.0])
            target = target + 0.06 * distance * right / max(float(np.linalg.norm(right)), 1e-9)
        camera = self._server.initial_camera
        camera.position, camera.look_at, camera.up = eye, target, np.array([0.0, 0.0, 1.0])
        camera.near = 0.005
        for client in self._server.get_clients().values():
            client.camera.up_direction = np.array([0.0, 0.0, 1.0])
            client.camera.position, client.camera.look_at = eye, target

    # What changes with every view

    def _show_cloud(self, view: View) -> None:
        maps = view.b.maps if view.b else view.a.maps if view.a else None
        colors = cloud_colors(self._cloud, view.look.cloud, maps, view.session.score.tau_m)
        if colors is not self._colors:
            self._points.colors = colors
            self._colors = colors

    def _show_image(self, view: View) -> None:
        side = view.b or view.a
        if not self._image.visible or side is None or side.maps is None:
            return
        picture = map_image(view.look.map, side.maps, view.map_target, view.session.score.tau_m)
        image = overlaid(picture, side.maps.classes > 0, view.problem.observation.rgb)
        if view.look.pixel is not None:
            u, v = view.look.pixel
            image[max(v - 4, 0) : v + 5, u] = image[v, max(u - 4, 0) : u + 5] = (255, 255, 255)
        if self._image_shown is None or not np.array_equal(image, self._image_shown):
            self._image.image = image
            self._image_shown = image

    def _show_contacts(self, view: View) -> None:
        path = view.shown.path if view.shown and not view.is_answer else None
        if path is None or not path.contacts or "contacts" not in view.look.layers:
            if self._contacts is not None:
                self._contacts.visible = False
            return
        k = view.look.path_pose
        self._draw_contacts(view, len(path.contacts) if k is None else k)

    def _draw_contacts(self, view: View, pose: int) -> None:
        """Arrows onto the object where it touches something, at one pose of the path."""
        path = view.shown.path if view.shown else None
        contacts = path.contacts[min(pose, len(path.contacts)) - 1] if path and path.contacts and pose else None
        if contacts is None or len(contacts.depths_m) == 0 or "contacts" not in view.look.layers:
            if self._contacts is not None:
                self._contacts.visible = False
            return
        if contacts is self._contacts_shown and self._contacts is not None:
            self._contacts.visible = True
            return
        self._contacts_shown = contacts
        length = 0.35 * view.target.model.diameter_m
        ends = np.stack([contacts.points_cam - length * contacts.normals_cam, contacts.points_cam], axis=1)
        deep = contacts.depths_m > 0.001
        colors = np.where(deep[:, None], (220, 50, 47), (255, 140, 0)).astype(np.uint8)
        self._contacts = self._server.scene.add_arrows(
            "/cam/contacts", ends, colors, shaft_radius=0.008 * length, head_radius=0.03 * length,
            head_length=0.12 * length,
        )  # fmt: skip

    def _show_polygon(self, view: View) -> None:
        """The support polygon on the plane, and a line down from the centre of mass."""
        name = telling(view)
        found = view.plausible[name] if name else None
        self._balance.visible = found is not None and "contacts" in view.look.layers
        if found is None:
            return
        corners = found.polygon_cam
        segments = [(corners[k], corners[(k + 1) % len(corners)]) for k in range(len(corners))]
        segments.append((found.com_cam, found.com_on_plane_cam))
        points = np.array(segments, np.float32)
        colors = np.empty((len(points), 2, 3), np.uint8)
        colors[:] = LIGHTS[verdict(found, view.scene).light]
        self._balance.points = points
        self._balance.colors = colors

    def _show_gizmo(self, view: View) -> None:
        T = view.look.T_cam_obj_edited
        if T is None:
            if self._gizmo is not None:
                self._gizmo.remove()
                self._gizmo = None
            return
        if self._gizmo is None:
            self._gizmo = self._make_gizmo(view, T)

    def _make_gizmo(self, view: View, T_cam_obj: Float) -> viser.TransformControlsHandle:
        scene, model = self._server.scene, view.target.model
        gizmo = scene.add_transform_controls("/cam/gizmo", scale=0.9 * model.diameter_m, depth_test=False)
        place(gizmo, T_cam_obj)
        scene.add_mesh_simple(
            "/cam/gizmo/mesh", *display_mesh(model), color=STAGE_COLORS["edited"], opacity=0.7, flat_shading=True,
            side="double", cast_shadow=False,
        )  # fmt: skip

        @gizmo.on_update
        def _(event: viser.TransformControlsEvent) -> None:
            T = transform(rotation_of_quat_wxyz(event.target.wxyz), event.target.position)
            self._send(DragPose(tuple(float(x) for x in T.ravel())))

        return gizmo

    def _on_click(self, event: viser.SceneClickEvent) -> None:
        view = self._view
        if view is None:
            return
        T_cam_world = inverse(self._T_world_cam)
        origin = apply(T_cam_world, np.array([event.ray_origin]))[0]
        direction = T_cam_world[:3, :3] @ np.array(event.ray_direction)
        plane = IMAGE_PLANE_M if "camera image" in view.look.layers else None
        pixel = clicked_pixel(view.problem.observation, origin, direction, plane)
        if pixel is not None:
            self._send(ProbePixel(*pixel))


def overlaid(picture: Image, relevant: np.ndarray, photo: Image | None) -> Image:
    """A score map where the score says something, over the darkened photo elsewhere."""
    back = np.full_like(picture, 60) if photo is None else (photo * 0.55).astype(np.uint8)
    return np.where(relevant[..., None], picture, back)


def _all_points(view: View) -> Float:
    """All objects' observed points (n, 3), in the camera frame; a point ahead where nothing was measured."""
    clouds = [i.points_cam for i in view.problem.instances if len(i.points_cam)]
    return np.concatenate(clouds) if clouds else np.array([[0.0, 0.0, 1.0]])
