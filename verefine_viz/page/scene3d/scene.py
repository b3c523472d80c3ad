"""The 3D scene: shows what a window looks at, and passes on what is dragged and clicked in it."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Mapping, Set
from typing import TYPE_CHECKING, get_args

import numpy as np
import viser

from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import apply, inverse, rotation_of_quat_wxyz, transform
from verefine_viz.core.palette import RGB, STAGE_COLORS, Image, stage_color
from verefine_viz.core.problem import Problem, Target
from verefine_viz.core.scores import ScoreMaps
from verefine_viz.page.frame_objects import color_of, labels_of
from verefine_viz.page.protocol import WHOLE_SCENE, CameraPlace, Layer3D, Look, SceneLook
from verefine_viz.page.scene3d.camera_moves import (
    cut_away,
    set_first_look,
    take_to_points,
    take_to_sensor,
)
from verefine_viz.page.scene3d.drawn_models import add_solid, display_mesh, place
from verefine_viz.page.scene3d.frame_drawing import IMAGE_PLANE_M, FrameDrawing, world_from_camera
from verefine_viz.page.scene3d.grasp_drawing import GraspDrawing
from verefine_viz.page.scene3d.mark_drawing import MarkDrawing
from verefine_viz.page.scene3d.object_drawing import BodyLook, ObjectDrawing
from verefine_viz.page.scene3d.observed_cloud import (
    class_colors,
    clicked_pixel,
    distance_colors,
    measured_points,
)
from verefine_viz.page.scene3d.physics_drawing import PhysicsDrawing, contacts_of, known_overlaps
from verefine_viz.page.scene3d.view_content import Body, ViewContent, content_of
from verefine_viz.page.scene3d.viser_page import exported

if TYPE_CHECKING:
    from verefine_viz.grasping.grasp_answer import GraspAttempt, GraspPair
    from verefine_viz.page.workspace import Workspace

_FOCUS_OPACITY = 0.9
_OPAQUE = 0.8
"""From this opacity on an object has its own colours, where these are shown."""
_EDITED_OPACITY = 0.75
_LOOKED_INTO_OPACITY = 0.45
FRAME_NODE = "/frame"
"""The node whose child is named by the frame that is seen."""
_GIZMO_LINE_PX = 5.0
"""What can be grasped is about five times as wide."""


class Scene3D:
    """Holds the nodes of the scene; :meth:`show` changes them in place.

    Args:
        server: the scene's own server.
        send: called from threads of the server with ``("edited", obj, T)`` while the gizmo is dragged, and with
            ``("picked", u, v)`` when a pixel was clicked.
    """

    def __init__(self, server: viser.ViserServer, send: Callable[..., None]) -> None:
        self._server, self._send = server, send
        self._lock = threading.RLock()
        self._look: Look | None = None
        self._content: ViewContent | None = None
        self._attempt: GraspAttempt | None = None
        self._maps: tuple[bytes, ScoreMaps] | None = None
        self._problem: Problem | None = None
        self._gizmo: tuple[int, viser.TransformControlsHandle] | None = None
        self._sent: deque[tuple[float, ...]] = deque(maxlen=200)
        """Edited poses that the gizmo sent, and that have not come back yet."""
        self._placed_by: tuple[float, ...] | None = None
        # An environment map costs software renderers many seconds and shows nothing here.
        server.scene.configure_environment_map(None)
        server.scene.configure_default_lights(True, cast_shadow=False)
        server.scene.add_light_hemisphere("/fill", intensity=1.2)  # What faces away from the light is not black.
        server.scene.world_axes.visible = False
        server.scene.on_click()(self._on_click)
        self._frame_id: int | None = None
        """The frame that browsers see, by the number that the page knows it by."""
        server.gui.configure_theme(dark_mode=True, show_logo=False, show_share_button=False)

        @server.on_client_connect
        def _(client: viser.ClientHandle) -> None:
            client.camera.on_update(lambda camera: self._cut(camera) if self._looks.cut else None)

    @property
    def _layers(self) -> frozenset[Layer3D]:
        """What of the frame is shown beside poses."""
        return frozenset(get_args(Layer3D)) - set(self._looks.hidden)

    @property
    def _looks(self) -> SceneLook:
        return SceneLook() if self._look is None else self._look.scene

    def show(self, space: Workspace, look: Look, grasp: GraspPair | None = None) -> None:
        """Draw what a window looks at. Call it from the thread that computes, also after physics was worked out.

        Args:
            space: what is open.
            look: of the window.
            grasp: of the object in focus, where it was carried out.

        Raises:
            InputError: it looks at what is not there (any more).
        """
        content = content_of(space.branch(look.branch), look)
        maps = None
        if content.target is not None and content.main is not None and look.scene.cloud == "class":
            T_cam_obj = content.main.T_cam_obj
            of_pose = content.evaluator.maps(content.target, T_cam_obj)
            maps = None if of_pose is None else (T_cam_obj.tobytes(), of_pose)
        with self._lock:
            is_new = look is not self._look
            self._look, self._content, self._maps = look, content, maps
            self._attempt = None
            if look.grasp is not None and grasp is not None:
                self._attempt = grasp.answer if look.grasp.by == "pose" else grasp.ground_truth
            with self._server.atomic():
                self._draw()
                self._mark_frame(space.frame_id)
            if look.camera is not None and is_new:
                for client in self._server.get_clients().values():
                    self._take_camera(client, look.camera)

    def page(self) -> str:
        """Return the scene as it is as one HTML document that needs nothing else."""
        return exported(self._server.scene.as_html(dark_mode=True))

    # Drawing, with the lock held

    def _draw(self) -> None:
        content, look, layers = self._content, self._look, self._layers
        if content is None or look is None:
            return
        if not _same_frame(content.problem, self._problem):
            self._load_frame(content)
        moved = self._draw_grasp(content)
        overlaps = known_overlaps(content) if "overlaps" in layers and not moved else []
        looked_into = {i for one in overlaps for i in (one.first, one.second)}
        if content.focus is not None and "contacts" in layers and contacts_of(content) is not None and not moved:
            looked_into.add(content.focus)
        for target in content.problem.targets:
            self._draw_object(content, target.instance.instance_id, moved, looked_into)
        self._draw_cloud(content, layers, moved)
        text_px = look.scene.text_px
        self._frame.show("photo" in layers, "plane" in layers, "gravity" in layers and not moved, text_px)
        self._marks.show(look.pixel, look.ruler, text_px)
        self._physics.show(content, layers if not moved else frozenset(), overlaps)
        self._draw_gizmo(content, look)
        for client in self._server.get_clients().values():
            self._cut(client.camera)

    def _mark_frame(self, frame_id: int) -> None:
        """Give the scene a node named by the frame that it shows: the page looks for it, and knows what is seen."""
        if frame_id != self._frame_id and self._content is not None:
            self._server.scene.remove_by_name(FRAME_NODE)
            self._server.scene.add_frame(f"{FRAME_NODE}/{frame_id}", show_axes=False)
            self._frame_id = frame_id

    def _load_frame(self, content: ViewContent) -> None:
        """Replace all nodes by those of another frame."""
        problem = content.problem
        scene, T_world_cam = self._server.scene, world_from_camera(problem.observation)
        is_elsewhere = self._problem is None or self._problem.observation.depth_m is not problem.observation.depth_m
        for name in ("/cam", "/world"):
            scene.remove_by_name(name)
        self._problem, self._T_world_cam, self._gizmo = problem, T_world_cam, None
        self._frame = FrameDrawing(scene, problem)
        self._colors = {instance.instance_id: color_of(i) for i, instance in enumerate(problem.instances)}
        self._objects: dict[int, ObjectDrawing] = {}
        self._physics = PhysicsDrawing(scene)
        self._marks = MarkDrawing(scene, problem.observation)
        self._grasp: GraspDrawing | None = None
        if is_elsewhere:
            self._take_first_look(content)

    def _drawing_of(self, problem: Problem, instance_id: int) -> ObjectDrawing:
        if instance_id not in self._objects:
            up_cam = self._T_world_cam[:3, :3].T @ np.array([0.0, 0.0, 1.0])
            target, label = problem.target(instance_id), labels_of(problem)[instance_id]
            self._objects[instance_id] = ObjectDrawing(self._server.scene, target, label, up_cam)
        return self._objects[instance_id]

    def _draw_object(
        self, content: ViewContent, instance_id: int, moved: Mapping[int, Float], looked_into: Set[int]
    ) -> None:
        """Draw an object where it stands; one that overlaps another, or shows its contacts, can be looked into."""
        layers, body, in_focus = self._layers, content.bodies.get(instance_id), instance_id == content.focus
        T_body = moved.get(instance_id, None if body is None else body.T_cam_obj)
        if not in_focus and ("other objects" not in layers or self._looks.box < WHOLE_SCENE):
            T_body = None
        # While a pose is edited its body is the gizmo's.
        T_drawn = None if in_focus and content.edited is not None and not moved else T_body
        drawing = self._drawing_of(content.problem, instance_id)
        if body is not None:
            drawing.show_body(T_drawn, self._body_look(content, instance_id, body, moved, looked_into))
        else:
            drawing.show_body(None, "own colours")
        drawing.show_name(T_body if len(content.bodies) > 1 else None, self._looks.text_px)
        drawing.show_outlines({} if moved else content.outlines.get(instance_id, {}))
        is_still = in_focus and not moved
        n_ghosts = len(content.Ts_hypothesis) if is_still else 0
        drawing.show_hypotheses(content.Ts_hypothesis[:n_ghosts], content.ranks[:n_ghosts], content.arm)
        drawing.show_allowed(content.Ts_allowed if is_still else content.Ts_allowed[:0])
        drawing.show_axes(content.Ts_axes if is_still else content.Ts_axes[:0])

    def _body_look(
        self, content: ViewContent, instance_id: int, body: Body, moved: Mapping[int, Float], looked_into: Set[int]
    ) -> BodyLook:
        """Return how a body is drawn; in a grasp all objects are where they really stand."""
        color = self._colors[instance_id] if body.role == "body" else _color_of(body.role)
        opacity = _FOCUS_OPACITY if instance_id in moved else body.opacity
        if instance_id in looked_into:
            return color, _LOOKED_INTO_OPACITY
        has_colors = content.problem.target(instance_id).model.has_colors and "own colours" in self._layers
        return "own colours" if has_colors and opacity >= _OPAQUE else (color, opacity)

    def _draw_grasp(self, content: ViewContent) -> dict[int, Float]:
        """Draw the grasp that is shown, and return where it has moved the objects."""
        look = self._look
        if self._attempt is None or look is None or look.grasp is None:
            if self._grasp is not None:
                self._grasp.show(None, 0, 0.0)
            return {}
        if self._grasp is None:
            self._grasp = GraspDrawing(self._server.scene, self._T_world_cam)
        return self._grasp.show(self._attempt, look.grasp.moment, content.branch.settings.grasp.opening_m)

    def _draw_cloud(self, content: ViewContent, layers: frozenset[str], moved: Mapping[int, Float]) -> None:
        ball, box = self._ball(content), self._looks.box
        is_there = "cloud" in layers and (not moved or self._grasp is None or self._grasp.is_choosing)
        within = (ball[0], box * ball[1]) if box < WHOLE_SCENE else None
        self._frame.show_cloud(self._cloud_colors(content) if is_there else None, within)

    def _cloud_colors(self, content: ViewContent) -> Image:
        cloud, by, main = self._frame.cloud, self._looks.cloud, content.main
        if by == "distance to model":
            posed = [(content.problem.target(obj), body.T_cam_obj) for obj, body in content.bodies.items()]
            return distance_colors(cloud, posed, content.branch.settings.score.tau_m)
        if by == "normals":
            return self._frame.normals
        maps = self._maps
        if by == "class" and maps is not None and main is not None and maps[0] == main.T_cam_obj.tobytes():
            return class_colors(cloud, maps[1])
        return cloud.natural

    # The gizmo

    def _draw_gizmo(self, content: ViewContent, look: Look) -> None:
        T_cam_obj, focus, target = content.edited, content.focus, content.target
        if self._gizmo is not None and (T_cam_obj is None or self._gizmo[0] != focus):
            self._gizmo[1].remove()
            self._gizmo = self._placed_by = None
            self._sent.clear()
        if T_cam_obj is None or focus is None or target is None:
            return
        edited = next(one.T for one in look.draw if one.role == "gizmo")
        T_obj_gizmo = transform(np.eye(3), target.model.middle_m)
        if self._gizmo is None:
            self._gizmo = (focus, self._add_gizmo(target, T_cam_obj @ T_obj_gizmo))
        elif edited != self._placed_by and edited not in self._sent:
            place(self._gizmo[1], T_cam_obj @ T_obj_gizmo)
        while edited in self._sent:  # With what it sent before, which the window has passed over.
            self._sent.popleft()
        self._placed_by = edited
        self._gizmo[1].scale = self._looks.gizmo_px

    def _add_gizmo(self, target: Target, T_cam_gizmo: Float) -> viser.TransformControlsHandle:
        """Add handles around the middle of the object, as large on the screen wherever the camera is."""
        scene, model, obj = self._server.scene, target.model, target.instance.instance_id
        gizmo = scene.add_transform_controls(
            "/cam/gizmo", scale=self._looks.gizmo_px, fixed=True, line_width=_GIZMO_LINE_PX, depth_test=False
        )
        place(gizmo, T_cam_gizmo)
        vertices, faces = display_mesh(model)
        body = add_solid(
            scene, "/cam/gizmo/body", (vertices - model.middle_m, faces), STAGE_COLORS["edited"], _EDITED_OPACITY
        )
        body.visible = True
        T_gizmo_obj = transform(np.eye(3), -model.middle_m)

        @gizmo.on_update
        def _(event: viser.TransformControlsEvent) -> None:
            if event.phase != "update":  # The end has the pose of the last update.
                return
            T = transform(rotation_of_quat_wxyz(event.target.wxyz), event.target.position) @ T_gizmo_obj
            pose = tuple(float(x) for x in T.ravel())
            with self._lock:
                self._sent.append(pose)
            self._send("edited", obj, pose)

        return gizmo

    # What the user does in the view

    def _on_click(self, event: viser.SceneClickEvent) -> None:
        problem = self._problem
        if problem is None:
            return
        T_cam_world = inverse(self._T_world_cam)
        origin = apply(T_cam_world, np.array([event.ray_origin]))[0]
        direction = T_cam_world[:3, :3] @ np.array(event.ray_direction)
        plane_m = IMAGE_PLANE_M if "photo" in self._layers else None
        pixel = clicked_pixel(problem.observation, origin, direction, plane_m)
        if pixel is not None:
            self._send("picked", *pixel)

    # The camera

    def _take_camera(self, client: viser.ClientHandle, to: CameraPlace) -> None:
        content = self._content
        if content is None or self._problem is None:
            return
        if to == "first":
            self._take_first_look(content)
        elif to == "sensor":
            take_to_sensor(client, self._problem.observation, self._T_world_cam)
        else:
            take_to_points(client, apply(self._T_world_cam, self._points_cam(content)), self._hiding(content))

    def _take_first_look(self, content: ViewContent) -> None:
        points, hiding = apply(self._T_world_cam, self._points_cam(content)), self._hiding(content)
        set_first_look(self._server, points, hiding, self._T_world_cam[:3, 3])

    def _hiding(self, content: ViewContent) -> list[Float]:
        """Return points (n, 3) of each other object, in the world."""
        return [apply(self._T_world_cam @ one.T_cam_obj, one.model.points) for one in content.others]

    def _points_cam(self, content: ViewContent) -> Float:
        """Return points (n, 3) of the object in focus where it is drawn, or what was measured where it is nowhere."""
        if content.main is None or content.target is None:
            return measured_points(content.problem)
        return apply(content.main.T_cam_obj, content.target.model.points)

    def _ball(self, content: ViewContent) -> tuple[Float, float]:
        """Return centre (3,) and radius of a ball around the object in focus, in the camera frame [m]."""
        points = self._points_cam(content)
        low, high = points.min(axis=0), points.max(axis=0)
        return (low + high) / 2, float(np.linalg.norm(high - low)) / 2

    def _cut(self, camera: viser.CameraHandle) -> None:
        """Cut the object in focus open in one browser; the plane goes with its camera."""
        if self._content is not None:
            centre_cam, radius_m = self._ball(self._content)
            cut_away(camera, (apply(self._T_world_cam, centre_cam[None])[0], radius_m), self._looks.cut)


def _color_of(role: str) -> RGB:
    """Return the colour of a body in focus."""
    return stage_color("edited" if role == "gizmo" else role)


def _same_frame(one: Problem, other: Problem | None) -> bool:
    """Return whether two problems are drawn by the same nodes: one observation and the same models."""
    if other is None or one.observation is not other.observation:
        return False
    theirs = {i.instance_id: other.models[i.obj_id] for i in other.instances}
    return {i.instance_id: one.models[i.obj_id] for i in one.instances} == theirs
