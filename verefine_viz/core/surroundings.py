"""Surroundings of the objects, without models: surfaces that support them, other solids, unknown objects.

All of it stays where it is. Coordinates are those of the support's world frame: +z against gravity.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float, Mask, finite, frozen, set_fields
from verefine_viz.core.model import ObjectModel

SUPPORT_ID = -1
"""instance_id of everything that supports the objects: the support plane, and all surroundings but unknown objects."""


def unknown_id(number: int) -> int:
    """instance_id of an unknown object in contacts and penetrations: −2 for number 1, −3 for number 2, …"""
    return SUPPORT_ID - number


def unknown_number(instance_id: int) -> int | None:
    """The number of an unknown object, from 1; None for the support and for objects with a model."""
    return SUPPORT_ID - instance_id if instance_id < SUPPORT_ID else None


@dataclass(frozen=True, eq=False)
class SupportSurface:
    """A plane that supports objects, everywhere or within an outline."""

    normal_world: Float
    """(3,) unit, up."""
    offset_m: float
    """``normal · p + offset_m`` is the height of p above the plane [m]."""
    outline_xy: Float
    """(m, 2) corners seen from above, anticlockwise and convex [m]; none = the plane is unbounded."""

    def __post_init__(self) -> None:
        set_fields(
            self,
            normal_world=finite(self.normal_world, "normal", (3,)),
            outline_xy=finite(self.outline_xy, "outline", (None, 2)),
        )

    @property
    def is_endless(self) -> bool:
        return len(self.outline_xy) == 0

    def heights(self, points: Float) -> Float:
        """(n,) of points (n, 3), positive above the plane [m]."""
        return points @ self.normal_world + self.offset_m

    def lifted(self, xy: Float) -> Float:
        """Points (n, 3) of the plane straight above or below ``xy`` (n, 2)."""
        n = self.normal_world
        return np.column_stack([xy, -(xy @ n[:2] + self.offset_m) / n[2]])

    @cached_property
    def box_xy(self) -> tuple[list[float], list[float]]:
        """The lowest x and y of the outline, which must have corners, and the highest [m]."""
        return self.outline_xy.min(axis=0).tolist(), self.outline_xy.max(axis=0).tolist()

    @cached_property
    def edges(self) -> tuple[Float, Float]:
        """Inward unit normals (m, 2) of the outline's edges, offsets (m,): inside, ``n · p + offset`` ≥ 0 for all."""
        along = np.roll(self.outline_xy, -1, axis=0) - self.outline_xy
        inward = np.stack([-along[:, 1], along[:, 0]], axis=1) / np.linalg.norm(along, axis=1, keepdims=True)
        return inward, -(inward * self.outline_xy).sum(axis=1)

    def reaches(self, xy: Float, beyond_m: float = 0.0) -> NDArray[np.bool_]:
        """(n,) which of the points (n, 2) lie within the outline, or at most ``beyond_m`` outside."""
        inward, offsets = self.edges
        return np.all(xy @ inward.T + offsets >= -beyond_m, axis=1)


@dataclass(frozen=True, eq=False)
class UnknownObject:
    """A cluster of depth that stands on the support and belongs to no model."""

    number: int
    """1, 2, …: how page and settings name it; the largest first."""
    model: ObjectModel
    """The convex hull, in the world frame."""
    mask: Mask
    """(H, W) the pixels of the cluster."""
    is_dropped: bool = False
    """Whether the user removed it from the simulation; it is still shown."""

    def __post_init__(self) -> None:
        set_fields(self, mask=frozen(self.mask, "mask of an unknown object", (None, None), bool))

    @property
    def instance_id(self) -> int:
        return unknown_id(self.number)


@dataclass(frozen=True, eq=False)
class Surroundings:
    """The static world of a frame, in place of a support plane alone."""

    source: Literal["observed", "mesh"]
    base: SupportSurface
    """Surface below which everything is solid."""
    catches: bool
    """Whether the base was not seen: it then lies below everything and catches what falls."""
    surfaces: tuple[SupportSurface, ...]
    """Further surfaces, each with an outline: tops of the solids of the same index, the one with most on it first."""
    solids: tuple[ObjectModel, ...]
    """Convex solids in the world frame: first those below the surfaces, then others, such as walls."""
    unknown: tuple[UnknownObject, ...] = ()

    @property
    def supporting(self) -> tuple[SupportSurface, ...]:
        """Base and surfaces."""
        return (self.base, *self.surfaces)

    @property
    def bodies(self) -> tuple[tuple[int, ObjectModel], ...]:
        """Every convex solid with its instance_id, without dropped ones."""
        solids = tuple((SUPPORT_ID, model) for model in self.solids)
        return (*solids, *((u.instance_id, u.model) for u in self.unknown if not u.is_dropped))


def clipped(outline: Float, normal: Float, offset: float) -> Float:
    """The part (m, 2) of a convex outline where ``normal · p + offset ≤ 0``; empty where there is none."""
    sides = outline @ normal + offset
    corners: list[Float] = []
    for k in range(len(outline)):
        a, b, side_a, side_b = outline[k - 1], outline[k], sides[k - 1], sides[k]
        if (side_a <= 0) != (side_b <= 0):
            corners.append(a + (b - a) * side_a / (side_a - side_b))
        if side_b <= 0:
            corners.append(b)
    ring = np.array(corners).reshape(-1, 2)
    return ring[np.linalg.norm(ring - np.roll(ring, 1, axis=0), axis=1) > 1e-6]
