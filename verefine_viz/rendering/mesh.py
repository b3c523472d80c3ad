"""A triangle mesh as the renderers want it: compact arrays, face planes, whether it is closed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from verefine_viz.core.arrays import Float


@dataclass(frozen=True, eq=False)
class RenderMesh:
    """What is drawn."""

    vertices: Float
    """(V, 3) [m], object frame."""
    faces: NDArray[np.int32]
    """(F, 3)."""
    face_normals: Float
    """(F, 3) unit, by the winding of the face."""
    face_offsets: Float
    """(F,) distance of the face's plane from the origin along its normal [m]."""
    is_closed: bool
    """Watertight, wound consistently, outward."""
    radius_m: float
    """Of the sphere around the origin that holds all vertices [m]."""


def render_mesh(vertices: Float, faces: NDArray[np.int32]) -> RenderMesh:
    """Prepares a mesh (V, 3), (F, 3) for drawing; triangles without area are left out."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    length = np.linalg.norm(normals, axis=1)
    flat = length > 0
    kept = np.ascontiguousarray(faces[flat], dtype=np.int32)
    normals = np.ascontiguousarray(normals[flat] / length[flat, None])
    return RenderMesh(
        vertices=np.ascontiguousarray(vertices, dtype=np.float64),
        faces=kept,
        face_normals=normals,
        face_offsets=np.einsum("ij,ij->i", normals, vertices[kept[:, 0]]),
        is_closed=bool(flat.all()) and _is_closed(vertices, faces),
        radius_m=float(np.linalg.norm(vertices, axis=1).max()),
    )


def _is_closed(vertices: Float, faces: NDArray[np.int32]) -> bool:
    """Whether each directed edge meets its reverse exactly once, and each connected part has a positive volume."""
    # Vertices split along texture seams are one point in space.
    _, same = np.unique(vertices, axis=0, return_inverse=True)
    welded = same.reshape(-1)[faces].astype(np.int64)
    start, end = welded.T.ravel(), np.roll(welded, -1, axis=1).T.ravel()
    n = len(vertices)
    forward, backward = np.sort(start * n + end), np.sort(end * n + start)
    if len(np.unique(forward)) != len(forward) or not np.array_equal(forward, backward):
        return False
    _, part_of = connected_components(coo_array((np.ones(len(start)), (start, end)), shape=(n, n)), directed=False)
    corners = vertices[faces]
    volumes = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))
    return bool((np.bincount(part_of[welded[:, 0]], volumes)[np.unique(part_of[welded[:, 0]])] > 0).all())
