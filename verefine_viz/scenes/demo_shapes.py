"""Shapes by formula for the built-in objects: closed triangle meshes [m] with outward faces."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import trimesh
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float
from verefine_viz.scenes.meshes import Mesh

RGB = tuple[int, int, int]


def lathe(profile: Sequence[tuple[float, float]], sections: int, centred: bool = True) -> Mesh:
    """A solid of revolution about z.

    Args:
        profile: (radius, z) from the axis around the outside and back to the axis [m], counter-clockwise.
        sections: facets around.
        centred: origin in the middle of the height, else at z = 0 of the profile.
    """
    solid = trimesh.creation.revolve(np.array(profile, dtype=np.float64), sections=sections)
    return _mesh(solid, centred)


def cuboid(size_m: tuple[float, float, float], cell_m: float) -> Mesh:
    """A box around the origin, its faces cut into cells of about ``cell_m`` so that it can be painted."""
    x, y, z = size_m
    half = np.array(size_m) / 2
    parts = []
    for axis, (a, b) in ((0, (y, z)), (1, (z, x)), (2, (x, y))):
        n, m = max(1, round(a / cell_m)), max(1, round(b / cell_m))
        u, v = np.meshgrid(np.linspace(-1, 1, n + 1), np.linspace(-1, 1, m + 1), indexing="ij")
        first, second = (axis + 1) % 3, (axis + 2) % 3
        corner = np.arange((n + 1) * (m + 1)).reshape(n + 1, m + 1)
        q = np.stack([corner[:-1, :-1], corner[1:, :-1], corner[1:, 1:], corner[:-1, 1:]], axis=-1).reshape(-1, 4)
        faces = np.concatenate([q[:, [0, 1, 2]], q[:, [0, 2, 3]]])
        for side in (-1.0, 1.0):
            vertices = np.empty((u.size, 3))
            vertices[:, axis], vertices[:, first], vertices[:, second] = side, u.ravel(), v.ravel()
            parts.append((vertices * half, faces if side > 0 else faces[:, ::-1]))
    offsets = np.cumsum([0, *(len(v) for v, _ in parts[:-1])])
    vertices = np.concatenate([v for v, _ in parts])
    faces = np.concatenate([f + o for (_, f), o in zip(parts, offsets, strict=True)])
    return _mesh(trimesh.Trimesh(vertices, faces, process=True), centred=False)


def bracket() -> Mesh:
    """A steel angle: two legs of 80 mm and 80 mm, 12 mm thick, 40 mm wide."""
    a, t, w = 0.080, 0.012, 0.040
    outline = np.array([(0, 0), (a, 0), (a, t), (t, t), (t, a), (0, a)])
    caps = np.array([(0, 1, 2), (0, 2, 3), (0, 3, 4), (0, 4, 5)])
    n = len(outline)
    # The outline lies in the x-z plane; y is the width.
    front = np.stack([outline[:, 0], np.full(n, -w / 2), outline[:, 1]], axis=1)
    back = front + np.array([0, w, 0])
    k = np.arange(n)
    sides = np.concatenate(
        [np.stack([k, k + n, (k + 1) % n], axis=1), np.stack([(k + 1) % n, k + n, (k + 1) % n + n], axis=1)]
    )
    faces = np.concatenate([caps, caps[:, ::-1] + n, sides])
    solid = trimesh.Trimesh(np.concatenate([front, back]), faces, process=False)
    trimesh.repair.fix_normals(solid)
    return painted(_mesh(solid, centred=False), lambda v: np.tile((120, 132, 150), (len(v), 1)))


def carton() -> Mesh:
    """A square carton whose top slants by 16°: turned by a quarter, all but the top looks the same."""
    side, height, slant = 0.070, 0.110, np.tan(np.deg2rad(16.0))
    mesh = cuboid((side, side, height), 0.010)
    v = mesh.vertices_m.copy()
    v[:, 2] += np.where(v[:, 2] > height / 2 - 1e-6, v[:, 0] * slant, 0.0)

    def colors(p: Float) -> NDArray:
        label = (p[:, 2:] < 0.018) & (p[:, 2:] > -0.032)
        mark = (p[:, :1] > 0.0349) & (np.hypot(p[:, 1:2], p[:, 2:] + 0.007) < 0.02)
        return np.where(mark, (214, 72, 60), np.where(label, (74, 122, 190), (240, 240, 234)))

    return painted(Mesh(v, mesh.faces, None), colors)


def jug_handle(radius_m: float, middle_m: float, reach_m: float, thickness_m: float) -> Mesh:
    """Half a ring that starts and ends inside a wall at ``radius_m``, in the x-z plane, towards +x.

    Args:
        radius_m: of the wall [m].
        middle_m: height of the handle's middle [m].
        reach_m: half of its height; it stands out from the wall by 1.2 times that [m].
        thickness_m: radius of its round section [m].
    """
    along, around = 20, 12
    a = np.linspace(-np.pi / 2, np.pi / 2, along)
    centre = np.stack([radius_m - 0.004 + 1.2 * reach_m * np.cos(a), 0 * a, middle_m + reach_m * np.sin(a)], axis=1)
    tangent = np.stack([-1.2 * np.sin(a), 0 * a, np.cos(a)], axis=1)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    side = np.array([0.0, 1.0, 0.0])
    other = np.cross(tangent, side)
    b = np.arange(around) * 2 * np.pi / around
    ring = thickness_m * (np.cos(b)[None, :, None] * side + np.sin(b)[None, :, None] * other[:, None])
    vertices = (centre[:, None] + ring).reshape(-1, 3)
    i, j = (x.ravel() for x in np.meshgrid(np.arange(along - 1), np.arange(around), indexing="ij"))
    p, q = i * around + j, i * around + (j + 1) % around
    faces = np.concatenate([np.stack([p, q, p + around], axis=1), np.stack([q, q + around, p + around], axis=1)])
    fan = np.stack([np.zeros(around - 2, int), np.arange(1, around - 1), np.arange(2, around)], axis=1)
    faces = np.concatenate([faces, fan[:, ::-1], fan + (along - 1) * around])
    solid = trimesh.Trimesh(vertices, faces, process=False)
    trimesh.repair.fix_normals(solid)
    return _mesh(solid, centred=False)


def merged(a: Mesh, b: Mesh) -> Mesh:
    """Both meshes in one; both are painted or neither is."""
    colors = None
    if a.vertex_colors is not None and b.vertex_colors is not None:
        colors = np.concatenate([a.vertex_colors, b.vertex_colors])
    vertices = np.concatenate([a.vertices_m, b.vertices_m])
    return Mesh(vertices, np.concatenate([a.faces, b.faces + len(a.vertices_m)]).astype(np.int32), colors)


def painted(mesh: Mesh, color: Callable[[Float], NDArray]) -> Mesh:
    """The mesh with colours: ``color`` gives RGB (V, 3) of vertices (V, 3), seen from the middle of the mesh."""
    middle = (mesh.vertices_m.min(axis=0) + mesh.vertices_m.max(axis=0)) / 2
    return Mesh(mesh.vertices_m, mesh.faces, np.asarray(color(mesh.vertices_m - middle), dtype=np.uint8))


def _mesh(solid: trimesh.Trimesh, centred: bool) -> Mesh:
    vertices = np.asarray(solid.vertices, dtype=np.float64)
    if centred:
        vertices = vertices - (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    return Mesh(vertices, np.asarray(solid.faces, dtype=np.int32), None)
