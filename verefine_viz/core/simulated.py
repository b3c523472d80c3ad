"""What a simulation of one object leaves behind: its poses, what it touched, and whether it stands."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float, finite, frozen


@dataclass(frozen=True, eq=False)
class Contacts:
    """Where a simulated object touches something, at one step."""

    points_cam: Float
    """(n, 3) [m]."""
    normals_cam: Float
    """(n, 3) unit, pointing onto the moving object."""
    depths_m: Float
    """(n,) penetration, positive = overlapping [m]."""
    forces_n: Float
    """(n,) normal force [N]."""
    others: NDArray[np.int64]
    """(n,) instance_id of what is touched; −1 is the support plane."""

    def __post_init__(self) -> None:
        n = len(self.depths_m)
        object.__setattr__(self, "points_cam", finite(self.points_cam, "contact points", (n, 3)))
        object.__setattr__(self, "normals_cam", finite(self.normals_cam, "contact normals", (n, 3)))
        object.__setattr__(self, "depths_m", finite(self.depths_m, "contact depths", (n,)))
        object.__setattr__(self, "forces_n", finite(self.forces_n, "contact forces", (n,)))
        object.__setattr__(self, "others", frozen(self.others, "contact partners", (n,), np.int64))

    def split(self, ends: Sequence[int]) -> tuple[Contacts, ...]:
        """One record per step, of the contacts of all steps one after another: up to each of ``ends``, from the last.

        Made without another check, as their columns are parts of columns that are checked already.
        """
        points, normals, depths_m = self.points_cam, self.normals_cam, self.depths_m
        forces_n, others = self.forces_n, self.others
        parts: list[Contacts] = []
        a = 0
        for b in ends:
            part = object.__new__(Contacts)
            part.__dict__.update(
                points_cam=points[a:b],
                normals_cam=normals[a:b],
                depths_m=depths_m[a:b],
                forces_n=forces_n[a:b],
                others=others[a:b],
            )
            parts.append(part)
            a = b
        return tuple(parts)


@dataclass(frozen=True)
class Tipping:
    """That a simulated object does not stand: it touches something, and nothing carries its centre of mass."""

    overhang_m: float
    """Distance of the centre of mass to what carries the object, seen along gravity [m]."""
    step: int
    """1, 2, …: at the end of which step. The last one, or the first that touched where it fell over until the end."""


@dataclass(frozen=True, eq=False)
class SimulatedPath:
    """What physics did to an object, pose by pose."""

    Ts_cam_obj: Float
    """(S + 1, 4, 4): the start, then one pose per step [m]."""
    contacts: tuple[Contacts, ...]
    """One per step, S of them: contacts at the end of the step."""
    tipping: Tipping | None = None
    """None: it stands, falls freely, or sinks in too deep to tell."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "Ts_cam_obj", finite(self.Ts_cam_obj, "simulated path", (None, 4, 4)))

    @property
    def T_cam_obj(self) -> Float:
        """The last pose (4, 4)."""
        return self.Ts_cam_obj[-1]
