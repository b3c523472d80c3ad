"""The objects of the built-in scenes: household things of known shape, from formulas and from Bullet's own meshes.

All object frames have their origin in the middle of the bounding box and z up as the object usually stands.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import pybullet_data
import trimesh
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import InputError, unknown
from verefine_viz.core.geometry import axis_angle, transform
from verefine_viz.core.model import CONTINUOUS_STEPS, ObjectModel
from verefine_viz.core.settings import ModelSampling
from verefine_viz.scenes.meshes import Mesh, read_mesh
from verefine_viz.scenes.models import model_of_mesh

# Shapes by formula: closed triangle meshes [m] with outward faces.

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


def _jug_handle(radius_m: float, middle_m: float, reach_m: float, thickness_m: float) -> Mesh:
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


def _round(steps: int = CONTINUOUS_STEPS) -> Float:
    """Rotations about z."""
    return np.stack([transform(axis_angle([0, 0, 1], 2 * np.pi * k / steps), np.zeros(3)) for k in range(steps)])


def _halves(*axes: tuple[int, int, int]) -> Float:
    """The identity and half turns about axes."""
    return np.stack([np.eye(4), *(transform(axis_angle(axis, np.pi), np.zeros(3)) for axis in axes)])


def _bullet_mesh(file: str, scale: float, upright: Float, color: RGB | None = None) -> Mesh:
    mesh = read_mesh(Path(pybullet_data.getDataPath()) / file, scale)
    vertices = mesh.vertices_m @ upright.T
    colors = mesh.vertex_colors if color is None else np.tile(np.array(color, np.uint8), (len(vertices), 1))
    return Mesh(vertices, mesh.faces, colors)


Y_UP = axis_angle([1, 0, 0], np.pi / 2)


def _mug() -> Mesh:
    mesh = _bullet_mesh("objects/mug.obj", 1.0, np.eye(3))
    z = mesh.vertices_m[:, 2]
    radius = np.hypot(mesh.vertices_m[:, 0], mesh.vertices_m[:, 1])
    inside = (radius < 0.0385) & (z > 0.004)
    return painted(mesh, lambda v: np.where(inside[:, None], (236, 232, 220), (196, 64, 52)))


def _can() -> Mesh:
    r, h, cap = 0.0335, 0.101, 0.006
    profile = [(0, 0), (r, 0), (r, cap), (r, cap + 1e-4), (r, h - cap - 1e-4), (r, h - cap), (r, h), (0, h)]
    mesh = lathe(profile, 64)
    return painted(mesh, lambda v: np.where((np.abs(v[:, 2:]) > h / 2 - cap - 5e-5), (178, 182, 188), (206, 50, 44)))


def _bottle() -> Mesh:
    t = np.linspace(0, 1, 9)
    shoulder = np.stack([0.031 - 0.019 * (3 * t**2 - 2 * t**3), 0.115 + 0.035 * t], axis=1)
    side = [(0, 0), (0.029, 0), (0.031, 0.003), (0.031, 0.04), (0.031, 0.0401), (0.031, 0.09), (0.031, 0.0901)]
    neck = [(0.012, 0.165), (0.0145, 0.1651), (0.0145, 0.185), (0, 0.185)]
    mesh = lathe([*side, *map(tuple, shoulder.tolist()), *neck], 48)

    def colors(v: Float) -> NDArray:
        z = v[:, 2:] + 0.0925
        label = (z > 0.04005) & (z < 0.09005)
        return np.where(z > 0.16505, (240, 240, 236), np.where(label, (244, 214, 84), (46, 120, 84)))

    return painted(mesh, colors)


def _bowl() -> Mesh:
    a = np.linspace(0.0, np.pi / 2, 10)
    outer = np.stack([0.025 + 0.050 * np.sin(a), 0.055 * (1 - np.cos(a))], axis=1)
    inner = np.stack([0.024 + 0.047 * np.sin(a), 0.004 + 0.051 * (1 - np.cos(a))], axis=1)[::-1]
    mesh = lathe([(0, 0), *map(tuple, outer.tolist()), *map(tuple, inner.tolist()), (0, 0.004)], 64)
    radius, z = np.hypot(mesh.vertices_m[:, 0], mesh.vertices_m[:, 1]), mesh.vertices_m[:, 2] + 0.0275
    wall = 0.025 + 0.050 * np.sqrt(np.clip(1 - (1 - z / 0.055) ** 2, 0, 1))
    inside = (z > 0.0035) & (radius < wall - 0.002)
    return painted(mesh, lambda v: np.where(inside[:, None], (240, 238, 230), (62, 108, 178)))


def _cereal() -> Mesh:
    mesh = cuboid((0.060, 0.130, 0.190), 0.010)

    def colors(v: Float) -> NDArray:
        stripe = np.abs(v[:, 2:] - 0.035) < 0.026
        badge = (v[:, 1:2] ** 2 + (v[:, 2:] + 0.04) ** 2 < 0.032**2) & (np.abs(v[:, :1]) > 0.0299)
        return np.where(badge, (200, 60, 50), np.where(stripe, (250, 246, 232), (232, 170, 50)))

    return painted(mesh, colors)


def _plain_box(size_m: tuple[float, float, float], cell_m: float, color: RGB) -> Mesh:
    return painted(cuboid(size_m, cell_m), lambda v: np.tile(color, (len(v), 1)))


def _tall_box() -> Mesh:
    mesh = cuboid((0.050, 0.060, 0.180), 0.015)
    return painted(mesh, lambda v: np.where(v[:, 2:] > 0.055, (64, 150, 130), (236, 236, 228)))


def _pack() -> Mesh:
    """A box whose ends, and whose front and back, differ in colour alone."""
    mesh = cuboid((0.060, 0.045, 0.140), 0.010)

    def colors(v: Float) -> NDArray:
        band = (np.abs(v[:, 2:] + 0.035) < 0.012) & (v[:, 1:2] < 0.0)
        upper = v[:, 2:] > 0.025
        return np.where(band, (244, 238, 220), np.where(upper, (206, 62, 48), (46, 96, 168)))

    return painted(mesh, colors)


def _jug(with_handle: bool = True) -> Mesh:
    outer = [(0, 0), (0.044, 0), (0.047, 0.004), (0.045, 0.125), (0.041, 0.125)]
    body = lathe([*outer, (0.042, 0.006), (0, 0.006)], 48, centred=False)
    body = painted(body, lambda v: np.tile((206, 220, 226), (len(v), 1)))
    handle = painted(_jug_handle(0.044, 0.062, 0.040, 0.0095), lambda v: np.tile((150, 196, 214), (len(v), 1)))
    # The frame is that of the jug with its handle in both cases: a sensor sees the body alone through a glass handle.
    jug = merged(body, handle)
    middle = (jug.vertices_m.min(axis=0) + jug.vertices_m.max(axis=0)) / 2
    mesh = jug if with_handle else body
    return Mesh(mesh.vertices_m - middle, mesh.faces, mesh.vertex_colors)


@dataclass(frozen=True, eq=False)
class _Kind:
    obj_id: int
    make: Callable[[], Mesh]
    symmetries: Float | None = None
    is_centred: bool = False
    """The mesh is in its frame already."""


KINDS: dict[str, _Kind] = {
    "mug": _Kind(1, _mug),
    "duck": _Kind(2, lambda: _bullet_mesh("duck.obj", 0.06, Y_UP)),
    "teddy": _Kind(3, lambda: _bullet_mesh("teddy2_VHACD_CHs.obj", 0.13, np.eye(3), (168, 112, 66))),
    "can": _Kind(4, _can, np.concatenate([_round(), _round() @ _halves((1, 0, 0))[1]])),
    "bottle": _Kind(5, _bottle, _round()),
    "bowl": _Kind(6, _bowl, _round()),
    "cereal": _Kind(7, _cereal, _halves((0, 0, 1))),
    "bracket": _Kind(8, bracket, _halves((1, 0, 1))),
    "carton": _Kind(9, carton),
    "block": _Kind(
        10, lambda: _plain_box((0.075, 0.045, 0.030), 0.075, (210, 176, 124)), _halves((1, 0, 0), (0, 1, 0), (0, 0, 1))
    ),
    "tall box": _Kind(11, _tall_box, _halves((0, 0, 1))),
    "pack": _Kind(15, _pack),
    "board": _Kind(
        13, lambda: _plain_box((0.34, 0.26, 0.030), 0.13, (222, 200, 160)), _halves((0, 0, 1), (1, 0, 0), (0, 1, 0))
    ),
    "panel": _Kind(
        14, lambda: _plain_box((0.90, 0.040, 0.42), 0.21, (206, 208, 204)), _halves((0, 0, 1), (1, 0, 0), (0, 1, 0))
    ),
    "jug": _Kind(12, _jug, is_centred=True),
    "jug without handle": _Kind(12, lambda: _jug(False), is_centred=True),
}


@cache
def demo_model(name: str, n_points: int, seed: int, sampling: ModelSampling = "random") -> ObjectModel:
    """A built-in object.

    Raises:
        InputError: there is none of that name.
    """
    kind = KINDS.get(name)
    if kind is None:
        raise InputError(unknown("built-in object", name, KINDS))
    mesh = kind.make()
    if not kind.is_centred:
        middle = (mesh.vertices_m.min(axis=0) + mesh.vertices_m.max(axis=0)) / 2
        mesh = Mesh(mesh.vertices_m - middle, mesh.faces, mesh.vertex_colors)
    return model_of_mesh(mesh, kind.obj_id, name, n_points, seed, kind.symmetries, sampling=sampling)


def demo_obj_id(name: str) -> int:
    """The id of a built-in object, without building it."""
    return KINDS[name].obj_id
