"""An object's geometry and looks: mesh, sampled cloud, symmetries, colours."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float, finite, frozen, set_fields
from verefine_viz.core.errors import ShapeError

CONTINUOUS_STEPS = 64
"""Rotations that stand for a continuous symmetry (5.6° apart); the official scores use 315."""
TEXTURE = 0.05
"""Colours of a model that differ by more in the mean, in [0, 1], can tell a turn."""


@dataclass(frozen=True, eq=False)
class Texture:
    """An image that is laid over the faces of a mesh."""

    image: NDArray[np.uint8]
    """(h, w, 3) RGB."""
    uv: NDArray[np.float32]
    """(F, 3, 2) where each face's corners lie in the image: u to the right, v up, the image from 0 to 1; outside of
    that the image is repeated."""

    def __post_init__(self) -> None:
        set_fields(
            self,
            image=frozen(self.image, "texture", (None, None, 3), np.uint8),
            uv=frozen(self.uv, "texture coordinates", (None, 3, 2), np.float32),
        )

    def colors(self, uv: Float) -> Float:
        """(N, 3) RGB in [0, 255] at coordinates (N, 2), linear between the pixels."""
        h, w = self.image.shape[:2]
        within = np.where((uv >= 0) & (uv <= 1), uv, uv - np.floor(uv))
        x, y = np.clip(within[:, 0] * w - 0.5, 0, w - 1), np.clip((1 - within[:, 1]) * h - 0.5, 0, h - 1)
        left, top = np.floor(x).astype(np.intp), np.floor(y).astype(np.intp)
        right, bottom = np.minimum(left + 1, w - 1), np.minimum(top + 1, h - 1)
        a, b = (x - left)[:, None], (y - top)[:, None]
        upper = (1 - a) * self.image[top, left] + a * self.image[top, right]
        lower = (1 - a) * self.image[bottom, left] + a * self.image[bottom, right]
        return (1 - b) * upper + b * lower


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
    """(V, 3) RGB; where there is a texture, its colours there."""
    texture: Texture | None = None
    """None where the file names none; the vertices may have colours even so."""

    def __post_init__(self) -> None:
        vertices = finite(self.vertices, f"vertices of object {self.obj_id}", (None, 3))
        faces = frozen(self.faces, f"faces of object {self.obj_id}", (None, 3), np.int32)
        if len(faces) == 0:
            raise ShapeError(f"object {self.obj_id} ({self.name}) has no faces; a triangle mesh is expected")
        if faces.min() < 0 or faces.max() >= len(vertices):
            raise ShapeError(f"faces of object {self.obj_id} ({self.name}) name vertices that do not exist")
        if not self.diameter_m > 0:
            raise ShapeError(f"diameter of object {self.obj_id} ({self.name}) is {self.diameter_m}, expected > 0 m")
        set_fields(
            self,
            vertices=vertices,
            faces=faces,
            points=finite(self.points, f"points of object {self.obj_id}", (None, 3)),
            point_normals=finite(self.point_normals, f"normals of object {self.obj_id}", (len(self.points), 3)),
            symmetries=finite(self.symmetries, "symmetries", (None, 4, 4)),
        )
        if self.vertex_colors is not None:
            colors = frozen(self.vertex_colors, "vertex colours", (len(vertices), 3), np.uint8)
            set_fields(self, vertex_colors=colors)
        if self.texture is not None and len(self.texture.uv) != len(faces):
            raise ShapeError(
                f"object {self.obj_id} ({self.name}) has {len(faces)} faces and texture coordinates of "
                f"{len(self.texture.uv)}"
            )

    def __repr__(self) -> str:
        return f"<ObjectModel {self.name} ({self.obj_id}): {len(self.faces)} faces, {1e3 * self.diameter_m:.0f} mm>"

    @cached_property
    def mesh_hash(self) -> str:
        """Hex digest of the geometry: the key of everything cached on disk."""
        digest = hashlib.sha256(np.ascontiguousarray(self.vertices).tobytes())
        digest.update(np.ascontiguousarray(self.faces).tobytes())
        return digest.hexdigest()[:32]

    @cached_property
    def middle_m(self) -> Float:
        """(3,) the middle of its bounding box [m]."""
        return (self.vertices.min(axis=0) + self.vertices.max(axis=0)) / 2

    @property
    def has_colors(self) -> bool:
        """Whether it has colours of its own, by a texture or at its vertices."""
        return self.texture is not None or self.vertex_colors is not None

    def colors(self, faces: NDArray[np.integer], weights: Float) -> Float:
        """(N, 3) RGB in [0, 255] of points on its faces (N,), by the weights (N, 3) of each face's corners.

        The model must have colours.
        """
        if self.texture is not None:
            return self.texture.colors(np.einsum("ik,ikj->ij", weights, self.texture.uv[faces]))
        assert self.vertex_colors is not None
        return np.einsum("ik,ikj->ij", weights, self.vertex_colors[self.faces[faces]].astype(np.float64))

    @property
    def is_symmetric(self) -> bool:
        """Whether another pose of it looks the same."""
        return len(self.symmetries) > 1
