"""Distances between the surfaces of two placed models, without stepping and without collision margins."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import open3d as o3d
import trimesh

from verefine_viz.core.arrays import Float
from verefine_viz.core.model import ObjectModel

SPACING = 0.02
"""Largest distance between neighbouring surface points [share of the diameter]."""


class Surface:
    """A model's surface: points on it, and exact distances to it; object frame."""

    def __init__(self, model: ObjectModel) -> None:
        mesh = trimesh.Trimesh(model.vertices, model.faces, process=True)
        vertices, _ = trimesh.remesh.subdivide_to_size(mesh.vertices, mesh.faces, SPACING * model.diameter_m)
        self.points = np.unique(np.asarray(vertices), axis=0)
        """(N, 3) dense, corners and edges included [m]."""
        self._scene = o3d.t.geometry.RaycastingScene(nthreads=1)
        self._scene.add_triangles(
            o3d.core.Tensor(np.asarray(mesh.vertices, dtype=np.float32)),
            o3d.core.Tensor(np.asarray(mesh.faces, dtype=np.uint32)),
        )

    def distances(self, points: Float) -> tuple[Float, Float]:
        """Signed distance (N,) of ``points`` (N, 3), negative inside, and the outward normal (N, 3) where it is met."""
        query = o3d.core.Tensor(points.astype(np.float32))
        # Three rays vote on inside or outside: scanned meshes have holes.
        signed = self._scene.compute_signed_distance(query, nthreads=1, nsamples=3).numpy().astype(np.float64)
        normals = self._scene.compute_closest_points(query, nthreads=1)["primitive_normals"].numpy().astype(np.float64)
        lengths = np.linalg.norm(normals, axis=1, keepdims=True)
        return signed, np.divide(normals, lengths, out=np.zeros_like(normals), where=lengths > 0)


@dataclass(frozen=True, eq=False)
class Nearness:
    """Where two surfaces are close to each other."""

    gap_m: float
    """Smallest distance; 0 where they meet or overlap."""
    penetration_m: float
    """How deep the deepest point of either lies in the other; 0 where they do not overlap."""
    points: Float
    """(n, 3) where they are closer than asked, or overlap."""
    normals: Float
    """(n, 3) unit, pointing onto the first."""
    distances_m: Float
    """(n,) signed, negative where they overlap."""


def nearness(a: Surface, T_w_a: Float, b: Surface, T_w_b: Float, within_m: float) -> Nearness:
    """How near surface ``a`` is to ``b``, with points and normals in frame w."""
    found = [_one_way(a, T_w_a, b, T_w_b, within_m), _one_way(b, T_w_b, a, T_w_a, within_m)]
    smallest_m = min(found[0][0], found[1][0])
    return Nearness(
        max(smallest_m, 0.0),
        max(-smallest_m, 0.0),
        np.vstack([found[0][1], found[1][1]]),
        np.vstack([found[0][2], -found[1][2]]),
        np.concatenate([found[0][3], found[1][3]]),
    )


def _one_way(a: Surface, T_w_a: Float, b: Surface, T_w_b: Float, within_m: float) -> tuple[float, Float, Float, Float]:
    """Smallest signed distance of the points of ``a`` to ``b``; the near ones with ``b``'s normals, in frame w."""
    points_w = a.points @ T_w_a[:3, :3].T + T_w_a[:3, 3]
    signed_m, normals_b = b.distances((points_w - T_w_b[:3, 3]) @ T_w_b[:3, :3])
    near = np.flatnonzero(signed_m <= within_m)
    normals_w = normals_b[near] @ T_w_b[:3, :3].T
    # At an edge of b the nearest triangle may be the wrong side of the edge: its normal does not face a.
    own_w = a.distances(a.points[near])[1] @ T_w_a[:3, :3].T if len(near) else np.zeros((0, 3))
    facing = np.einsum("ij,ij->i", normals_w, own_w) < -0.3
    return float(signed_m.min()), points_w[near][facing], normals_w[facing], signed_m[near][facing]
