"""A triangle mesh as the renderers want it: compact arrays and face planes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float, writable


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
    closed: NDArray[np.bool_]
    """(F,) whether the face is part of a closed surface, whose back is never seen."""
    radius_m: float
    """Radius of the sphere around the origin that holds all vertices [m]."""

    @property
    def arrays(self) -> tuple[Float, NDArray[np.int32], Float, Float, NDArray[np.bool_]]:
        """What the rasteriser takes."""
        return self.vertices, self.faces, self.face_normals, self.face_offsets, self.closed


@dataclass(frozen=True, eq=False)
class RenderMeshes:
    """Models that are drawn into one picture, their arrays end to end; a lone model's arrays are not copied."""

    meshes: tuple[RenderMesh, ...]
    vertices: Float
    """(ΣV, 3) [m], each model's in its own object frame."""
    faces: NDArray[np.int32]
    """(ΣF, 3), each model's counted from its own first vertex."""
    face_normals: Float
    """(ΣF, 3)."""
    face_offsets: Float
    """(ΣF,) [m]."""
    closed: NDArray[np.bool_]
    """(ΣF,)."""
    vertex_starts: NDArray[np.int64]
    """(m + 1,) where each model's vertices begin."""
    face_starts: NDArray[np.int64]
    """(m + 1,)."""

    @property
    def arrays(
        self,
    ) -> tuple[Float, NDArray[np.int32], Float, Float, NDArray[np.bool_], NDArray[np.int64], NDArray[np.int64]]:
        """What the kernels take."""
        faces = self.faces, self.face_normals, self.face_offsets, self.closed
        return self.vertices, *faces, self.vertex_starts, self.face_starts

    def model_of(self, face_of: NDArray[np.integer]) -> NDArray[np.intp]:
        """Which model each of some faces belongs to."""
        if len(self.meshes) == 1:
            return np.zeros(face_of.shape, np.intp)
        return np.searchsorted(self.face_starts, face_of, side="right") - 1


def render_meshes(meshes: tuple[RenderMesh, ...]) -> RenderMeshes:
    """Puts m ≥ 1 meshes end to end."""
    fields = ("vertices", "faces", "face_normals", "face_offsets", "closed")
    if len(meshes) == 1:
        joined = [getattr(meshes[0], name) for name in fields]
    else:
        joined = [np.concatenate([getattr(mesh, name) for mesh in meshes]) for name in fields]
    starts = (np.cumsum([0, *(len(getattr(mesh, name)) for mesh in meshes)]) for name in ("vertices", "faces"))
    return RenderMeshes(meshes, *joined, *starts)


def render_mesh(vertices: Float, faces: NDArray[np.int32], closed: NDArray[np.bool_] | None = None) -> RenderMesh:
    """Prepares a mesh (V, 3), (F, 3) for drawing; triangles without area are left out.

    ``closed`` (F,) comes from :func:`~verefine_viz.rendering.simplify.closed_faces`; without it all backs are drawn.
    """
    normals, length = _across(vertices, faces)
    solid = length > 0
    faces = np.ascontiguousarray(faces[solid], dtype=np.int32)
    normals = np.ascontiguousarray(normals[solid] / length[solid, None])
    return RenderMesh(
        vertices=writable(vertices),
        faces=faces,
        face_normals=normals,
        face_offsets=np.einsum("ij,ij->i", normals, vertices[faces[:, 0]]),
        closed=np.zeros(len(faces), np.bool_) if closed is None else closed[solid],
        radius_m=float(np.linalg.norm(vertices, axis=1).max()),
    )


def drawn_faces(vertices: Float, faces: NDArray[np.int32]) -> NDArray[np.intp]:
    """Which faces :func:`render_mesh` draws, in its order."""
    return np.flatnonzero(_across(vertices, faces)[1] > 0)


def _across(vertices: Float, faces: NDArray[np.int32]) -> tuple[Float, Float]:
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    return normals, np.linalg.norm(normals, axis=1)
