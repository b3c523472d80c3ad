"""The 3D scene: shows what a window looks at, and passes on what is dragged and clicked in it."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Mapping, Set
from typing import TYPE_CHECKING

import numpy as np
import viser

from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import apply, inverse, rotation_of_quat_wxyz, transform
from verefine_viz.core.palette import RGB, STAGE_COLORS, Image
from verefine_viz.core.problem import Problem
from verefine_viz.core.scores import ScoreMaps
from verefine_viz.page.branch import Branch
from verefine_viz.page.moment import Moment, Phase, SceneObject, moment_of
from verefine_viz.page.protocol import Look
from verefine_viz.page.scene3d.camera_moves import (
    cut_away,
    set_first_look,
    take_to_first_look,
    take_to_points,
    take_to_sensor,
)
from verefine_viz.page.scene3d.drawn_models import add_solid, display_mesh, place
from verefine_viz.page.scene3d.frame_drawing import IMAGE_PLANE_M, FrameDrawing, world_from_camera
from verefine_viz.page.scene3d.grasp_drawing import GraspDrawing
from verefine_viz.page.scene3d.object_drawing import BodyLook, ObjectDrawing
from verefine_viz.page.scene3d.observed_cloud import (
    class_colors,
    clicked_pixel,
    distance_colors,
    measured_points,
    surface_scale,
)
from verefine_viz.page.scene3d.physics_drawing import PhysicsDrawing, known_overlaps
from verefine_viz.page.scene3d.scene_panel import CameraPlace, ScenePanel
from verefine_viz.page.scene3d.viser_server import prepared

if TYPE_CHECKING:
    from verefine_viz.grasping.grasp_answer import GraspAttempt, GraspPair
    from verefine_viz.page.workspace import Workspace

OPACITY: dict[Phase, float] = {
    "waiting": 0.16,
    "working": 0.8,
    "placed": 0.8,
    "rolled out": 0.3,
    "done": 0.8,
    "no pose": 0.0,
}
_FOCUS_OPACITY = 0.9
_EDITED_OPACITY = 0.75
_OVERLAP_OPACITY = 0.45
_GIZMO_LINE_PX = 5.0
"""What can be grasped is about five times as wide."""


class Scene3D:
    """Holds the nodes of the scene; :meth:`show` changes them in place.

    Args:
        server: the scene's own server.
        send: called from threads of the server with ``("edited", obj, T)`` while the gizmo is dragged, with
            ``("picked", u, v)`` when a pixel was clicked, and with ``("redraw",)`` when :meth:`show` should be called
            again, since the panel asks for what only the computing thread may work out.
    """

    def __init__(self, server: viser.ViserServer, send: Callable[..., None]) -> None:
        self._server, self._send = server, send
        self._lock = threading.RLock()
        self._look: Look | None = None
        self._moment: Moment | None = None
        self._beside: Moment | None = None
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
        self.panel = ScenePanel(server, self._on_panel, self._on_camera_button)

        @server.on_client_connect
        def _(client: viser.ClientHandle) -> None:
            client.camera.on_update(lambda camera: self._cut(camera) if self.panel.cut else None)

    def show(self, space: Workspace, look: Look, grasp: GraspPair | None = None) -> None:
        """Draw what a window looks at. Call it from the thread that computes, also after physics was worked out.

        Args:
            space: what is open.
            look: of the window.
            grasp: of the object in focus, where it was carried out.

        Raises:
            InputError: it looks at what is not there (any more).
        """
        moment = moment_of(space.branch(look.branch), look)
        focus = moment.target.instance.instance_id
        beside = _beside(space.branch(look.b.branch), look, focus) if look.b is not None else None
        maps = None
        if self.panel.cloud == "class" and (T := self._main_pose(moment, look)[1]) is not None:
            of_pose = moment.evaluator.maps(moment.target, T)
            maps = None if of_pose is None else (T.tobytes(), of_pose)
        with self._lock:
            is_new = look is not self._look
            self._look, self._moment, self._beside, self._maps = look, moment, beside, maps
            self._attempt = None
            if look.grasp is not None and grasp is not None:
                self._attempt = grasp.answer if look.grasp.by == "pose" else grasp.ground_truth
            with self._server.atomic():
                self._draw()
            if look.camera is not None and is_new:
                for client in self._server.get_clients().values():
                    self._take_camera(client, look.camera)

    def page(self) -> str:
        """Return the scene as it is as one HTML document that needs nothing else."""
        return prepared(self._server.scene.as_html(dark_mode=True))

    # Drawing, with the lock held

    def _draw(self) -> None:
        moment, look, layers = self._moment, self._look, self.panel.layers
        if moment is None or look is None:
            return
        if not _same_frame(moment.problem, self._problem):
            self._load_frame(moment.problem)
        moved = self._draw_grasp(moment)
        overlaps = known_overlaps(moment) if "overlaps" in layers and not moved else []
        self._draw_objects(moment, look, layers, moved, {i for one in overlaps for i in (one.first, one.second)})
        self._draw_cloud(moment, look, layers, moved)
        self._frame.show("photo" in layers, "plane" in layers, "gravity" in layers and not moved)
        self._physics.show(moment, look, layers if not moved else frozenset(), overlaps)
        self._draw_gizmo(moment, look)
        for client in self._server.get_clients().values():
            self._cut(client.camera)

    def _load_frame(self, problem: Problem) -> None:
        """Replace all nodes by those of another frame."""
        scene, T_world_cam = self._server.scene, world_from_camera(problem.observation)
        is_elsewhere = self._problem is None or self._problem.observation.depth_m is not problem.observation.depth_m
        for name in ("/cam", "/world"):
            scene.remove_by_name(name)
        self._problem, self._T_world_cam, self._gizmo = problem, T_world_cam, None
        self._frame = FrameDrawing(scene, problem)
        self._objects: dict[int, ObjectDrawing] = {}
        self._physics = PhysicsDrawing(scene)
        self._grasp: GraspDrawing | None = None
        if is_elsewhere:
            set_first_look(self._server, measured_points(problem), T_world_cam)

    def _drawing_of(self, one: SceneObject) -> ObjectDrawing:
        if one.instance_id not in self._objects:
            up_cam = self._T_world_cam[:3, :3].T @ np.array([0.0, 0.0, 1.0])
            self._objects[one.instance_id] = ObjectDrawing(self._server.scene, one.target, one.label, up_cam)
        return self._objects[one.instance_id]

    def _draw_objects(
        self, moment: Moment, look: Look, layers: frozenset[str], moved: Mapping[int, Float], overlapping: Set[int]
    ) -> None:
        """Draw all objects where they stand; those that overlap can be looked into."""
        focus = moment.target.instance.instance_id
        name, T_main = self._main_pose(moment, look)
        beside = {o.instance_id: o.T_cam_obj for o in self._beside.objects} if self._beside is not None else {}
        for one in moment.objects:
            drawing, in_focus = self._drawing_of(one), one.instance_id == focus
            T_body = moved.get(one.instance_id, T_main if in_focus else one.T_cam_obj)
            if not in_focus and ("other objects" not in layers or self.panel.box is not None):
                T_body = None
            outlines = self._outlines(moment, name, layers) if in_focus else {}
            if (T_beside := beside.get(one.instance_id)) is not None:
                outlines["B"] = T_beside
            color = STAGE_COLORS[name] if in_focus else one.color
            # While a pose is edited its body is the gizmo's.
            T_drawn = None if in_focus and look.edited is not None and not moved else T_body
            # In a grasp all objects are where they really stand.
            body = self._body_look(one, in_focus or one.instance_id in moved, color, layers)
            drawing.show_body(T_drawn, (color, _OVERLAP_OPACITY) if one.instance_id in overlapping else body)
            drawing.show_name(T_body if len(moment.objects) > 1 else None)
            drawing.show_outlines(outlines if not moved else {})
            has_ghosts = in_focus and "hypotheses" in layers and not moved
            arms = moment.own.arms if has_ghosts and moment.own is not None else ()
            drawing.show_hypotheses(arms, moment.arm)

    def _main_pose(self, moment: Moment, look: Look) -> tuple[str, Float | None]:
        """Return the pose of the object in focus that its body is drawn at, and the name of its stage."""
        path = moment.iteration.path if moment.iteration is not None else None
        if path is not None and look.moment is not None and not moment.is_answer:
            return "simulated", path.Ts_cam_obj[min(look.moment, len(path.Ts_cam_obj) - 1)]
        stages = [
            name for name in moment.poses if name not in ("initial", "best", "runner-up", "edited", "ground truth")
        ]
        order = ["edited", *(["best"] if moment.is_answer else reversed(stages)), "best", "initial"]
        name = next((name for name in order if name in moment.poses), "initial")
        return name, moment.poses.get(name)

    def _outlines(self, moment: Moment, main: str, layers: frozenset[str]) -> dict[str, Float]:
        """Return the other poses of the object in focus, without those that are the main one."""
        T_main = moment.poses.get(main)
        out: dict[str, Float] = {}
        for name, T in moment.poses.items():
            layer = name if name in layers or name in ("initial", "best", "runner-up", "ground truth") else "stages"
            is_main = name == main or (T_main is not None and name != "ground truth" and np.array_equal(T, T_main))
            if layer in layers and name != "edited" and not is_main:
                out[name] = T
        return out

    def _body_look(self, one: SceneObject, in_focus: bool, color: RGB, layers: frozenset[str]) -> BodyLook:
        has_colors = one.target.model.has_colors and "own colours" in layers
        if has_colors and (in_focus or one.phase in ("placed", "done", "working")):
            return "own colours"
        return color, _FOCUS_OPACITY if in_focus else OPACITY[one.phase]

    def _draw_grasp(self, moment: Moment) -> dict[int, Float]:
        """Draw the grasp that is shown, and return where it has moved the objects."""
        look = self._look
        if self._attempt is None or look is None or look.grasp is None:
            if self._grasp is not None:
                self._grasp.show(None, 0, 0.0)
            return {}
        if self._grasp is None:
            self._grasp = GraspDrawing(self._server.scene, self._T_world_cam)
        return self._grasp.show(self._attempt, look.grasp.moment, moment.branch.settings.grasp.opening_m)

    def _draw_cloud(self, moment: Moment, look: Look, layers: frozenset[str], moved: Mapping[int, Float]) -> None:
        tau_m = moment.branch.settings.score.tau_m
        self.panel.show_scale(surface_scale(tau_m) if self.panel.cloud == "distance to model" else None)
        ball, box = self._ball(moment, look), self.panel.box
        is_there = "cloud" in layers and (not moved or self._grasp is None or self._grasp.is_choosing)
        within = (ball[0], box * ball[1]) if box is not None else None
        self._frame.show_cloud(self._cloud_colors(moment, look, tau_m) if is_there else None, within)

    def _cloud_colors(self, moment: Moment, look: Look, tau_m: float) -> Image:
        cloud, by = self._frame.cloud, self.panel.cloud
        T_main = self._main_pose(moment, look)[1]
        if by == "distance to model":
            focus = moment.target.instance.instance_id
            posed = [(o.target, o.T_cam_obj) for o in moment.objects if o.instance_id != focus]
            posed = [(target, T) for target, T in [*posed, (moment.target, T_main)] if T is not None]
            return distance_colors(cloud, posed, tau_m)
        if by == "normals":
            return self._frame.normals
        if by == "class" and self._maps is not None and T_main is not None and self._maps[0] == T_main.tobytes():
            return class_colors(cloud, self._maps[1])
        return cloud.natural

    # The gizmo

    def _draw_gizmo(self, moment: Moment, look: Look) -> None:
        T_cam_obj = moment.poses["edited"] if look.edited is not None else None
        focus = moment.target.instance.instance_id
        if self._gizmo is not None and (T_cam_obj is None or self._gizmo[0] != focus):
            self._gizmo[1].remove()
            self._gizmo = self._placed_by = None
            self._sent.clear()
        if T_cam_obj is None:
            return
        T_obj_gizmo = transform(np.eye(3), moment.target.model.middle_m)
        if self._gizmo is None:
            self._gizmo = (focus, self._add_gizmo(moment, T_cam_obj @ T_obj_gizmo))
        elif look.edited != self._placed_by and look.edited not in self._sent:
            place(self._gizmo[1], T_cam_obj @ T_obj_gizmo)
        while look.edited in self._sent:  # With what it sent before, which the window has passed over.
            self._sent.popleft()
        self._placed_by = look.edited
        self._gizmo[1].scale = self.panel.gizmo_px

    def _add_gizmo(self, moment: Moment, T_cam_gizmo: Float) -> viser.TransformControlsHandle:
        """Add handles around the middle of the object, as large on the screen wherever the camera is."""
        scene, model, obj = self._server.scene, moment.target.model, moment.target.instance.instance_id
        gizmo = scene.add_transform_controls(
            "/cam/gizmo", scale=self.panel.gizmo_px, fixed=True, line_width=_GIZMO_LINE_PX, depth_test=False
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

    def _on_panel(self) -> None:
        with self._lock, self._server.atomic():
            self._draw()
        if self.panel.cloud == "class":
            self._send("redraw")

    def _on_camera_button(self, client: viser.ClientHandle, to: CameraPlace) -> None:
        with self._lock:
            self._take_camera(client, to)

    def _on_click(self, event: viser.SceneClickEvent) -> None:
        problem = self._problem
        if problem is None:
            return
        T_cam_world = inverse(self._T_world_cam)
        origin = apply(T_cam_world, np.array([event.ray_origin]))[0]
        direction = T_cam_world[:3, :3] @ np.array(event.ray_direction)
        plane_m = IMAGE_PLANE_M if "photo" in self.panel.layers else None
        pixel = clicked_pixel(problem.observation, origin, direction, plane_m)
        if pixel is not None:
            self._send("picked", *pixel)

    # The camera

    def _take_camera(self, client: viser.ClientHandle, to: CameraPlace) -> None:
        moment, look = self._moment, self._look
        if moment is None or look is None or self._problem is None:
            return
        if to == "first":
            take_to_first_look(self._server, client)
        elif to == "sensor":
            self.panel.hide("photo")  # It would hide everything else from there.
            take_to_sensor(client, self._problem.observation, self._T_world_cam)
        else:
            hiding = [
                apply(self._T_world_cam @ one.T_cam_obj, one.model.points)
                for one in moment.others_of(moment.target.instance.instance_id)
            ]
            take_to_points(client, apply(self._T_world_cam, self._points_cam(moment, look)), hiding)

    def _points_cam(self, moment: Moment, look: Look) -> Float:
        """Return points (n, 3) of the object in focus where it is drawn, or what was measured where it is nowhere."""
        T = self._main_pose(moment, look)[1]
        return measured_points(moment.problem) if T is None else apply(T, moment.target.model.points)

    def _ball(self, moment: Moment, look: Look) -> tuple[Float, float]:
        """Return centre (3,) and radius of a ball around the object in focus, in the camera frame [m]."""
        points = self._points_cam(moment, look)
        low, high = points.min(axis=0), points.max(axis=0)
        return (low + high) / 2, float(np.linalg.norm(high - low)) / 2

    def _cut(self, camera: viser.CameraHandle) -> None:
        """Cut the object in focus open in one browser; the plane goes with its camera."""
        moment, look = self._moment, self._look
        if moment is not None and look is not None:
            centre_cam, radius_m = self._ball(moment, look)
            cut_away(camera, (apply(self._T_world_cam, centre_cam[None])[0], radius_m), self.panel.cut)


def _beside(branch: Branch, look: Look, focus: int) -> Moment:
    """Return the moment of the run that stands beside the one looked at."""
    assert look.b is not None
    return moment_of(branch, Look(branch=look.b.branch, k=look.b.k, obj=focus, answer=look.answer))


def _same_frame(one: Problem, other: Problem | None) -> bool:
    """Return whether two problems are drawn by the same nodes: one observation and the same models."""
    if other is None or one.observation is not other.observation:
        return False
    theirs = {i.instance_id: other.models[i.obj_id] for i in other.instances}
    return {i.instance_id: one.models[i.obj_id] for i in one.instances} == theirs
