"""The mesh that is scored: the model's, with as few triangles as a given deviation allows, cached on disk."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import platformdirs
import trimesh
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from verefine_viz.core.array_cache import Arrays, cached
from verefine_viz.core.arrays import Float
from verefine_viz.core.decimation import decimated
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.progress_token import NEVER_CANCELLED, ProgressToken
from verefine_viz.core.ray_scene import queries, ray_scene
from verefine_viz.rendering.mesh import RenderMesh, render_mesh

if TYPE_CHECKING:
    import open3d as o3d

Faces = NDArray[np.int32]

MOST_FACES = 30_000
"""Parts with more faces count as open: a test for self-intersection compares all pairs, which takes seconds for so
many."""

ALGORITHM = 3
"""Part of the cached file's name; raise it when the same input would give another mesh."""

SMALL_PART_FACES = 64
"""Unconnected parts smaller than this are not simplified: they would vanish."""

N_SAMPLES = 30_000
"""Random surface points, beside all vertices, at which the deviation is measured."""


def cache_folder() -> Path:
    """Where simplified meshes are cached."""
    return Path(platformdirs.user_cache_dir("verefine-viz")) / "meshes"


def scoring_mesh(
    model: ObjectModel, simplify_mm: float, folder: Path | None = None, progress: ProgressToken = NEVER_CANCELLED
) -> RenderMesh:
    """The mesh with which ``model`` is scored.

    Args:
        model: its mesh is never changed.
        simplify_mm: largest deviation between the two surfaces, either way [mm]; 0 keeps every triangle.
        folder: the cache; None = :func:`cache_folder`. A damaged or unwritable cache costs time only.
        progress: asked where the mesh has to be made, before each try to make it with fewer triangles.

    Raises:
        Cancelled: through ``progress``; nothing is cached then.
    """
    if simplify_mm == 0:
        return render_mesh(model.vertices, model.faces)
    file = (folder or cache_folder()) / f"{model.mesh_hash}-{simplify_mm * 1000:.0f}um-v{ALGORITHM}.npz"

    def make() -> tuple[Float, Faces, NDArray[np.bool_]]:
        vertices, faces = simplified(model.vertices, model.faces, simplify_mm / 1000, progress)
        return vertices, faces, closed_faces(vertices, faces)

    mesh = cached(
        file,
        make,
        _unpacked,
        lambda mesh: dict(zip(("vertices", "faces", "closed"), mesh, strict=True)),
        progress.checkpoint,
        preparing=f"Preparing the mesh of {model.name} to score; cached once it is made.",
        waiting=f"Waiting for the mesh of {model.name} to score, which another process is preparing.",
    )
    return render_mesh(*mesh)


def simplified(
    vertices: Float, faces: Faces, tolerance_m: float, progress: ProgressToken = NEVER_CANCELLED
) -> tuple[Float, Faces]:
    """The coarsest mesh tried whose measured deviation is within ``tolerance_m``; at worst the mesh itself, welded."""
    vertices, faces = _welded(vertices, faces)
    is_small = _is_in_small_part(vertices, faces)
    small, large = faces[is_small], faces[~is_small]
    best = vertices, faces
    if len(large) == 0:
        return best
    reference = ray_scene(vertices, faces)
    reference_points = _surface_points(vertices, faces)
    scale = float(np.abs(vertices).max())
    too_few, enough = 4, len(large)
    while enough > 1.05 * too_few + 1:
        progress.checkpoint()
        target = max(too_few + 1, int(np.sqrt(too_few * enough)))
        coarse_vertices, coarse_faces = decimated(vertices / scale, large, target)
        candidate = _joined(coarse_vertices * scale, coarse_faces, vertices, small)
        if _deviation(reference, reference_points, *candidate) <= tolerance_m:
            enough = min(target, len(coarse_faces))
            if len(candidate[1]) < len(best[1]):
                best = candidate
        else:
            too_few = target
    return best


def deviation_m(a: tuple[Float, Faces], b: tuple[Float, Faces]) -> float:
    """Largest distance from sampled points of either surface to the other [m]."""
    return _deviation(ray_scene(*a), _surface_points(*a), *b)


def _surface_points(vertices: Float, faces: Faces) -> Float:
    """All vertices and ``N_SAMPLES`` points spread evenly over the surface, the same at each call."""
    rng = np.random.default_rng(0)
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    if area.sum() == 0:
        return vertices
    i = rng.choice(len(faces), N_SAMPLES, p=area / area.sum())
    r, s = np.sqrt(rng.random((N_SAMPLES, 1))), rng.random((N_SAMPLES, 1))
    return np.concatenate([vertices, (1 - r) * a[i] + r * (1 - s) * b[i] + r * s * c[i]])


def _deviation(
    reference: o3d.t.geometry.RaycastingScene, reference_points: Float, vertices: Float, faces: Faces
) -> float:
    if len(faces) == 0:
        return np.inf
    there = ray_scene(vertices, faces).compute_distance(queries(reference_points)).numpy().max()
    used = queries(_surface_points(*_welded(vertices, faces)))
    return float(max(there, reference.compute_distance(used).numpy().max()))


def _welded(vertices: Float, faces: Faces) -> tuple[Float, Faces]:
    """Joins vertices at the same place (texture seams) and drops unused ones and triangles that vanish."""
    points, same = np.unique(vertices, axis=0, return_inverse=True)
    faces = same.reshape(-1)[faces].astype(np.int32)
    whole = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
    used, compact = np.unique(faces[whole], return_inverse=True)
    return points[used], compact.reshape(-1, 3).astype(np.int32)


def _is_in_small_part(vertices: Float, faces: Faces) -> NDArray[np.bool_]:
    part_of = _parts(len(vertices), faces)
    return np.bincount(part_of)[part_of] < SMALL_PART_FACES


def _joined(vertices_a: Float, faces_a: Faces, vertices_b: Float, faces_b: Faces) -> tuple[Float, Faces]:
    faces = np.concatenate([faces_a, faces_b + len(vertices_a)]).astype(np.int32)
    return _welded(np.concatenate([vertices_a, vertices_b]), faces)


def closed_faces(vertices: Float, faces: NDArray[np.int32]) -> NDArray[np.bool_]:
    """(F,) whether each of the faces (F, 3) belongs to a closed surface, whose back is never seen from outside.

    A part (faces connected by vertices) without border that does not cut itself, and whose faces look outward,
    bounds a solid: seen from outside, a face turned toward the viewer comes first, so that those turned away need not
    be drawn. Vertices at the same place must be one vertex.
    """
    closed = np.zeros(len(faces), np.bool_)
    if len(faces) == 0:
        return closed
    part_of = _parts(len(vertices), faces)
    by_part = np.argsort(part_of, kind="stable")
    for part in np.split(by_part, np.cumsum(np.bincount(part_of))[:-1]):
        used, own = np.unique(faces[part], return_inverse=True)
        closed[part] = len(part) <= MOST_FACES and _bounds_a_solid(vertices[used], own.reshape(-1, 3).astype(np.int32))
    return closed


def _parts(n_vertices: int, faces: NDArray[np.int32]) -> NDArray[np.intp]:
    """(F,) the number, from 0, of the part that each face belongs to: the faces of a part are connected by vertices."""
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
    # Open3D takes more than a second to import, and is needed only where no cached mesh exists.
    import open3d as o3d

    mesh = o3d.geometry.TriangleMesh(o3d.utility.Vector3dVector(vertices), o3d.utility.Vector3iVector(faces))
    return bool(mesh.is_self_intersecting())


def _unpacked(arrays: Arrays) -> tuple[Float, Faces, NDArray[np.bool_]]:
    vertices, faces, closed = arrays["vertices"], arrays["faces"], arrays["closed"]
    sound = vertices.ndim == faces.ndim == 2 and vertices.shape[1] == faces.shape[1] == 3 and len(faces) > 0
    sound = sound and closed.shape == (len(faces),)
    if not sound or not np.isfinite(vertices).all() or faces.min() < 0 or faces.max() >= len(vertices):
        raise ValueError("no mesh")
    return vertices.astype(np.float64), faces.astype(np.int32), closed.astype(np.bool_)
