"""Meshes of the surroundings of a frame, drawn alike in the page's 3D view and in recordings."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float
from verefine_viz.core.palette import RGB, SCENE_COLORS
from verefine_viz.core.surroundings import Surroundings, UnknownObject, clipped

SURFACE_COLOR: RGB = SCENE_COLORS["plane"]
SOLID_COLOR: RGB = (200, 150, 90)
UNKNOWN_COLOR: RGB = (236, 72, 196)
DROPPED_COLOR: RGB = (130, 130, 130)
LIFT_M = 0.0005
"""Surfaces are raised by this much, so that they lie above the tops of the solids below them [m]."""

Mesh = tuple[Float, NDArray[np.int32]]
"""Vertices (V, 3) in the world [m] and faces (F, 3)."""


@dataclass(frozen=True, eq=False)
class DrawnSurroundings:
    """The meshes to draw, without faces where there is nothing of the kind."""

    surfaces: Mesh
    """The supporting surfaces around the objects."""
    solids: Mesh
    """The other solids."""
    unknown: tuple[tuple[UnknownObject, RGB], ...]


def drawn_surroundings(around: Surroundings, middle_world: Float, reach_m: float) -> DrawnSurroundings:
    """The surroundings around a place.

    Args:
        around: of the frame.
        middle_world: (3,) the middle of the objects [m].
        reach_m: surfaces are drawn up to this distance from it, to each side.
    """
    x, y = middle_world[:2]
    square = np.array([[x - reach_m, y - reach_m], [x + reach_m, y - reach_m],
                       [x + reach_m, y + reach_m], [x - reach_m, y + reach_m]])  # fmt: skip
    tops: list[Mesh] = []
    for surface in around.supporting:
        outline = square
        inward, offsets = surface.edges
        for normal, offset in zip(inward, offsets, strict=True):
            outline = clipped(outline, -normal, -float(offset))
        # The base only catches what falls; it was not seen.
        if len(outline) >= 3 and not (surface is around.base and around.catches):
            fan = [(0, k, k + 1) for k in range(1, len(outline) - 1)]
            tops.append((surface.lifted(outline) + np.array([0.0, 0.0, LIFT_M]), np.array(fan, np.int32)))
    others = [(model.vertices, model.faces) for model in around.solids[len(around.surfaces) :]]
    colored = tuple((u, DROPPED_COLOR if u.is_dropped else UNKNOWN_COLOR) for u in around.unknown)
    return DrawnSurroundings(_joined(tops), _joined(others), colored)


def _joined(meshes: list[Mesh]) -> Mesh:
    if not meshes:
        return np.zeros((0, 3)), np.zeros((0, 3), np.int32)
    first = np.cumsum([0, *(len(vertices) for vertices, _ in meshes[:-1])])
    faces = [faces + start for (_, faces), start in zip(meshes, first, strict=True)]
    return np.concatenate([vertices for vertices, _ in meshes]), np.concatenate(faces).astype(np.int32)
