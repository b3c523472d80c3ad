"""One frame of the sensor, with what is derived from it once."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float, Mask, finite, frozen, set_fields
from verefine_viz.core.camera import Camera
from verefine_viz.core.geometry import as_rigid
from verefine_viz.core.surroundings import Surroundings

GravitySource = Literal["plane", "world", "given"]
ON_PLANE_M = 0.010
"""Distance to the support plane that counts as lying on it [m]: a depth sensor's error on a table at 1 m."""
TILT_SHOWN_DEG = 3.0
"""Where gravity and the support plane's normal differ by more, both are drawn and said [deg]."""


@dataclass(frozen=True, eq=False)
class Support:
    """The plane that carries the objects, and which way is up.

    The world frame has +z against gravity and its origin on the plane.
    """

    T_world_cam: Float
    """(4, 4) [m]."""
    normal_world: Float
    """(3,) unit normal of the plane in the world frame, up; equals +z where gravity is taken from the plane."""
    gravity_source: GravitySource
    """Where "up" comes from: the plane's normal, the data set's camera pose, or a vector that was given."""
    inlier_share: float
    """Share of the background's valid depth that lies on the plane, in [0, 1]."""
    rms_m: float = 0.0
    """Root mean square distance of the inliers to the plane [m]."""
    surroundings: Surroundings | None = None
    """What supports and stops the objects instead of the plane; None: the plane alone."""

    def __post_init__(self) -> None:
        set_fields(
            self,
            T_world_cam=as_rigid(self.T_world_cam, "T_world_cam"),
            normal_world=finite(self.normal_world, "normal_world", (3,)),
        )

    @property
    def tilt_deg(self) -> float:
        """Angle between the plane's normal and up [deg]."""
        x, y, z = self.normal_world
        return float(np.degrees(np.arctan2(np.hypot(x, y), z)))

    @cached_property
    def with_first_endless(self) -> Support | None:
        """The support whose first surface has no end: the world of what stays over it. None where nothing ends it."""
        around = self.surroundings
        if around is None or not around.catches or not around.surfaces:
            return None
        first, *others = around.surfaces
        base = replace(first, outline_xy=np.zeros((0, 2)))
        around = replace(around, base=base, catches=False, surfaces=tuple(others), solids=around.solids[1:])
        return replace(self, surroundings=around)


@dataclass(frozen=True, eq=False)
class Observation:
    """One RGB-D frame."""

    camera: Camera
    depth_m: NDArray[np.float32]
    """(H, W) z [m]; 0 where nothing was measured."""
    normals_cam: NDArray[np.float32]
    """(H, W, 3) unit normals towards the camera; 0 where none could be estimated."""
    rgb: NDArray[np.uint8] | None
    """(H, W, 3), or None where the data set has no colour."""
    object_mask: Mask
    """(H, W) union of the masks of all instances in the frame, also of those that are not to be solved."""
    support: Support | None
    """None: no plane was found and physics is off; ``support_note`` says why."""
    support_note: str = ""
    T_map_cam: Float | None = None
    """(4, 4) camera to the data set's world, where the data set says where that is [m]."""

    def __post_init__(self) -> None:
        h, w = self.camera.shape
        set_fields(
            self,
            depth_m=frozen(self.depth_m, "depth", (h, w), np.float32),
            normals_cam=frozen(self.normals_cam, "normals", (h, w, 3), np.float32),
            object_mask=frozen(self.object_mask, "object mask", (h, w), np.bool_),
        )
        if self.T_map_cam is not None:
            set_fields(self, T_map_cam=as_rigid(self.T_map_cam, "T_map_cam"))
        if self.rgb is not None:
            set_fields(self, rgb=frozen(self.rgb, "rgb", (h, w, 3), np.uint8))

    def __repr__(self) -> str:
        colour = "without colour" if self.rgb is None else "with colour"
        return f"<Observation {self.camera.width}×{self.camera.height} {colour}>"
