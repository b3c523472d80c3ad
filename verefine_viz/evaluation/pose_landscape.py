"""The score around a pose as data: along twelve axes, over two of them, and what the image allows."""

from __future__ import annotations

from dataclasses import dataclass

from verefine_viz.core.arrays import Float
from verefine_viz.evaluation.allowed_poses import AllowedPoses, Axis, Extent


@dataclass(frozen=True, eq=False)
class Curve:
    """The score along one axis."""

    extent: Extent
    """Offsets that the observation cannot tell apart."""
    offsets: Float
    """(n,) ascending, 0 among them [mm] or [deg]."""
    scores: Float
    """(n,)."""

    @property
    def axis(self) -> Axis:
        return self.extent.axis


@dataclass(frozen=True, eq=False)
class Landscape:
    """The score around a pose, along twelve axes: shifts and turns, of the table and of the model."""

    allowed: AllowedPoses
    curves: tuple[Curve, ...]

    @property
    def T_cam_obj(self) -> Float:
        """(4, 4) the pose."""
        return self.allowed.T_cam_obj

    @property
    def score(self) -> float:
        return self.allowed.score


@dataclass(frozen=True, eq=False)
class Slice:
    """The score over two axes at once."""

    across: Axis
    up: Axis
    across_offsets: Float
    """(n,) [mm] or [deg]."""
    up_offsets: Float
    """(n,)."""
    scores: Float
    """(n, n): a row for each offset of ``up``."""

    def pose(self, T_cam_obj: Float, column: int, row: int) -> Float:
        """The pose of one of its points."""
        return self.up.moved(self.across.moved(T_cam_obj, self.across_offsets[column]), self.up_offsets[row])
