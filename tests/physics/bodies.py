"""Small models and a tilted camera above a table, shared by the tests of physics."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import trimesh

from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import axis_angle, inverse, transform
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.observation import Support
from verefine_viz.core.problem import Placed

T_CAM_WORLD = transform(axis_angle([1, 0, 0], np.deg2rad(120)), [0.02, -0.01, 0.8])
T_WORLD_CAM = inverse(T_CAM_WORLD)
FLAT = np.eye(3)


def model(mesh: trimesh.Trimesh, obj_id: int = 1, name: str = "thing") -> ObjectModel:
    vertices = np.asarray(mesh.vertices)
    diameter_m = float(np.linalg.norm(np.ptp(vertices, axis=0)))
    normals = np.tile([0.0, 0.0, 1.0], (1, 1))
    return ObjectModel(
        obj_id, name, vertices, np.asarray(mesh.faces), vertices[:1], normals, diameter_m, np.eye(4)[None]
    )


def box(x_m: float, y_m: float, z_m: float) -> ObjectModel:
    return model(trimesh.creation.box([x_m, y_m, z_m]), name="box")


def ball(radius_m: float = 0.02) -> ObjectModel:
    return model(trimesh.creation.icosphere(3, radius_m), name="ball")


def ring(height_m: float = 0.05) -> ObjectModel:
    return model(trimesh.creation.annulus(0.04, 0.06, height_m, sections=24), name="ring")


def angle() -> ObjectModel:
    """An L of 10 × 10 cm, the hollow thing that is taken apart soonest."""
    outline = 0.01 * np.array([[0, 0], [10, 0], [10, 3], [3, 3], [3, 10], [0, 10]])
    vertices = np.vstack([np.c_[outline, np.zeros(6)], np.c_[outline, np.full(6, 0.05)]])
    upper = np.array([[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5]]) + 6
    sides = [side for i, j in pairwise([*range(6), 0]) for side in ([i, j, j + 6], [i, j + 6, i + 6])]
    return model(trimesh.Trimesh(vertices, [*(upper - 6)[:, ::-1], *upper, *sides], process=False), name="angle")


def soup(n_triangles: int) -> ObjectModel:
    """Loose triangles in a cube of 10 cm, no two of which share a corner."""
    rng = np.random.default_rng(0)
    corners = rng.uniform(-0.05, 0.05, (n_triangles, 1, 3)) + rng.normal(0, 0.005, (n_triangles, 3, 3))
    faces = np.arange(3 * n_triangles).reshape(-1, 3)
    return model(trimesh.Trimesh(corners.reshape(-1, 3), faces, process=False), 5, "soup")


def placed(thing: ObjectModel, t_world: tuple[float, float, float], R: Float = FLAT, instance_id: int = 0) -> Placed:
    return Placed(instance_id, thing, T_CAM_WORLD @ transform(R, t_world))


def standing(thing: ObjectModel, R: Float = FLAT, xy: tuple[float, float] = (0, 0), instance_id: int = 0) -> Placed:
    """The model turned by ``R``, its lowest vertex on the plane."""
    lowest_m = float((thing.vertices @ R.T)[:, 2].min())
    return placed(thing, (*xy, -lowest_m), R, instance_id)


def table(normal_world: Float | tuple[float, float, float] = (0.0, 0.0, 1.0)) -> Support:
    return Support(T_WORLD_CAM, np.asarray(normal_world, dtype=np.float64), "plane", 0.9)


def tilt_deg(T_cam_obj: Float) -> float:
    """Angle between the object's z axis and up."""
    return float(np.rad2deg(np.arccos(np.clip((T_WORLD_CAM @ T_cam_obj)[2, 2], -1, 1))))


def heights(thing: ObjectModel, T_cam_obj: Float) -> Float:
    """World z of the model's vertices [m]."""
    T = T_WORLD_CAM @ T_cam_obj
    return thing.vertices @ T[2, :3] + T[2, 3]
