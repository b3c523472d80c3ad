"""The objects of the built-in scenes: household things of known shape, from formulas and from Bullet's own meshes.

All object frames have their origin in the middle of the bounding box and z up as the object usually stands.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import pybullet_data
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import InputError, unknown
from verefine_viz.core.geometry import axis_angle, transform
from verefine_viz.core.model import ObjectModel
from verefine_viz.scenes.demo_shapes import RGB, bracket, carton, cuboid, jug_handle, lathe, merged, painted
from verefine_viz.scenes.meshes import Mesh, read_mesh
from verefine_viz.scenes.models import model_of_mesh
from verefine_viz.scenes.symmetries import CONTINUOUS_STEPS

Symmetry = Float


def _round(steps: int = CONTINUOUS_STEPS) -> Symmetry:
    """Rotations about z."""
    return np.stack([transform(axis_angle([0, 0, 1], 2 * np.pi * k / steps), np.zeros(3)) for k in range(steps)])


def _halves(*axes: tuple[int, int, int]) -> Symmetry:
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


def _block() -> Mesh:
    mesh = cuboid((0.075, 0.045, 0.030), 0.075)
    return painted(mesh, lambda v: np.tile((210, 176, 124), (len(v), 1)))


def _board() -> Mesh:
    mesh = cuboid((0.34, 0.26, 0.030), 0.13)
    return painted(mesh, lambda v: np.tile((222, 200, 160), (len(v), 1)))


def _panel() -> Mesh:
    mesh = cuboid((0.90, 0.040, 0.42), 0.21)
    return painted(mesh, lambda v: np.tile((206, 208, 204), (len(v), 1)))


def _tall_box() -> Mesh:
    mesh = cuboid((0.050, 0.060, 0.180), 0.015)
    return painted(mesh, lambda v: np.where(v[:, 2:] > 0.055, (64, 150, 130), (236, 236, 228)))


def _jug(with_handle: bool = True) -> Mesh:
    outer = [(0, 0), (0.044, 0), (0.047, 0.004), (0.045, 0.125), (0.041, 0.125)]
    body = lathe([*outer, (0.042, 0.006), (0, 0.006)], 48, centred=False)
    body = painted(body, lambda v: np.tile((206, 220, 226), (len(v), 1)))
    handle = painted(jug_handle(0.044, 0.062, 0.040, 0.0095), lambda v: np.tile((150, 196, 214), (len(v), 1)))
    # The frame is that of the whole jug in both cases: the body alone is what a sensor sees through a glass handle.
    whole = merged(body, handle)
    middle = (whole.vertices_m.min(axis=0) + whole.vertices_m.max(axis=0)) / 2
    mesh = whole if with_handle else body
    return Mesh(mesh.vertices_m - middle, mesh.faces, mesh.vertex_colors)


@dataclass(frozen=True, eq=False)
class _Kind:
    obj_id: int
    make: Callable[[], Mesh]
    symmetries: Symmetry | None = None
    is_centred: bool = False
    """The mesh is in its frame already."""


_KINDS: dict[str, _Kind] = {
    "mug": _Kind(1, _mug),
    "duck": _Kind(2, lambda: _bullet_mesh("duck.obj", 0.06, Y_UP)),
    "teddy": _Kind(3, lambda: _bullet_mesh("teddy2_VHACD_CHs.obj", 0.13, np.eye(3), (168, 112, 66))),
    "can": _Kind(4, _can, np.concatenate([_round(), _round() @ _halves((1, 0, 0))[1]])),
    "bottle": _Kind(5, _bottle, _round()),
    "bowl": _Kind(6, _bowl, _round()),
    "cereal": _Kind(7, _cereal, _halves((0, 0, 1))),
    "bracket": _Kind(8, bracket, _halves((1, 0, 1))),
    "carton": _Kind(9, carton),
    "block": _Kind(10, _block, _halves((1, 0, 0), (0, 1, 0), (0, 0, 1))),
    "tall box": _Kind(11, _tall_box, _halves((0, 0, 1))),
    "board": _Kind(13, _board, _halves((0, 0, 1), (1, 0, 0), (0, 1, 0))),
    "panel": _Kind(14, _panel, _halves((0, 0, 1), (1, 0, 0), (0, 1, 0))),
    "jug": _Kind(12, _jug, is_centred=True),
    "jug without handle": _Kind(12, lambda: _jug(False), is_centred=True),
}


@cache
def demo_model(name: str, n_points: int, seed: int) -> ObjectModel:
    """A built-in object.

    Raises:
        InputError: there is none of that name.
    """
    kind = _KINDS.get(name)
    if kind is None:
        raise InputError(unknown("built-in object", name, _KINDS))
    mesh = kind.make()
    if not kind.is_centred:
        middle = (mesh.vertices_m.min(axis=0) + mesh.vertices_m.max(axis=0)) / 2
        mesh = Mesh(mesh.vertices_m - middle, mesh.faces, mesh.vertex_colors)
    return model_of_mesh(mesh, kind.obj_id, name, n_points, seed, kind.symmetries)


def demo_obj_id(name: str) -> int:
    """The id of a built-in object, without building it."""
    return _KINDS[name].obj_id


def demo_model_names() -> tuple[str, ...]:
    """All built-in objects."""
    return tuple(_KINDS)
