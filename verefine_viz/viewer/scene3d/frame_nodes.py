"""The frame in 3D: the observed cloud, the camera with its image, the support plane and gravity."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import viser
from numpy.typing import NDArray
from scipy.spatial import KDTree

from verefine_viz.core.arrays import Float
from verefine_viz.core.camera import Camera
from verefine_viz.core.geometry import apply, transform
from verefine_viz.core.observation import TILT_SHOWN_DEG, Observation, Support
from verefine_viz.core.palette import Image, class_image, difference_scale, distance_scale
from verefine_viz.core.problem import Problem, Target
from verefine_viz.core.scores import ScoreMaps
from verefine_viz.pictures.surroundings_meshes import SOLID_COLOR, SURFACE_COLOR, drawn_surroundings
from verefine_viz.viewer.commands import CloudColors
from verefine_viz.viewer.drawing.ruler import ruler_of
from verefine_viz.viewer.drawing.score_maps import map_over
from verefine_viz.viewer.scene3d.pose_nodes import add_mesh, add_wireframe, edges, place
from verefine_viz.viewer.snapshot.snapshot import Snapshot

IMAGE_PLANE_M = 0.12
"""How far before the sensor its image hangs in the scene [m]."""


class CameraNodes:
    """Made once per frame; afterwards the picture and visibility change."""

    def __init__(self, scene: viser.SceneApi, snapshot: Snapshot) -> None:
        camera = snapshot.problem.observation.camera
        height = camera.height / camera.fy * IMAGE_PLANE_M
        width = camera.width / camera.fx * IMAGE_PLANE_M
        left, right = -camera.cx / camera.fx, (camera.width - camera.cx) / camera.fx
        top, bottom = -camera.cy / camera.fy, (camera.height - camera.cy) / camera.fy
        corners = np.array([[left, top, 1], [right, top, 1], [right, bottom, 1], [left, bottom, 1]]) * IMAGE_PLANE_M
        edges = [(np.zeros(3), corner) for corner in corners] + [(corners[k], corners[(k + 1) % 4]) for k in range(4)]
        self._frustum = scene.add_line_segments(
            "/cam/frustum", np.array(edges), (140, 140, 140), thickness=1.5, thickness_units="screen"
        )
        photo = snapshot.problem.observation.rgb
        self._darkened = np.full((*camera.shape, 3), 60, np.uint8) if photo is None else (photo * 0.55).astype(np.uint8)
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
        self._shown = image
        self._ray = scene.add_line_segments(
            "/cam/ray", np.zeros((1, 2, 3), np.float32), (255, 255, 255), thickness=1.5, thickness_units="screen",
            visible=False,
        )  # fmt: skip
        self._ruler = scene.add_line_segments(
            "/cam/ruler", np.zeros((1, 2, 3), np.float32), (255, 255, 255), thickness=2.5, thickness_units="screen",
            visible=False,
        )  # fmt: skip
        self._length = scene.add_label("/cam/ruler/length", "", visible=False)

    def show(self, snapshot: Snapshot) -> None:
        """Shows or hides it, the ray of the probed pixel as far as the sensor saw, and the ruler to it."""
        self._show_ray(snapshot)
        self._show_ruler(snapshot)
        self._image.visible = self._frustum.visible = "camera image" in snapshot.options.layers

    def _show_ray(self, snapshot: Snapshot) -> None:
        pixel, observation = snapshot.options.pixel, snapshot.problem.observation
        depth_m = float(observation.depth_m[pixel[1], pixel[0]]) if pixel is not None else 0.0
        self._ray.visible = depth_m > 0
        if pixel is not None and depth_m > 0:
            camera = observation.camera
            end = depth_m * np.array([(pixel[0] - camera.cx) / camera.fx, (pixel[1] - camera.cy) / camera.fy, 1.0])
            self._ray.points = np.array([[np.zeros(3), end]], np.float32)

    def _show_ruler(self, snapshot: Snapshot) -> None:
        ruler = ruler_of(snapshot.problem.observation, snapshot.options)
        points_cam = ruler.points_cam if ruler is not None else None
        self._ruler.visible = self._length.visible = points_cam is not None
        if ruler is not None and points_cam is not None:
            self._ruler.points = points_cam[None].astype(np.float32)
            self._length.text, self._length.position = ruler.label, points_cam.mean(axis=0)

    def show_map(self, snapshot: Snapshot) -> None:
        """Lays the score map that is chosen over the image."""
        side = snapshot.b or snapshot.a
        if not self._image.visible or side is None or side.maps is None:
            return
        image = map_over(
            self._darkened, snapshot.options.map, side.maps, snapshot.map_target, snapshot.session.score.tau_m
        )
        if snapshot.options.pixel is not None:
            u, v = snapshot.options.pixel
            image[max(v - 4, 0) : v + 5, u] = image[v, max(u - 4, 0) : u + 5] = (255, 255, 255)
        if not np.array_equal(image, self._shown):
            self._image.image = image
            self._shown = image


# The observed cloud: which pixels become points, in which colours, and which pixel a click means.

MAX_POINTS = 45_000
MAX_DEPTH_M = 4.0
_REACH_M = 5.0
_RAY_STEP_M = 0.002


@dataclass(frozen=True, eq=False)
class Cloud:
    """The pixels that are drawn."""

    rows: NDArray[np.intp]
    columns: NDArray[np.intp]
    points_cam: NDArray[np.float32]
    """(N, 3) [m]."""
    natural: Image
    """(N, 3) RGB: the photo, or without one shades of grey by how steeply the camera looks."""
    spacing_px: int
    """Distance of neighbours in the background [px]."""


def cloud_of(observation: Observation) -> Cloud:
    """All object pixels, and as many of the others as stay below ``MAX_POINTS``, on a regular grid."""
    depth = observation.depth_m
    valid = (depth > 0) & (depth < MAX_DEPTH_M)
    n_object = int((valid & observation.object_mask).sum())
    n_other = int((valid & ~observation.object_mask).sum())
    step = max(1, int(np.ceil(np.sqrt(n_other / max(MAX_POINTS - n_object, 10_000)))))
    grid = np.zeros_like(valid)
    grid[::step, ::step] = True
    inner = max(1, int(np.ceil(np.sqrt(n_object / MAX_POINTS))))
    object_grid = np.zeros_like(valid)
    object_grid[::inner, ::inner] = True
    rows, columns = np.nonzero(valid & np.where(observation.object_mask, object_grid, grid))
    points = observation.camera.back_project(depth)[rows, columns].astype(np.float32)
    if observation.rgb is not None:
        natural = observation.rgb[rows, columns]
    else:
        # As if lit from the camera: shapes can be distinguished, wherever they are.
        shade = 40 + 150 * np.abs(observation.normals_cam[rows, columns, 2])
        natural = np.repeat(shade[:, None], 3, axis=1).astype(np.uint8)
    return Cloud(rows, columns, points, natural, step)


def cloud_colors(cloud: Cloud, by: CloudColors, maps: ScoreMaps | None, tau_m: float) -> Image:
    """(N, 3) RGB. Where the score says nothing about a pixel, its natural colour, faded."""
    if by == "colour" or maps is None:
        return cloud.natural
    rows, columns = cloud.rows, cloud.columns
    faded = (cloud.natural.astype(np.float32) * 0.35 + 75).astype(np.uint8)
    if by == "class":
        classes = maps.classes[rows, columns]
        return np.where((classes > 0)[:, None], class_image(classes), faded)
    difference = maps.depth_difference_m[rows, columns] * 1000
    known = np.isfinite(difference) & (maps.rendered_m[rows, columns] > 0)
    return np.where(known[:, None], difference_scale(tau_m).colors(difference), faded)


def distance_colors(cloud: Cloud, posed: Sequence[tuple[Target, Float]], tau_m: float) -> Image:
    """(N, 3) RGB by the distance of each point to the nearest point of the posed models, faded beyond 2τ.

    Args:
        cloud: the observed points.
        posed: objects and their T_cam_obj (4, 4).
        tau_m: depth tolerance of the score [m].
    """
    faded = (cloud.natural.astype(np.float32) * 0.35 + 75).astype(np.uint8)
    models = [apply(T, np.concatenate([target.model.points, target.model.vertices])) for target, T in posed]
    if not models:
        return faded
    distances_m, _ = KDTree(np.concatenate(models)).query(cloud.points_cam, distance_upper_bound=2 * tau_m)
    near = np.isfinite(distances_m)
    return np.where(near[:, None], distance_scale(tau_m).colors(np.where(near, 1000 * distances_m, np.nan)), faded)


def clicked_pixel(
    observation: Observation, origin_cam: Float, direction_cam: Float, image_plane_m: float | None
) -> tuple[int, int] | None:
    """The pixel (u, v) that a ray of the view means.

    The ray meets the camera image before the sensor, at depth ``image_plane_m`` (None = not shown), or the observed
    surface; whichever comes first. None if it meets neither.
    """
    camera = observation.camera
    direction = direction_cam / np.linalg.norm(direction_cam)
    hits: list[tuple[float, tuple[int, int]]] = []
    if image_plane_m is not None and abs(direction[2]) > 1e-9:
        distance = float((image_plane_m - origin_cam[2]) / direction[2])
        pixel = _pixel(camera, origin_cam + distance * direction)
        if distance > 0 and pixel is not None:
            hits.append((distance, pixel))
    along = np.arange(0.0, _REACH_M, _RAY_STEP_M)
    points = origin_cam + along[:, None] * direction
    ahead = points[:, 2] > 0.01
    along, points = along[ahead], points[ahead]
    if len(points):
        uv = np.round(camera.project(points)).astype(np.int64)
        inside = (uv >= 0).all(axis=1) & (uv[:, 0] < camera.width) & (uv[:, 1] < camera.height)
        along, points, uv = along[inside], points[inside], uv[inside]
        depth = observation.depth_m[uv[:, 1], uv[:, 0]]
        # The ray is through the surface where it comes from before it to just behind it.
        behind = (depth > 0) & (points[:, 2] >= depth) & (points[:, 2] < depth + 0.03)
        if behind.any():
            first = int(np.argmax(behind))
            hits.append((float(along[first]), (int(uv[first, 0]), int(uv[first, 1]))))
    return min(hits)[1] if hits else None


def _pixel(camera: Camera, point_cam: Float) -> tuple[int, int] | None:
    u, v = np.round(camera.project(point_cam)).astype(int)
    return (int(u), int(v)) if 0 <= u < camera.width and 0 <= v < camera.height else None


def measured_points(problem: Problem) -> Float:
    """All objects' observed points (n, 3), in the camera frame; a point ahead where nothing was measured."""
    clouds = [i.points_cam for i in problem.instances if len(i.points_cam)]
    return np.concatenate(clouds) if clouds else np.array([[0.0, 0.0, 1.0]])


# What the objects stand on, in 3D: the plane with its grid, and the direction of gravity.


class GroundNodes:
    """Made once per frame; afterwards visibility changes."""

    def __init__(self, scene: viser.SceneApi, snapshot: Snapshot, T_world_cam: Float) -> None:
        support, points = snapshot.problem.observation.support, measured_points(snapshot.problem)
        centre = apply(T_world_cam, points.mean(axis=0)[None])[0]
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
            plane_color=(120, 150, 190), plane_opacity=0.22,
        )  # fmt: skip
        place(self._grid, T)
        self._surroundings = _surroundings_nodes(scene, support, centre, side / 2)
        radius = float(np.percentile(np.linalg.norm(points - points.mean(axis=0), axis=1), 90))
        away = apply(T_world_cam, np.zeros((1, 3)))[0] - centre
        beside = np.cross(away, [0.0, 0.0, 1.0])
        beside *= (1.6 * radius + 0.03) / max(float(np.linalg.norm(beside)), 1e-9)
        tail = foot + np.array([0.0, 0.0, 0.16]) - beside
        # Lines, since they keep their colour in the shade.
        tip = tail - [0, 0, 0.10]
        back = np.array([[0.008, 0, 0.02], [-0.008, 0, 0.02], [0, 0.008, 0.02], [0, -0.008, 0.02]])
        barbs = tip + back
        strokes = np.array([(tail, tip), *((tip, barb) for barb in barbs)])
        self._gravity = [
            scene.add_line_segments("/world/gravity", strokes, (250, 220, 90), thickness=3, thickness_units="screen")
        ]
        if support is not None and support.tilt_deg > TILT_SHOWN_DEG:
            normal = np.array([(tail, tail - 0.10 * up)])
            self._gravity.append(
                scene.add_line_segments("/world/normal", normal, SURFACE_COLOR, thickness=3, thickness_units="screen")
            )

    def show(self, snapshot: Snapshot) -> None:
        """Shows or hides it; where no support is known there is nothing to show."""
        layers, is_known = snapshot.options.layers, snapshot.problem.observation.support is not None
        self._grid.visible = "plane" in layers and is_known and not self._surroundings
        for node in self._surroundings:
            node.visible = "plane" in layers
        for node in self._gravity:
            node.visible = "gravity" in layers and is_known


def _surroundings_nodes(
    scene: viser.SceneApi, support: Support | None, centre_world: Float, reach_m: float
) -> list[viser.SceneNodeHandle]:
    """What supports and stops the objects instead of a plane; unknown objects as a solid with its edges and number."""
    if support is None or support.surroundings is None:
        return []
    drawn = drawn_surroundings(support.surroundings, centre_world, reach_m)
    nodes: list[viser.SceneNodeHandle] = []
    for name, mesh, color, opacity in (
        ("surfaces", drawn.surfaces, SURFACE_COLOR, 0.3),
        ("solids", drawn.solids, SOLID_COLOR, 0.45),
    ):
        if len(mesh[1]):
            nodes.append(add_mesh(scene, f"/world/{name}", mesh, color, opacity))
            nodes.append(add_wireframe(scene, f"/world/{name}/edges", edges(*mesh), color, 1.2))
    for one, color in drawn.unknown:
        mesh, name = (one.model.vertices, one.model.faces), f"/world/unknown/{one.number}"
        if not one.is_dropped:
            nodes.append(add_mesh(scene, name, mesh, color, 0.55))
        nodes.append(add_wireframe(scene, f"{name}/edges", edges(*mesh), color, 1.6))
        top = one.model.vertices[one.model.vertices[:, 2].argmax()]
        nodes.append(scene.add_label(f"{name}/number", f"unknown {one.number}", position=top, visible=False))
    return nodes
