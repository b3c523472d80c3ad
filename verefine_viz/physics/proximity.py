"""Distances between the surfaces of two placed models, and their overlap, without stepping and collision margins."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import trimesh

from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import apply
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.problem import Placed
from verefine_viz.core.ray_scene import queries, ray_scene

SIDEWAYS_M = 3e-4
"""Largest sideways distance of a point from the surface that it faces [m]."""
SPACING = 0.03
"""Largest distance between neighbouring surface points [share of the diameter]."""
OVERLAP_M = 0.0015
"""Smaller penetration is noise of poses and meshes [m]."""


class Surface:
    """A model's surface: points on it, and exact distances to it; object frame."""

    def __init__(self, model: ObjectModel) -> None:
        mesh = trimesh.Trimesh(model.vertices, model.faces, process=True)
        dense = trimesh.remesh.subdivide_to_size(mesh.vertices, mesh.faces, SPACING * model.diameter_m)[0]
        self.points = dense if len(dense) == len(mesh.vertices) else np.unique(dense, axis=0)
        """(N, 3) dense, corners and edges included [m]."""
        self.low, self.high = self.points.min(axis=0), self.points.max(axis=0)
        self._scene = ray_scene(mesh.vertices, mesh.faces)

    def distances(self, points: Float) -> tuple[Float, Float, Float]:
        """Signed distances (N,) of ``points`` (N, 3), negative inside; nearest points (N, 3) and normals (N, 3)."""
        query = queries(points)
        # Three rays vote on inside or outside: scanned meshes have holes.
        signed = self._scene.compute_signed_distance(query, nsamples=3).numpy().astype(np.float64)
        nearest = self._scene.compute_closest_points(query)
        normals = nearest["primitive_normals"].numpy().astype(np.float64)
        lengths = np.linalg.norm(normals, axis=1, keepdims=True)
        normals = np.divide(normals, lengths, out=np.zeros_like(normals), where=lengths > 0)
        return signed, nearest["points"].numpy().astype(np.float64), normals


class Surfaces:
    """Surfaces of models, made when first needed and cached, as they do not depend on the pose."""

    def __init__(self) -> None:
        self._made: dict[str, Surface] = {}

    def __call__(self, model: ObjectModel) -> Surface:
        """The surface of ``model``."""
        if model.mesh_hash not in self._made:
            self._made[model.mesh_hash] = Surface(model)
        return self._made[model.mesh_hash]


@dataclass(frozen=True, eq=False)
class Nearness:
    """Where two surfaces are close to each other."""

    gap_m: float
    """Smallest distance; 0 where they meet or overlap, infinite where they are nowhere closer than asked for."""
    penetration_m: float
    """How deep the deepest point of either lies in the other; 0 where they do not overlap."""
    points: Float
    """(n, 3) points where they face each other closer than asked for, or overlap; on one of the two surfaces."""
    normals: Float
    """(n, 3) unit normals, pointing towards the first."""
    distances_m: Float
    """(n,) signed, negative where they overlap."""

    @property
    def upright(self) -> float:
        """Vertical part of the normal where they overlap deepest, in [0, 1]; 0 where they do not face each other."""
        return float(abs(self.normals[int(np.argmin(self.distances_m)), 2])) if len(self.distances_m) else 0.0


def nearness(a: Surface, T_w_a: Float, b: Surface, T_w_b: Float, within_m: float) -> Nearness:
    """How near surface ``a`` is to ``b``, with points and normals in frame w."""
    both = [_directed_gap(a, T_w_a, b, T_w_b, within_m), _directed_gap(b, T_w_b, a, T_w_a, within_m)]
    smallest_m = min(both[0][0], both[1][0])
    return Nearness(
        max(smallest_m, 0.0),
        max(-smallest_m, 0.0),
        np.vstack([both[0][1], both[1][1]]),
        np.vstack([both[0][2], -both[1][2]]),
        np.concatenate([both[0][3], both[1][3]]),
    )


def _directed_gap(
    a: Surface, T_w_a: Float, b: Surface, T_w_b: Float, within_m: float
) -> tuple[float, Float, Float, Float]:
    """Smallest signed distance of the points of ``a`` to ``b``; the points where they meet ``b`` and its normals, in
    frame w.
    """
    points_b = ((a.points @ T_w_a[:3, :3].T + T_w_a[:3, 3]) - T_w_b[:3, 3]) @ T_w_b[:3, :3]
    close = np.flatnonzero(((points_b >= b.low - within_m) & (points_b <= b.high + within_m)).all(axis=1))
    if len(close) == 0:
        return np.inf, np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0)
    signed_m, met_b, normals_b = b.distances(points_b[close])
    smallest_m = float(signed_m.min())
    # Beyond an edge of b its surface is near but does not face the point, and could not support it.
    offset = points_b[close] - met_b
    sideways_m = np.linalg.norm(offset - np.einsum("ij,ij->i", offset, normals_b)[:, None] * normals_b, axis=1)
    near = np.flatnonzero((signed_m <= within_m) & (sideways_m <= SIDEWAYS_M))
    normals_w = normals_b[near] @ T_w_b[:3, :3].T
    own_w = a.distances(a.points[close[near]])[2] @ T_w_a[:3, :3].T if len(near) else np.zeros((0, 3))
    facing = np.einsum("ij,ij->i", normals_w, own_w) < -0.3
    met_w = met_b[near] @ T_w_b[:3, :3].T + T_w_b[:3, 3]
    return smallest_m, met_w[facing], normals_w[facing], signed_m[near][facing]


@dataclass(frozen=True, eq=False)
class Overlap:
    """An overlap of two objects."""

    first: int
    """instance_id."""
    second: int
    depth_mm: float
    """How deep the deepest point of either lies inside the other [mm]."""
    points_cam: Float
    """(n, 3) points of one surface inside the other [m]."""


def overlap(a: Placed, b: Placed, surface_of: Callable[[ObjectModel], Surface] = Surface) -> Overlap | None:
    """The overlap of two placed objects; None where it is less than ``OVERLAP_M``.

    Args:
        a: an object and its pose in the camera frame.
        b: another one.
        surface_of: makes the surface of a model; ``Surfaces()`` caches them.
    """
    corners_a, corners_b = _box(a), _box(b)
    if (np.maximum(corners_a[0], corners_b[0]) > np.minimum(corners_a[1], corners_b[1])).any():
        return None
    near = nearness(surface_of(a.model), a.T_cam_obj, surface_of(b.model), b.T_cam_obj, 0.0)
    if near.penetration_m < OVERLAP_M:
        return None
    return Overlap(a.instance_id, b.instance_id, near.penetration_m * 1e3, near.points)


def _box(placed: Placed) -> Float:
    """(2, 3) lowest and highest coordinates in the camera frame."""
    vertices = apply(placed.T_cam_obj, placed.model.vertices)
    return np.stack([vertices.min(axis=0), vertices.max(axis=0)])
