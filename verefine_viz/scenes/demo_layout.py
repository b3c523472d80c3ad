"""What a built-in scene is made of, how its objects come to rest on the table, and pictures of them.

The world has z up and the table's top at z = 0.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cache

import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float, Mask
from verefine_viz.core.camera import Camera
from verefine_viz.core.geometry import apply, axis_angle, inverse, transform
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.observation import Support
from verefine_viz.core.problem import Placed
from verefine_viz.core.progress_token import NEVER_CANCELLED, ProgressToken
from verefine_viz.core.settings import PhysicsSettings
from verefine_viz.physics.simulator import BulletSimulator, settle_to_rest
from verefine_viz.rendering.rendered_scene import render_scene
from verefine_viz.scenes.demo_models import demo_model
from verefine_viz.scenes.half_turn import half_turn

CAMERA = Camera(np.array([[570.0, 0, 319.5], [0, 570.0, 239.5], [0, 0, 1]]), 640, 480)

TABLE_HALF_M = (0.75, 0.60)
"""Half of the table's length and width [m]."""

WOOD = np.array([(150, 116, 84), (166, 131, 97)], dtype=np.float64)
"""Dark and light grain."""

LIGHT_DIRECTION = np.array([-0.45, -0.30, 1.0]) / np.linalg.norm([-0.45, -0.30, 1.0])
"""From the table to the lamp, for the shadows in the colour image."""


@dataclass(frozen=True)
class Viewpoint:
    """Where the camera stands; it looks at a point above the table's origin."""

    azimuth_deg: float = -90.0
    """Direction from the table's middle to the camera, seen from above [deg]."""
    elevation_deg: float = 40.0
    """How steeply it looks down [deg]."""
    distance_m: float = 0.62
    """To the point that it looks at [m]."""
    look_at_m: tuple[float, float, float] = (0.0, 0.0, 0.045)

    @property
    def T_world_cam(self) -> Float:
        """(4, 4) [m]; the camera's x axis is horizontal."""
        azimuth, elevation = np.deg2rad([self.azimuth_deg, self.elevation_deg])
        back = np.array([np.cos(azimuth) * np.cos(elevation), np.sin(azimuth) * np.cos(elevation), np.sin(elevation)])
        x = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
        z = -back
        R = np.stack([x, np.cross(z, x), z], axis=1)
        return transform(R, np.array(self.look_at_m) + self.distance_m * back)


@dataclass(frozen=True, eq=False)
class Picture:
    """What a perfect RGB-D camera sees."""

    depth_m: NDArray[np.float32]
    """(H, W) z [m]; 0 beside the table."""
    normals_cam: NDArray[np.float32]
    """(H, W, 3) towards the camera."""
    labels: NDArray[np.int32]
    """(H, W) index into the placed objects; -1 elsewhere."""
    rgb: NDArray[np.uint8]


def take_picture(placed: Sequence[Placed], T_world_cam: Float, camera: Camera = CAMERA) -> Picture:
    """Objects and table; ``placed`` are given in the camera frame."""
    objects = render_scene(placed, camera)
    table_m = _table_depth(T_world_cam, camera)
    is_table = (table_m > 0) & ((objects.labels < 0) | (table_m < objects.depth_m))
    depth = np.where(is_table, table_m, objects.depth_m).astype(np.float32)
    normal_cam = T_world_cam[2, :3].astype(np.float32)
    normals = np.where(is_table[..., None], normal_cam, objects.normals_cam).astype(np.float32)
    labels = np.where(is_table, np.int32(-1), objects.labels)

    points_world = apply(T_world_cam, camera.back_project(depth).reshape(-1, 3)).reshape(*camera.shape, 3)
    rgb = objects.rgb.astype(np.float64)
    rgb[is_table] = _wood(points_world[is_table, :2])
    rgb[depth == 0] = (44, 46, 50)
    seen = depth > 0
    lit = _lit(points_world[seen], normals[seen] @ T_world_cam[:3, :3].T, placed, T_world_cam)
    rgb[seen] *= (0.55 + 0.45 * lit)[:, None]
    return Picture(depth, normals, labels, np.rint(rgb).astype(np.uint8))


def _table_depth(T_world_cam: Float, camera: Camera) -> NDArray[np.float64]:
    """Z (H, W) [m] of the table's top; 0 where the ray misses it."""
    rays_world = camera.back_project(np.ones(camera.shape)) @ T_world_cam[:3, :3].T
    down = -rays_world[..., 2]
    z = np.divide(T_world_cam[2, 3], down, out=np.zeros(camera.shape), where=down > 1e-9)
    hit = T_world_cam[:2, 3] + z[..., None] * rays_world[..., :2]
    return np.where((np.abs(hit) <= TABLE_HALF_M).all(axis=-1), z, 0.0)


def _wood(xy_m: Float) -> Float:
    """Colour (N, 3) of points (N, 2) of the table: boards 120 mm wide, with a grain along x."""
    x, y = xy_m.T
    board = np.floor(y / 0.12)
    grain = 0.5 + 0.5 * np.sin(340 * y + 2.5 * np.sin(9 * x + 2.1 * board) + 1.7 * board)
    shade = 0.96 + 0.04 * np.sin(12.9898 * board)
    joint = np.where(np.abs(y / 0.12 - board) < 0.012, 0.72, 1.0)
    return (WOOD[0] + grain[:, None] * (WOOD[1] - WOOD[0])) * (shade * joint)[:, None]


def _lit(points_world: Float, normals_world: Float, placed: Sequence[Placed], T_world_cam: Float) -> Float:
    """How much (N,) of the lamp's light reaches points, in [0, 1]: a shadow map with soft borders."""
    if not placed:
        return np.ones(len(points_world))
    lamp = Camera(np.array([[1400.0, 0, 255.5], [0, 1400.0, 255.5], [0, 0, 1]]), 512, 512)
    x = np.cross([0.0, 1.0, 0.0], -LIGHT_DIRECTION)
    x /= np.linalg.norm(x)
    R_world_lamp = np.stack([x, np.cross(-LIGHT_DIRECTION, x), -LIGHT_DIRECTION], axis=1)
    T_lamp_world = inverse(transform(R_world_lamp, 2.0 * LIGHT_DIRECTION))
    T_lamp_cam = T_lamp_world @ T_world_cam
    nearest = render_scene([Placed(p.instance_id, p.model, T_lamp_cam @ p.T_cam_obj) for p in placed], lamp).depth_m
    points_lamp = apply(T_lamp_world, points_world + 0.003 * normals_world)
    u, v = np.rint(lamp.project(points_lamp)).astype(int).T
    free = np.zeros(len(points_world))
    offsets = [(a, b) for a in (-3, 0, 3) for b in (-3, 0, 3)]
    for du, dv in offsets:
        inside = (u + du >= 0) & (u + du < lamp.width) & (v + dv >= 0) & (v + dv < lamp.height)
        front = np.zeros(len(points_world))
        front[inside] = nearest[v[inside] + dv, u[inside] + du]
        free += (front == 0) | (points_lamp[:, 2] < front + 0.002)
    facing = np.clip(4.0 * (normals_world @ LIGHT_DIRECTION), 0.0, 1.0)
    return free / len(offsets) * facing


@dataclass(frozen=True)
class Item:
    """An object, as it is dropped onto the table."""

    model: str
    """Name in :mod:`demo_models`."""
    x_m: float = 0.0
    y_m: float = 0.0
    yaw_deg: float = 0.0
    """About the vertical, after the tilt."""
    tilt_deg: tuple[float, float] = (0.0, 0.0)
    """About its own x, then y axis: which side is down."""
    drop_m: float = 0.004
    """Height of its lowest point above the table when it is dropped; to land on another object, drop it above that."""
    is_asked_for: bool = True
    """False: it lies there, has no mask, and its pose is not estimated."""
    seen_as: str = ""
    """The model that depth and mask show instead, such as a jug without its glass handle; empty = the model itself."""


OwnPoses = Callable[[Float, Float, np.random.Generator], tuple[Float, ...]]
"""(true T_world_obj, T_world_cam, generator) → initial poses T_world_obj, best first."""


@dataclass(frozen=True)
class DemoScene:
    """A built-in scene; its frames are its viewpoints."""

    title: str
    items: tuple[Item, ...]
    """In the order in which they are dropped, one after the other."""
    views: tuple[Viewpoint, ...] = (Viewpoint(),)
    blind: Callable[[NDArray[np.int32], Float], Mask] | None = None
    """(labels (H, W), points_world (H, W, 3)) → pixels (H, W) that are not measured, on top of the sensor's own."""
    leaks: dict[int, int] = field(default_factory=dict)
    """By index of the item, of which other its mask holds the visible pixels as well."""
    initial_poses: OwnPoses | None = None
    """How the hypotheses of this scene come about; None = perturbed ground truth as the settings have it."""


TURNED_DROP_M = 0.004
"""How far above its place a turned object is dropped [m]."""

LAYOUT_FRAME = Support(np.eye(4), np.array([0.0, 0.0, 1.0]), "given", 1.0)
"""Objects are laid out without any camera: the world takes its place."""


def prepare(items: Sequence[Item], progress: ProgressToken = NEVER_CANCELLED) -> None:
    """Builds the colliders that :func:`settled` needs, which are cached on disk: most of its time in the first call.

    Raises:
        Cancelled: ``progress`` was cancelled.
    """
    simulator = BulletSimulator(PhysicsSettings(), progress=progress)
    for item in items:
        progress.checkpoint()
        simulator.collider(_body(item))


@cache
def settled(items: tuple[Item, ...], are_turned: bool = False) -> tuple[Float, ...]:
    """Where items come to rest: T_world_obj (4, 4) each.

    Args:
        items: in the order in which they are dropped.
        are_turned: each is then turned by half (``half_turn.py``), and dropped again where it lay.
    """
    starts: list[Float] = []
    models = [_body(item) for item in items]
    for item, model in zip(items, models, strict=True):
        tilt = axis_angle([0, 1, 0], np.deg2rad(item.tilt_deg[1])) @ axis_angle([1, 0, 0], np.deg2rad(item.tilt_deg[0]))
        R = axis_angle([0, 0, 1], np.deg2rad(item.yaw_deg)) @ tilt
        lowest_m = float((model.vertices @ R[2]).min())
        starts.append(transform(R, [item.x_m, item.y_m, item.drop_m - lowest_m]))
    poses = rest_poses(models, starts)
    return turned(models, poses) if are_turned else poses


def rest_poses(models: Sequence[ObjectModel], starts: Sequence[Float]) -> tuple[Float, ...]:
    """Where objects come to rest that are dropped one after the other, T_world_obj (4, 4) each, from ``starts``."""
    simulator = BulletSimulator(PhysicsSettings())
    resting: list[Placed] = []
    for k, (model, start) in enumerate(zip(models, starts, strict=True)):
        path = settle_to_rest(simulator, Placed(k, model, start), resting, LAYOUT_FRAME)
        resting.append(Placed(k, model, path.T_cam_obj))
    return tuple(p.T_cam_obj for p in resting)


def turned(models: Sequence[ObjectModel], poses: Sequence[Float]) -> tuple[Float, ...]:
    """Objects at rest (4, 4), each turned by half and dropped again where it lay."""
    lifted = transform(np.eye(3), [0.0, 0.0, TURNED_DROP_M])
    starts = [lifted @ T @ half_turn(model, T[2, :3]) for model, T in zip(models, poses, strict=True)]
    return rest_poses(models, starts)


def _body(item: Item) -> ObjectModel:
    """What falls; its points play no part in it, but for which way it is turned."""
    return demo_model(item.model, 500, 0)
