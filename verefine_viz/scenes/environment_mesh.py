"""Surroundings from a mesh, such as a robot's map or a CAD model of the cell; docs/methods.md 7.4.

Each flat part of the mesh that is convex becomes a solid of its own, as thick as the mesh is behind it: a sheet of
triangles would let an object through that starts inside of it.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import InputError, SettingsError, ShapeError
from verefine_viz.core.geometry import apply, as_rigid, inverse
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.observation import Observation, Support
from verefine_viz.core.ray_scene import queries, ray_scene
from verefine_viz.core.settings import PhysicsSettings
from verefine_viz.core.surroundings import SupportSurface, Surroundings
from verefine_viz.observation.observed_support import THICK_M, THICKEST_M, THINNEST_M, convex_model
from verefine_viz.observation.support_surfaces import STEEPEST
from verefine_viz.scenes.meshes import Mesh, read_mesh

NEAR_M = 0.5
"""Parts farther than this from all objects do not count [m]."""
MOST_SOLIDS = 2000
"""Most flat parts near the objects; more would make every simulation slow."""
FLAT = 0.99
"""A flat part that fills this share of its convex hull is used as a whole, else triangle by triangle."""


def environment_mesh(settings: PhysicsSettings) -> Mesh:
    """The mesh that ``settings.mesh`` names, in its own frame [m].

    Raises:
        SettingsError: no file is named.
        InputError: it cannot be read.
    """
    if not settings.mesh:
        raise SettingsError('physics.support is "mesh", but physics.mesh names no file')
    return read_mesh(Path(settings.mesh), settings.mesh_unit_m)


def mesh_surroundings(settings: PhysicsSettings, observation: Observation, support: Support) -> Surroundings:
    """The surroundings that ``settings.mesh`` holds.

    Args:
        settings: the file, its unit, and where it is.
        observation: the frame.
        support: which way is up, and the world frame of the answer.

    Raises:
        SettingsError: no file is named.
        InputError: it cannot be read, its pose is invalid or unknown in this frame, it has no faces near the objects,
            or too many.
    """
    path, mesh = Path(settings.mesh), environment_mesh(settings)
    vertices = apply(support.T_world_cam @ _T_cam_mesh(settings, observation), mesh.vertices_m)
    solid = trimesh.Trimesh(vertices, mesh.faces, process=False)
    parts = _flat_parts(solid, _near(vertices[mesh.faces], observation, support))
    if len(parts) > MOST_SOLIDS:
        raise InputError(
            f"mesh of the surroundings {path} has {len(parts)} flat parts within {NEAR_M} m of the objects, expected "
            f"at most {MOST_SOLIDS}; simplify it"
        )
    inward = _inward(solid, support.T_world_cam[:3, 3])
    thick_m = _thickness(solid, inward)
    tops: list[tuple[float, SupportSurface, ObjectModel]] = []
    others: list[ObjectModel] = []
    for part in parts:
        corners, down = vertices[np.unique(mesh.faces[part])], inward[part[0]]
        body = convex_model(np.concatenate([corners, corners + thick_m[part].min() * down]), "surroundings")
        if body is not None and -down[2] >= STEEPEST:
            seen = ConvexHull(corners[:, :2])
            surface = SupportSurface(-down, float(down @ corners.mean(axis=0)), corners[seen.vertices, :2])
            tops.append((seen.volume, surface, body))
        elif body is not None:
            others.append(body)
    tops.sort(key=lambda top: -top[0])
    solids = (*(body for _, _, body in tops), *others)
    if not solids:
        raise InputError(
            f"mesh of the surroundings {path} has nothing within {NEAR_M} m of the objects; check physics.mesh_pose, "
            "physics.mesh_frame and physics.mesh_unit_m"
        )
    lowest = min(float(body.vertices[:, 2].min()) for body in solids)
    base = SupportSurface(np.array([0.0, 0.0, 1.0]), NEAR_M - lowest, np.zeros((0, 2)))
    return Surroundings("mesh", base, True, tuple(surface for _, surface, _ in tops), solids)


def _T_cam_mesh(settings: PhysicsSettings, observation: Observation) -> Float:
    pose = np.eye(4)
    if settings.mesh_pose:
        if len(settings.mesh_pose) != 16:
            raise InputError(f"physics.mesh_pose has {len(settings.mesh_pose)} numbers, expected 16, row by row")
        try:
            pose = as_rigid(np.array(settings.mesh_pose).reshape(4, 4), "physics.mesh_pose")
        except ShapeError as error:
            raise InputError(str(error)) from None
    if settings.mesh_frame == "camera":
        return pose
    if observation.T_map_cam is None:
        raise InputError(
            'physics.mesh_frame is "world", but the frame does not say where its camera is (cam_R_w2c and cam_t_w2c); '
            'give physics.mesh_pose in the camera\'s frame, with physics.mesh_frame = "camera"'
        )
    return inverse(observation.T_map_cam) @ pose


def _near(triangles: Float, observation: Observation, support: Support) -> NDArray[np.bool_]:
    """Which triangles (F, 3, 3) count; all of them where no depth of the objects is known."""
    clear = observation.object_mask & (observation.depth_m > 0)
    if not clear.any():
        return np.ones(len(triangles), dtype=bool)
    objects = apply(support.T_world_cam, observation.camera.back_project(observation.depth_m.astype(np.float64))[clear])
    low, high = objects.min(axis=0) - NEAR_M, objects.max(axis=0) + NEAR_M
    return ((triangles.min(axis=1) <= high) & (triangles.max(axis=1) >= low)).all(axis=1)


def _flat_parts(solid: trimesh.Trimesh, near: NDArray[np.bool_]) -> list[NDArray[np.int64]]:
    """Indices of the faces of each ``near`` part: those in one plane with a convex outline, else a face alone."""
    parts = [np.asarray(facet, dtype=np.int64) for facet in solid.facets]
    whole = [part for part in parts if near[part].any() and _fills_hull(solid, part)]
    alone = near & (np.asarray(solid.area_faces) > 1e-10)
    for part in whole:
        alone[part] = False
    return [*whole, *(np.array([k]) for k in np.flatnonzero(alone))]


def _fills_hull(solid: trimesh.Trimesh, part: NDArray[np.int64]) -> bool:
    corners = np.asarray(solid.vertices)[np.unique(solid.faces[part])]
    across = np.linalg.svd(corners - corners.mean(axis=0), full_matrices=False)[2][:2]
    try:
        hull_m2 = ConvexHull(corners @ across.T).volume
    except QhullError:
        return False
    return float(np.asarray(solid.area_faces)[part].sum()) >= FLAT * hull_m2


def _inward(solid: trimesh.Trimesh, eye: Float) -> Float:
    """Unit normals (F, 3) into the solid; away from the camera where the mesh encloses none."""
    normals = np.asarray(solid.face_normals, dtype=np.float64)
    if solid.is_watertight:
        return -normals
    towards = ((eye - np.asarray(solid.triangles_center)) * normals).sum(axis=1) >= 0
    return np.where(towards[:, None], -normals, normals)


def _thickness(solid: trimesh.Trimesh, inward: Float) -> Float:
    """How thick (F,) the solid is behind each face, ``THICKEST_M`` at most; ``THICK_M`` where it encloses nothing."""
    if not solid.is_watertight:
        return np.full(len(inward), THICK_M)
    starts = np.asarray(solid.triangles_center) + 1e-4 * inward
    rays = queries(np.concatenate([starts, inward], axis=1))
    hit_m = ray_scene(solid.vertices, solid.faces).cast_rays(rays)["t_hit"].numpy().astype(np.float64)
    return np.clip(hit_m, THINNEST_M, THICKEST_M)
