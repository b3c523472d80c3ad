"""A triangle mesh as the renderers want it: compact arrays and face planes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

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
        radius_m=float(np.linalg.norm(vertices, axis=1).max()),
    )
