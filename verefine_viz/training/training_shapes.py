"""Shapes for training networks: the random objects of pybullet_data, and solids by formula.

None is an object of a data set or of a built-in scene. Each is drawn with random proportions and size.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pybullet_data
import trimesh
from numpy.typing import NDArray
from scipy.spatial import ConvexHull
from scipy.spatial.distance import pdist

from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import axis_angle
from verefine_viz.rendering.mesh import RenderMesh, render_mesh

FOLDER = Path(pybullet_data.getDataPath()) / "random_urdfs"
N_RANDOM = 1000
"""Objects of pybullet_data/random_urdfs."""
N_HELD_OUT = 50
"""Number of objects, the last ones, on which networks are only evaluated."""
DIAMETER_M = (0.06, 0.30)
"""Smallest and largest diameter [m]; in between every size is as likely as its double."""
STRETCH = 0.5
"""Each side of a shape is scaled by up to exp of this, or by the inverse."""
TURNS = 36
"""Number of turns that represent the symmetries of a solid of revolution."""
LOSS_POINTS = 32
"""Number of points of a shape that measure the distance between two poses."""


@dataclass(frozen=True, eq=False)
class TrainingShape:
    """One shape in its final size, the middle of its bounding box at the origin."""

    mesh: RenderMesh
    radius_m: float
    """Half of the diameter [m]."""
    points: Float
    """(P, 3) vertices of its hull, spread evenly [m]."""
    symmetries: Float
    """(S, 3, 3) rotations that leave it looking the same, the identity first."""
    resting_normals: Float
    """(F, 3) outward normals of its hull's faces: sides it can lie on."""
    resting_weights: Float
    """(F,) how likely each is, by area."""


@dataclass(frozen=True, eq=False)
class _Solid:
    """A shape before it is stretched."""

    vertices: Float
    faces: NDArray[np.int32]
    symmetries: Float
    is_round: bool = False
    """Whether x and y are scaled alike, so that it keeps its symmetries."""


def draw_shape(rng: np.random.Generator, held_out: bool = False) -> TrainingShape:
    """A shape of random kind, proportions and size; half of them are those of pybullet_data."""
    if rng.random() < 0.5:
        n_first = N_RANDOM - N_HELD_OUT
        index = int(rng.integers(n_first, N_RANDOM)) if held_out else int(rng.integers(n_first))
        solid = _random_object(index)
    else:
        solid = _FORMULAS[int(rng.integers(len(_FORMULAS)))](rng)
    stretch = np.exp(rng.uniform(-STRETCH, STRETCH, 3))
    if solid.is_round:
        stretch[1] = stretch[0]
    vertices = solid.vertices * stretch
    vertices = vertices - (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    hull = ConvexHull(vertices)
    corners = vertices[hull.vertices]
    diameter = float(pdist(corners).max())
    wanted = np.exp(rng.uniform(*np.log(DIAMETER_M)))
    vertices, corners = vertices * (wanted / diameter), corners * (wanted / diameter)
    triangles = vertices[hull.simplices]
    areas = np.linalg.norm(np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]), axis=1)
    return TrainingShape(
        render_mesh(vertices, solid.faces),
        wanted / 2,
        _spread(corners, rng),
        solid.symmetries,
        hull.equations[:, :3],
        areas / areas.sum(),
    )


def _spread(corners: Float, rng: np.random.Generator) -> Float:
    """``LOSS_POINTS`` of the points (N, 3), each next one the farthest from those before."""
    chosen = [int(rng.integers(len(corners)))]
    nearest = np.full(len(corners), np.inf)
    while len(chosen) < LOSS_POINTS:
        nearest = np.minimum(nearest, ((corners - corners[chosen[-1]]) ** 2).sum(axis=1))
        chosen.append(int(nearest.argmax()))
    return corners[chosen]


@cache
def _random_object(index: int) -> _Solid:
    """An object of pybullet_data/random_urdfs, by number."""
    shape = trimesh.load_mesh(FOLDER / f"{index:03d}" / f"{index:03d}.obj", process=False)
    if not np.isfinite(shape.vertices).all():  # One of them is damaged.
        return _random_object(index + 1)
    return _solid(shape, np.eye(3)[None])


def _solid(shape: Any, symmetries: Float, is_round: bool = False) -> _Solid:
    return _Solid(np.asarray(shape.vertices, float), np.asarray(shape.faces, np.int32), symmetries, is_round)


def _box(rng: np.random.Generator) -> _Solid:
    half_turns = np.stack([np.diag(d) for d in ([1.0, 1, 1], [1.0, -1, -1], [-1.0, 1, -1], [-1.0, -1, 1])])
    return _solid(trimesh.creation.box(rng.uniform(0.3, 1.0, 3)), half_turns)


def _cylinder(rng: np.random.Generator) -> _Solid:
    turns = _turns()
    flip = np.diag([1.0, -1.0, -1.0])
    height = np.exp(rng.uniform(np.log(0.2), np.log(3.0)))
    shape = trimesh.creation.cylinder(0.5, height, sections=TURNS)
    return _solid(shape, np.concatenate([turns, turns @ flip]), is_round=True)


def _lathed(rng: np.random.Generator) -> _Solid:
    """A bottle, bowl, cup or knob: an outline of random radii turned about z."""
    n = int(rng.integers(2, 6))
    z = np.concatenate([[0.0], np.sort(rng.uniform(0.05, 1.0, n - 2)), [1.0]]) * np.exp(rng.uniform(-0.7, 0.7))
    r = rng.uniform(0.15, 0.55, n)
    return _solid(trimesh.creation.revolve(_outline(r, z, rng), sections=TURNS), _turns(), is_round=True)


def _handled(rng: np.random.Generator) -> _Solid:
    """The solid with a handle at its side."""
    height = np.exp(rng.uniform(-0.4, 0.6))
    r = rng.uniform(0.35, 0.5, 2)
    body = trimesh.creation.revolve(_outline(r, np.array([0.0, height]), rng), sections=TURNS)
    reach, thick = rng.uniform(0.15, 0.4), rng.uniform(0.04, 0.1)
    size = np.array([reach, thick, height * rng.uniform(0.3, 0.8)])
    handle = trimesh.creation.box(size)
    if rng.random() < 0.6:
        handle = trimesh.creation.annulus(max(size[2] / 2 - thick, 0.02), size[2] / 2, thick, sections=16)
        handle.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [1, 0, 0]))
    handle.apply_translation([r.min() + reach / 3, 0, height * rng.uniform(0.4, 0.6)])
    return _solid(trimesh.util.concatenate([body, handle]), np.eye(3)[None])


def _joined(rng: np.random.Generator) -> _Solid:
    """Two or three intersecting boxes and cylinders: a tool, an angle, a block with a knob."""
    parts = []
    for _ in range(int(rng.integers(2, 4))):
        part = (
            trimesh.creation.box(rng.uniform(0.15, 1.0, 3))
            if rng.random() < 0.6
            else trimesh.creation.cylinder(rng.uniform(0.08, 0.4), rng.uniform(0.2, 1.2), sections=20)
        )
        turn = trimesh.transformations.rotation_matrix(rng.choice([0.0, np.pi / 2, rng.uniform(0, np.pi)]), _axis(rng))
        part.apply_transform(turn)
        part.apply_translation(rng.uniform(-0.4, 0.4, 3))
        parts.append(part)
    return _solid(trimesh.util.concatenate(parts), np.eye(3)[None])


def _outline(r: Float, z: Float, rng: np.random.Generator) -> Float:
    """The half section of a solid of revolution: radii (n,) at heights (n,), hollow in four of ten."""
    outer = np.stack([r, z], axis=1)
    if rng.random() < 0.4:
        wall = rng.uniform(0.03, 0.08)
        inner = np.stack([np.maximum(r - wall, 0.01), np.maximum(z, wall)], axis=1)[::-1]
        return np.concatenate([[[0.0, 0.0]], outer, inner, [[0.0, inner[-1, 1]]]])
    return np.concatenate([[[0.0, z[0]]], outer, [[0.0, z[-1]]]])


def _axis(rng: np.random.Generator) -> Float:
    return np.eye(3)[int(rng.integers(3))]


def _turns() -> Float:
    return np.stack([axis_angle([0, 0, 1], 2 * np.pi * k / TURNS) for k in range(TURNS)])


_FORMULAS = (_box, _cylinder, _lathed, _handled, _joined)
