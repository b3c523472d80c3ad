"""An object's geometry: mesh, sampled cloud, symmetries."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float, finite, frozen
from verefine_viz.core.errors import ShapeError


@dataclass(frozen=True, eq=False)
class ObjectModel:
    """One object model, in its own frame, metres."""

    obj_id: int
    name: str
    vertices: Float
    """(V, 3) [m]."""
    faces: NDArray[np.int32]
    """(F, 3) vertex indices."""
    points: Float
    """(M, 3) points sampled on the surface with a seed [m]; what refiners register against."""
    point_normals: Float
    """(M, 3) outward unit normals of ``points``."""
    diameter_m: float
    symmetries: Float
    """(S, 4, 4) transforms of the object frame that leave it looking the same; the identity is first."""
    vertex_colors: NDArray[np.uint8] | None = None
    """(V, 3) RGB, baked from a texture where there is one."""

    def __post_init__(self) -> None:
        vertices = finite(self.vertices, f"vertices of object {self.obj_id}", (None, 3))
        faces = frozen(self.faces, f"faces of object {self.obj_id}", (None, 3), np.int32)
        if len(faces) == 0:
            raise ShapeError(f"object {self.obj_id} ({self.name}) has no faces; a triangle mesh is expected")
        if faces.min() < 0 or faces.max() >= len(vertices):
            raise ShapeError(f"faces of object {self.obj_id} ({self.name}) name vertices that do not exist")
        if not self.diameter_m > 0:
            raise ShapeError(f"diameter of object {self.obj_id} ({self.name}) is {self.diameter_m}, expected > 0 m")
        object.__setattr__(self, "vertices", vertices)
        object.__setattr__(self, "faces", faces)
        object.__setattr__(self, "points", finite(self.points, f"points of object {self.obj_id}", (None, 3)))
        object.__setattr__(
            self, "point_normals", finite(self.point_normals, f"normals of object {self.obj_id}", (len(self.points), 3))
        )
        object.__setattr__(self, "symmetries", finite(self.symmetries, "symmetries", (None, 4, 4)))
        if self.vertex_colors is not None:
            colors = frozen(self.vertex_colors, "vertex colours", (len(vertices), 3), np.uint8)
            object.__setattr__(self, "vertex_colors", colors)

    @cached_property
    def mesh_hash(self) -> str:
        """Hex digest of the geometry: the key of everything cached on disk."""
        digest = hashlib.sha256(np.ascontiguousarray(self.vertices).tobytes())
        digest.update(np.ascontiguousarray(self.faces).tobytes())
        return digest.hexdigest()[:32]

    @property
    def is_symmetric(self) -> bool:
        """Whether another pose of it looks the same."""
        return len(self.symmetries) > 1
