"""Which triangles of a mesh belong to a closed surface, whose back is never seen from outside.

A surface without border that does not cut itself, and whose faces look outward, bounds a solid: whatever looks at it
from outside meets a face turned toward it first. Its faces that are turned away need not be drawn.
"""

from __future__ import annotations

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from verefine_viz.core.arrays import Float

MOST_FACES = 30_000
"""Larger parts count as open: whether they cut themselves takes a look at all pairs, some seconds for so many."""


def closed_faces(vertices: Float, faces: NDArray[np.int32]) -> NDArray[np.bool_]:
    """(F,) whether each of the faces (F, 3) is part of a closed surface; parts are judged by themselves.

    Vertices at the same place must be one vertex.
    """
    closed = np.zeros(len(faces), np.bool_)
    if len(faces) == 0:
        return closed
    part_of = parts(len(vertices), faces)
    by_part = np.argsort(part_of, kind="stable")
    for part in np.split(by_part, np.cumsum(np.bincount(part_of))[:-1]):
        used, own = np.unique(faces[part], return_inverse=True)
        closed[part] = len(part) <= MOST_FACES and _bounds_a_solid(vertices[used], own.reshape(-1, 3).astype(np.int32))
    return closed


def parts(n_vertices: int, faces: NDArray[np.int32]) -> NDArray[np.intp]:
    """(F,) the number, from 0, of the part that each face belongs to: faces of a part hang together by vertices."""
    start, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    edges = coo_array((np.ones(len(start)), (start, end)), shape=(n_vertices, n_vertices))
    return np.unique(connected_components(edges, directed=False)[1][faces[:, 0]], return_inverse=True)[1]


def _bounds_a_solid(vertices: Float, faces: NDArray[np.int32]) -> bool:
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    if not (mesh.is_watertight and mesh.is_winding_consistent):
        return False
    # Not trimesh's own volume, which divides by it as well and warns where it is 0.
    a, b, c = (vertices[faces[:, k]] - vertices[faces[0, 0]] for k in range(3))
    volume = float(np.einsum("ij,ij->", a, np.cross(b, c)))
    return volume > 0 and not _cuts_itself(vertices, faces)


def _cuts_itself(vertices: Float, faces: NDArray[np.int32]) -> bool:
    # open3d takes seconds to import, and is needed only where no cached mesh exists.
    import open3d as o3d

    mesh = o3d.geometry.TriangleMesh(o3d.utility.Vector3dVector(vertices), o3d.utility.Vector3iVector(faces))
    return bool(mesh.is_self_intersecting())
