"""Small pictures (320×240) of built-in objects on a table, in which anything can be spoilt on purpose."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float, Mask
from verefine_viz.core.camera import Camera
from verefine_viz.core.causes import Cause
from verefine_viz.core.geometry import apply, axis_angle, inverse, random_unit_vector, transform
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.observation import Observation, Support
from verefine_viz.core.problem import Hypothesis, Instance, Placed, Problem
from verefine_viz.core.settings import SceneSettings, Session
from verefine_viz.evaluation.pose_errors import ErrorOf
from verefine_viz.observation.observed_frame import observe, segment_cloud
from verefine_viz.rendering.rendered_scene import render_scene
from verefine_viz.run.session_file import resolve
from verefine_viz.run.toolbox import Toolbox
from verefine_viz.scenes.demo_layout import Viewpoint
from verefine_viz.scenes.demo_models import demo_model
from verefine_viz.scenes.meshes import Mesh
from verefine_viz.scenes.models import model_of_mesh
from verefine_viz.scenes.sensor import STEREO, Sensor, sense

CAMERA = Camera(np.array([[285.0, 0, 159.5], [0, 285.0, 119.5], [0, 0, 1]]), 320, 240)
SETTINGS = SceneSettings(model_points=1000, cloud_points=700)
TABLE_HALF_M = 0.6
Z = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, eq=False)
class Broken:
    """A scene in which one thing is broken."""

    cause: Cause
    problem: Problem
    toolbox: Toolbox
    instance_id: int = 0
    """Whose diagnosis is meant."""


@dataclass(frozen=True, eq=False)
class Thing:
    """An object on the table."""

    model: ObjectModel
    T_world_obj: Float
    initial_poses: tuple[Float, ...] = ()
    """T_world_obj of its hypotheses."""
    seen_as: ObjectModel | None = None
    """What depth and mask show instead."""
    is_asked_for: bool = True


Depth = NDArray[np.float32]


def frame_of(
    things: Sequence[Thing],
    rng: np.random.Generator,
    view: Viewpoint | None = None,
    spoil_depth: Callable[[Depth, Sequence[Mask]], Depth] = lambda depth, masks: depth,
    spoil_mask: Callable[[int, Sequence[Mask]], Mask] = lambda k, masks: masks[k],
    spoil_support: Callable[[Support], Support] = lambda support: support,
    camera: Camera = CAMERA,
    sensor: Sensor = STEREO,
) -> Problem:
    """A picture of things on a table, spoilt where asked for."""
    T_world_cam = (view or Viewpoint(elevation_deg=40, distance_m=0.52)).T_world_cam
    T_cam_world = inverse(T_world_cam)
    seen = [Placed(k, t.seen_as or t.model, T_cam_world @ t.T_world_obj) for k, t in enumerate(things)]
    drawn = render_scene(seen, camera)
    table_m = _table_depth(T_world_cam, camera)
    is_table = (table_m > 0) & ((drawn.labels < 0) | (table_m < drawn.depth_m))
    true_m = np.where(is_table, table_m, drawn.depth_m).astype(np.float32)
    normals = np.where(is_table[..., None], T_world_cam[2, :3], drawn.normals_cam)
    labels = np.where(is_table, -1, drawn.labels)
    masks = [labels == k for k in range(len(things))]
    depth_m = sense(true_m, normals, camera, int(rng.integers(2**31)), sensor)
    depth_m = spoil_depth(depth_m, masks)
    given = {k: spoil_mask(k, masks) for k, t in enumerate(things) if t.is_asked_for}
    observation = observe(camera, depth_m, None, list(given.values()), SETTINGS, T_world_cam[:3, :3], T_world_cam)
    if observation.support is not None:
        observation = replace(observation, support=spoil_support(observation.support))
    instances = tuple(
        Instance(
            k,
            things[k].model.obj_id,
            mask,
            segment_cloud(depth_m, camera, mask, SETTINGS.cloud_points, SETTINGS.seed),
            tuple(
                Hypothesis(T_cam_world @ T, 1.0 - 0.01 * j, f"made up #{j + 1}")
                for j, T in enumerate(things[k].initial_poses)
            ),
            T_cam_world @ things[k].T_world_obj,
        )
        for k, mask in given.items()
    )
    models = {t.model.obj_id: t.model for t in things}
    return Problem(0, 0, observation, models, instances, "made up")


def _table_depth(T_world_cam: Float, camera: Camera) -> Float:
    rays_world = camera.back_project(np.ones(camera.shape)) @ T_world_cam[:3, :3].T
    down = -rays_world[..., 2]
    z = np.divide(T_world_cam[2, 3], down, out=np.zeros(camera.shape), where=down > 1e-9)
    hit = T_world_cam[:2, 3] + z[..., None] * rays_world[..., :2]
    return np.where((np.abs(hit) <= TABLE_HALF_M).all(axis=-1), z, 0.0)


@cache
def model(name: str, symmetric: bool = True) -> ObjectModel:
    """A built-in object; without the symmetries that it has, where those are not to be known."""
    found = demo_model(name, SETTINGS.model_points, 0)
    return found if symmetric else replace(found, symmetries=np.eye(4)[None])


@cache
def small_carton() -> ObjectModel:
    """The carton at half its size."""
    carton = model("carton")
    return model_of_mesh(Mesh(carton.vertices * 0.5, carton.faces, None), 90, "small carton", 1000, 0, None)


def standing(m: ObjectModel, rng: np.random.Generator, reach_m: float = 0.03, yaw_deg: float | None = None) -> Float:
    """Upright on the table, turned anyhow; T_world_obj."""
    yaw = rng.uniform(0, 2 * np.pi) if yaw_deg is None else np.deg2rad(yaw_deg)
    x, y = rng.uniform(-reach_m, reach_m, 2)
    return transform(axis_angle(Z, yaw), [x, y, -float(m.vertices[:, 2].min())])


def moved(T_world_obj: Float, axis_world: Float, angle_deg: float, shift_mm: Sequence[float] | Float) -> Float:
    """Turned about the object's origin and moved, both in the world."""
    turn = axis_angle(axis_world, np.deg2rad(angle_deg))
    return transform(turn @ T_world_obj[:3, :3], T_world_obj[:3, 3] + np.array(shift_mm) * 1e-3)


def near(T_world_obj: Float, rng: np.random.Generator, n: int, deg: float, mm: float) -> tuple[Float, ...]:
    """Initial poses that are off by a little."""
    return tuple(moved(T_world_obj, random_unit_vector(rng), deg, mm * random_unit_vector(rng)) for _ in range(n))


def on_edge(m: ObjectModel, T_world_obj: Float) -> Float:
    """The same, lifted or lowered until its lowest point is on the table."""
    T = np.array(T_world_obj)
    T[2, 3] -= float(apply(T, m.vertices)[:, 2].min()) - 0.0005
    return T


def level(heading: float) -> Float:
    """A horizontal direction."""
    return np.array([np.cos(heading), np.sin(heading), 0.0])


def session_of(name: str = "rir", iterations: int = 4, **sections: dict[str, object]) -> Session:
    """A session with this method and other sections."""
    method = {"name": name, "refiner": "icp", "iterations": iterations, **sections.pop("method", {})}
    return resolve({"method": method, **sections})


def broken_by(cause: Cause, problem: Problem, session: Session, instance_id: int = 0) -> Broken:
    """The broken scene with the order that its session leads to."""
    toolbox = Toolbox(session)
    return Broken(cause, toolbox.ordered(problem), toolbox, instance_id)


def comes_right(toolbox: Toolbox, problem: Problem, instance_id: int = 0) -> bool:
    """Whether a run gives the instance a pose within 10 % of the diameter."""
    state = toolbox.run(problem).finish()
    for target, best in zip(problem.targets, state.best, strict=True):
        T_true = target.instance.T_cam_obj_gt
        if target.instance.instance_id == instance_id and best is not None and T_true is not None:
            return ErrorOf(target.model, T_true)(best.T_cam_obj) < 0.1
    return False


def leaning(support: Support, axis_world: Float, angle_deg: float, down_m: float = 0.0) -> Support:
    """The plane turned about an axis through its world's origin, which lies below the objects, and lowered."""
    wrong = transform(axis_angle(axis_world, np.deg2rad(angle_deg)), [0, 0, down_m])
    return replace(support, T_world_cam=wrong @ support.T_world_cam)


def seen_through(mask: Mask, instance: Instance, observation: Observation, n_points: int) -> Instance:
    """The instance with another mask (H, W), and the cloud of at most ``n_points`` that it leads to."""
    cloud = segment_cloud(observation.depth_m, observation.camera, mask, n_points, 0)
    return replace(instance, mask=mask, points_cam=cloud)
