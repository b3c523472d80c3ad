"""Decides whether a simulated object stands, from the contacts that Bullet reports, in microseconds.

:func:`plausibility` takes more into account (friction, neighbours' meshes) but a hundred times as long: too long for
every iteration of a run. Both treat the support plane alike: points within 2 mm of the lowest one support the object,
and the answer is unknown for a pose that sinks in by more than 5 mm. Surfaces of surroundings count within their
outline.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import angle_between
from verefine_viz.core.records import Tipping
from verefine_viz.core.surroundings import SupportSurface

TOUCHING_M = 0.002
"""Surfaces closer than this touch; less penetration than this counts as none (docs/methods.md 7.3)."""
IMPOSSIBLE_M = 0.005
"""Poses with a larger gap or penetration than this are impossible."""
UPWARDS = 0.3
"""Contacts whose normal has a smaller upward part do not support [-]."""
LEAST_M = 0.0005
"""A centre of mass less than this outside counts as on the edge, given the accuracy of contacts."""
TOPPLED_DEG = 10.0
"""An object that turns by more than this and then stands has fallen over [deg]."""
DEEPEST_M = 0.05
"""Points deeper below a surface than this may be under it [m]."""
HELD_DEG_S = 5.0
"""An object that touches a neighbour and turns slower than this leans on it [deg/s]."""

Point = tuple[float, float]
"""Seen from above, from the centre of mass [m]."""


class Touch(NamedTuple):
    """Where a simulated object touches something, or nearly."""

    point: Point
    up: float
    """Upward part of the unit normal that points onto the object [-]."""
    gap_m: float
    """Negative where it sinks in [m]."""
    pushes: bool
    """Whether it touches there."""
    is_plane: bool
    """Whether it touches the support plane, or the base of surroundings."""
    is_support: bool
    """Whether it touches either, or the top of another supporting surface."""


@dataclass(frozen=True, eq=False)
class SettlingMotion:
    """The simulation of an object, as far as it matters for whether the object stands."""

    Ts_world_com: Float
    """(S + 1, 4, 4): the start, then one pose per step [m]."""
    near: Callable[[int], list[Touch]]
    """Its contacts and near contacts at the end of step 1, 2, …"""
    hull_com: Float
    """(n, 3) corners of the mesh's convex hull, centre-of-mass frame [m]."""
    supporting: Sequence[SupportSurface]
    """The support plane, or what surroundings have instead, the base first."""
    step_s: float

    def tipping(self) -> Tipping | None:
        """Whether it does not stand at the end, or fell over on the way; None: it stands, or this is unknown."""
        last = len(self.Ts_world_com) - 1
        tipping = self._after(last) if last else None
        if tipping is None and self._turned_deg(0, last) > TOPPLED_DEG:
            first = next((k for k in range(1, last) if any(t.pushes for t in self.near(k))), None)
            tipping = self._after(first) if first else None
        return tipping

    def _after(self, step: int) -> Tipping | None:
        """Whether it does not stand at the end of a step."""
        touches = [touch for touch in self.near(step) if touch.gap_m <= TOUCHING_M]
        if is_inside([touch.point for touch in touches if touch.up > UPWARDS]):
            return None
        if not any(touch.pushes for touch in touches) or min(touch.gap_m for touch in touches) < -IMPOSSIBLE_M:
            return None
        if self._began_inside():
            return None
        carrying = [touch.point for touch in touches if touch.up > UPWARDS and not touch.is_plane]
        if any(touch.is_support for touch in touches):
            # Bullet keeps at most four contacts with the plane, begins with one, and keeps some that are out of date.
            low = self._low(step)
            carrying += [(x, y) for x, y in (low @ self.Ts_world_com[step, :2, :3].T).tolist()]
        if not carrying or is_inside(carrying):
            return None
        leans = not all(touch.is_support for touch in touches)
        if leans and self._turned_deg(step - 1, step) < HELD_DEG_S * self.step_s:
            return None
        outside_m = _distance_m(np.array(carrying))
        return Tipping(outside_m, step) if outside_m >= LEAST_M else None

    def _began_inside(self) -> bool:
        """Whether it was pushed out of something that it sank into, which turns it even if it could stand.

        A neighbour counts from 2 mm of depth after the first step, which removes more than half of the depth.
        """
        into_neighbour = any(touch.gap_m < -TOUCHING_M for touch in self.near(1) if not touch.is_support)
        return into_neighbour or float(self._heights_m(0).min()) < -IMPOSSIBLE_M

    def _low(self, step: int) -> Float:
        """The vertices (n, 3) that may support it, near enough to the highest surface below them."""
        heights_m = self._heights_m(step)
        return self.hull_com[heights_m <= max(float(heights_m.min()), 0.0) + TOUCHING_M]

    def _heights_m(self, k: int) -> Float:
        """Distances (n,) of the vertices to the support, positive above: to the plane, or to the nearest of the
        surfaces whose outline contains them.
        """
        T = self.Ts_world_com[k]
        base, *others = self.supporting
        nearest_m = self._above(base, T)
        if not others:
            return nearest_m
        xy = T[:2, :3] @ self.hull_com.T + T[:2, 3:]
        (left, front), (right, back) = xy.min(axis=1).tolist(), xy.max(axis=1).tolist()
        for surface in others:
            (x, y), (u, v) = surface.box_xy
            if right >= x and left <= u and back >= y and front <= v:
                heights_m = self._above(surface, T)
                over = surface.reaches(xy.T) & (heights_m > -DEEPEST_M)
                nearest_m[over] = np.minimum(nearest_m[over], heights_m[over])
        return nearest_m

    def _above(self, surface: SupportSurface, T_world_com: Float) -> Float:
        n = surface.normal_world
        return self.hull_com @ (n @ T_world_com[:3, :3]) + (n @ T_world_com[:3, 3] + surface.offset_m)

    def _turned_deg(self, a: int, b: int) -> float:
        return math.degrees(angle_between(self.Ts_world_com[a, :3, :3], self.Ts_world_com[b, :3, :3]))


def is_inside(points: Sequence[Point]) -> bool:
    """Whether the origin is in the convex hull of some points.

    The directions to the points seen so far span the angle from a to b, anticlockwise and at most 180°, as long as a
    line through the origin has all of them on one side.
    """
    if not points:
        return False
    (ax, ay), (bx, by) = points[0], points[0]
    for x, y in points[1:]:
        left_of_a, left_of_b = ax * y - ay * x >= 0, bx * y - by * x >= 0
        if left_of_a and left_of_b:
            bx, by = x, y
        elif not left_of_a and not left_of_b:
            ax, ay = x, y
        elif not left_of_a:
            return True
    return False


def _distance_m(points: Float) -> float:
    """Distance of the origin, which lies outside, to the convex hull of points (n, 2).

    The nearest of all lines between two points is the nearest edge, as all others are further inside.
    """
    starts, ends = points[:, None], points[None]
    edges = ends - starts
    lengths2 = np.maximum((edges**2).sum(axis=2), 1e-18)
    along = np.clip(-(starts * edges).sum(axis=2) / lengths2, 0.0, 1.0)
    return float(np.sqrt(((starts + along[..., None] * edges) ** 2).sum(axis=2).min()))
