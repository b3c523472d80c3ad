"""The frame in 3D: the observed cloud, the sensor with its photo, the support plane, surroundings and gravity."""

from __future__ import annotations

import numpy as np
import viser

from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import apply, transform
from verefine_viz.core.observation import TILT_SHOWN_DEG, Observation, Support
from verefine_viz.core.palette import SCENE_COLORS, Image
from verefine_viz.core.problem import Problem
from verefine_viz.page.scene3d.drawn_models import LABEL_PX, add_outline, add_solid, edges, place
from verefine_viz.page.scene3d.observed_cloud import Cloud, cloud_of, measured_points, normal_colors
from verefine_viz.pictures.support_patch import support_patch
from verefine_viz.pictures.surroundings_meshes import SOLID_COLOR, SURFACE_COLOR, drawn_surroundings

IMAGE_PLANE_M = 0.12
"""How far before the sensor its photo hangs in the scene [m]."""
_AROUND_M = 0.4
"""Distance from the objects up to which unbounded surfaces are drawn [m]."""
_ARROW_M = 0.07
_PLANE_OPACITY = 0.18
_UP_FROM_CAMERA = transform(np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]), np.zeros(3))
"""World from camera where no support is known: up is the image's up."""


def world_from_camera(observation: Observation) -> Float:
    """Return T_world_cam of the frame."""
    return observation.support.T_world_cam if observation.support is not None else _UP_FROM_CAMERA


class FrameDrawing:
    """The parts that stay while a frame is open; made once, then shown, hidden and coloured."""

    def __init__(self, scene: viser.SceneApi, problem: Problem) -> None:
        observation = problem.observation
        self._T_world_cam = world_from_camera(observation)
        place(scene.add_frame("/cam", show_axes=False), self._T_world_cam)
        self.cloud: Cloud = cloud_of(observation)
        depth_m = float(np.median(self.cloud.points_cam[:, 2])) if len(self.cloud.points_cam) else 1.0
        self.normals: Image = normal_colors(self.cloud)
        has_points = len(self.cloud.points_cam) > 0  # None where depth in a wrong unit lies too far away.
        self._points = scene.add_point_cloud(
            "/cam/cloud", self.cloud.points_cam, self.cloud.natural if has_points else (0, 0, 0), precision="float32",
            point_size=(1.1 + 0.5 * self.cloud.spacing_px) * depth_m / observation.camera.fx,
            point_shape="square", point_shading="flat",
        )  # fmt: skip
        self._looks: tuple[Image, bytes] = (self.cloud.natural, b"")
        self._sensor = _add_sensor(scene, observation)
        points = measured_points(problem)
        self._ground = _add_ground(scene, observation, points, self._T_world_cam)
        self._gravity = _add_gravity(scene, observation.support, points, self._T_world_cam)

    def show(self, photo: bool, plane: bool, gravity: bool, text_px: float) -> None:
        """Show or hide all but the cloud."""
        for nodes, visible in ((self._sensor, photo), (self._ground, plane), (self._gravity, gravity)):
            for node in nodes:
                node.visible = visible
                if isinstance(node, viser.LabelHandle):
                    node.font_screen_scale = text_px / LABEL_PX

    def show_cloud(self, colors: Image | None, box_cam: tuple[Float, float] | None) -> None:
        """Show the cloud, or only its points in a box: (centre (3,), half its side [m]); without colours, hide it."""
        self._points.visible = colors is not None
        key = b"" if box_cam is None else np.append(*box_cam).tobytes()
        if colors is None or (colors is self._looks[0] and key == self._looks[1]):
            return
        inside = np.ones(len(self.cloud.points_cam), np.bool_)
        if box_cam is not None:
            inside = (np.abs(self.cloud.points_cam - box_cam[0]) < box_cam[1]).all(axis=1)
        if not inside.any():
            self._points.visible = False
            return
        if key != self._looks[1]:
            self._points.points = self.cloud.points_cam[inside]
        self._points.colors = colors[inside]
        self._looks = (colors, key)


def _add_sensor(scene: viser.SceneApi, observation: Observation) -> list[viser.SceneNodeHandle]:
    """Add the camera's frustum with the photo in it."""
    camera = observation.camera
    width, height = camera.width / camera.fx * IMAGE_PLANE_M, camera.height / camera.fy * IMAGE_PLANE_M
    u, v = np.array([0, camera.width, camera.width, 0]), np.array([0, 0, camera.height, camera.height])
    corners = IMAGE_PLANE_M * np.stack([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, np.ones(4)], axis=1)
    rays = np.stack([np.zeros((4, 3)), corners], axis=1)
    sides = np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)
    lines = np.concatenate([rays, sides]).astype(np.float32)
    frustum = add_outline(scene, "/cam/frustum", lines, (140, 140, 140), 1.5)
    photo = observation.rgb if observation.rgb is not None else np.full((*camera.shape, 3), 90, np.uint8)
    centre = IMAGE_PLANE_M * np.array(
        [((camera.width - 1) / 2 - camera.cx) / camera.fx, ((camera.height - 1) / 2 - camera.cy) / camera.fy, 1.0]
    )
    image = scene.add_image(
        "/cam/photo", photo, width, height, format="jpeg", jpeg_quality=85, position=centre, cast_shadow=False,
        receive_shadow=False,
    )  # fmt: skip
    return [frustum, image]


def _add_ground(
    scene: viser.SceneApi, observation: Observation, points_cam: Float, T_world_cam: Float
) -> list[viser.SceneNodeHandle]:
    """Add what the objects stand on: the visible part of the support plane, and any surroundings."""
    support, patch = observation.support, support_patch(observation)
    if support is None or patch is None:
        return []
    nodes: list[viser.SceneNodeHandle] = []
    if n := len(corners := patch.outline_cam):
        sides = np.stack([corners, np.roll(corners, -1, axis=0)], axis=1).astype(np.float32)
        nodes.append(add_outline(scene, "/cam/plane_outline", sides, SCENE_COLORS["plane"], 2.5))
    if support.surroundings is not None:
        return [*nodes, *_add_surroundings(scene, support, apply(T_world_cam, points_cam.mean(axis=0)[None])[0])]
    if n:
        fan = np.array([(0, k, k + 1) for k in range(1, n - 1)], np.int32)
        nodes.append(add_solid(scene, "/cam/plane", (corners, fan), SCENE_COLORS["plane"], _PLANE_OPACITY))
    return nodes


def _add_surroundings(scene: viser.SceneApi, support: Support, centre_world: Float) -> list[viser.SceneNodeHandle]:
    """Add surfaces and solids with their edges; unknown objects with their numbers."""
    assert support.surroundings is not None
    drawn = drawn_surroundings(support.surroundings, centre_world, _AROUND_M)
    nodes: list[viser.SceneNodeHandle] = []
    for name, mesh, color, opacity in (
        ("surfaces", drawn.surfaces, SURFACE_COLOR, 0.3),
        ("solids", drawn.solids, SOLID_COLOR, 0.45),
    ):
        if len(mesh[1]):
            nodes.append(add_solid(scene, f"/world/{name}", mesh, color, opacity))
            nodes.append(add_outline(scene, f"/world/{name}_edges", edges(*mesh), color, 1.2))
    for one, color in drawn.unknown:
        mesh, name = (one.model.vertices, one.model.faces), f"/world/unknown/{one.number}"
        if not one.is_dropped:
            nodes.append(add_solid(scene, name, mesh, color, 0.55))
        nodes.append(add_outline(scene, f"{name}_edges", edges(*mesh), color, 1.6))
        top = one.model.vertices[one.model.vertices[:, 2].argmax()]
        nodes.append(scene.add_label(f"{name}_number", f"unknown {one.number}", position=top, visible=False))
    return nodes


def _add_gravity(
    scene: viser.SceneApi, support: Support | None, points_cam: Float, T_world_cam: Float
) -> list[viser.SceneNodeHandle]:
    """Add an arrow down beside the objects, and the plane's normal where gravity differs from it."""
    if support is None:
        return []
    centre, sensor = apply(T_world_cam, np.stack([points_cam.mean(axis=0), np.zeros(3)]))
    radius_m = float(np.percentile(np.linalg.norm(points_cam - points_cam.mean(axis=0), axis=1), 90))
    length_m = min(radius_m, _ARROW_M)
    beside = np.cross(sensor - centre, [0.0, 0.0, 1.0])
    beside *= (1.3 * radius_m + 0.01) / max(float(np.linalg.norm(beside)), 1e-9)
    foot = centre - (centre @ support.normal_world) * support.normal_world + beside
    # Lines, since they keep their colour in the shade.
    up = np.array([0.0, 0.0, length_m])
    tip, tail = foot + 0.3 * up, foot + 1.3 * up
    barbs = tip + 0.1 * length_m * np.array([[1, 0, 2.5], [-1, 0, 2.5], [0, 1, 2.5], [0, -1, 2.5]])
    strokes = np.array([(tail, tip), *((tip, barb) for barb in barbs)], np.float32)
    nodes: list[viser.SceneNodeHandle] = [
        add_outline(scene, "/world/gravity", strokes, SCENE_COLORS["gravity"], 3),
        scene.add_label("/world/gravity_name", "gravity", position=tail, anchor="bottom-center", visible=False),
    ]
    if support.tilt_deg > TILT_SHOWN_DEG:
        normal = np.array([(tail, tail - length_m * support.normal_world)], np.float32)
        nodes.append(add_outline(scene, "/world/normal", normal, SURFACE_COLOR, 3))
    return nodes
