"""Can contacts hold an object still? Contact forces inside friction cones against gravity, as a linear programme."""

from __future__ import annotations

import numpy as np
from scipy.optimize import linprog

from verefine_viz.core.arrays import Float

CONE_SIDES = 8
"""Sides of the pyramid inscribed in each friction cone; with 8 it loses at most 8 % of the friction."""


def holds(points: Float, normals: Float, friction: Float, com: Float, gravity_direction: Float) -> bool:
    """Whether forces at the contacts can balance gravity at the centre of mass.

    Args:
        points: contact points (n, 3) [m].
        normals: (n, 3) unit normals pointing onto the object.
        friction: (n,) coefficients μ of the contacts.
        com: centre of mass (3,) [m].
        gravity_direction: (3,) unit, down.

    Source: docs/methods.md 7.2.
    """
    if len(points) == 0:
        return False
    arms = points - com
    reach = max(float(np.linalg.norm(arms, axis=1).max()), 1e-9)
    edges = _cone_edges(normals, friction)
    torques = np.cross(arms[:, None, :] / reach, edges)
    balance = np.concatenate([edges, torques], axis=2).reshape(-1, 6).T
    weight = np.concatenate([-gravity_direction, np.zeros(3)])
    solved = linprog(np.zeros(balance.shape[1]), A_eq=balance, b_eq=weight, bounds=(0, None), method="highs")
    return bool(solved.status == 0)


def _cone_edges(normals: Float, friction: Float) -> Float:
    """Edges (n, CONE_SIDES, 3) of the pyramids inscribed in the friction cones."""
    smallest = np.eye(3)[np.argmin(np.abs(normals), axis=1)]
    u = np.cross(normals, smallest)
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    v = np.cross(normals, u)
    angles = np.arange(CONE_SIDES) * (2 * np.pi / CONE_SIDES)
    around = np.cos(angles)[:, None] * u[:, None, :] + np.sin(angles)[:, None] * v[:, None, :]
    return normals[:, None, :] + friction[:, None, None] * around
