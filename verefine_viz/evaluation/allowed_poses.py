"""Allowed poses, as data: poses of an object that its score cannot tell from an answer."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import axis_angle, inverse, rotation_vector, transform

Kind = Literal["shift", "turn"]
Unit = Literal["mm", "°"]
Frame = Literal["table", "object"]
Letter = Literal["x", "y", "z"]

CANNOT_TELL = 2.0
"""Standard deviations of its noise below which a difference does not count."""
ALL_SIX = 3.15
"""Six small motions are within so many standard deviations with a probability of 95 % (Bonferroni; Student's t of the
12 draws that the noise is known from)."""
STEP_DEG, STEP_MM = 3.0, 2.0
"""Spacing of the poses that are listed along an axis."""
LONGEST_MM = 30.0
"""Largest shift that is tried."""


@dataclass(frozen=True, eq=False)
class Axis:
    """One way to move the object: along a direction, or about it."""

    kind: Kind
    frame: Frame
    letter: Letter
    direction_cam: Float
    """(3,) unit."""
    pivot_cam: Float
    """(3,) a point on the axis of a turn [m]."""
    words: str
    """The motion in words: "turn about the vertical"."""

    @property
    def unit(self) -> Unit:
        return "mm" if self.kind == "shift" else "°"

    def moved(self, T_cam_obj: Float, offset: float) -> Float:
        """The pose (4, 4) shifted by ``offset`` [mm] or turned by it [deg]."""
        if self.kind == "shift":
            return transform(T_cam_obj[:3, :3], T_cam_obj[:3, 3] + 1e-3 * offset * self.direction_cam)
        R = axis_angle(self.direction_cam, np.deg2rad(offset))
        return transform(R @ T_cam_obj[:3, :3], R @ (T_cam_obj[:3, 3] - self.pivot_cam) + self.pivot_cam)


@dataclass(frozen=True, eq=False)
class Extent:
    """Range in which an object may be moved along one axis, all other motions being free."""

    axis: Axis
    low: float
    high: float
    """The observation cannot tell poses apart from ``low`` ≤ 0 to ``high`` ≥ 0 [mm] or [deg]."""
    offsets: Float
    """(n,) offsets at which poses were tried, ascending, where more than a small motion is allowed [mm] or [deg]."""
    poses: Float
    """(n, 4, 4) the poses with the highest score at these offsets."""

    @property
    def width(self) -> float:
        """The further end [mm] or [deg]."""
        return max(-self.low, self.high)

    @property
    def width_text(self) -> str:
        """The width: "±25°", or "−1 / +8 mm" where it is one-sided."""
        unit = "°" if self.axis.kind == "turn" else " mm"
        digits = 0 if self.width >= 10 else 1 if self.width >= 1 else 2
        one, two = abs(self.low), self.high
        if max(one, two) <= 1.5 * min(one, two) or self.width < 0.1:
            return f"±{self.width:.{digits}f}{unit}"
        return f"−{one:.{digits}f} / +{two:.{digits}f}{unit}"

    def describe(self) -> str:
        """What is undetermined: "turn about the vertical undetermined within ±25°"."""
        at_end = " or more" if self.axis.kind == "shift" and self.width >= LONGEST_MM else ""
        return f"{self.axis.words} undetermined within {self.width_text}{at_end}"

    def along(self) -> Iterator[Float]:
        """Poses (4, 4) along it, close to each other."""
        step = STEP_DEG if self.axis.kind == "turn" else STEP_MM
        for k in range(len(self.offsets) - 1):
            gap = self.offsets[k + 1] - self.offsets[k]
            for share in np.arange(0.0, 1.0, step / max(gap, step)):
                yield _between(self.axis, self.poses[k], self.poses[k + 1], gap, float(share))
        yield from self.poses[-1:]


@dataclass(frozen=True, eq=False)
class AlikePose:
    """A pose that the observation cannot tell from an answer."""

    T_cam_obj: Float
    """The pose (4, 4)."""
    score: float
    score_of_answer: float
    """The highest score next to the answer."""
    noise: float
    """Standard deviation of the difference of the two scores."""
    apart_mm: float
    """ADD(-S) between it and the answer [mm]."""

    @property
    def is_better(self) -> bool:
        """Whether it scores more than the answer, by more than noise explains."""
        return self.score - self.score_of_answer > CANNOT_TELL * self.noise


@dataclass(frozen=True, eq=False)
class SixMotions:
    """Coordinates of a pose's motions: three shifts along the table's axes, three turns about them through a point."""

    T_cam_obj: Float
    """(4, 4) the pose where motions begin."""
    centre_cam: Float
    """(3,) the point [m]."""
    directions_cam: Float
    """(3, 3) a unit direction in each row."""
    unit: Float
    """(6,) motions that move the surface by equal amounts [mm, deg]."""

    def moved(self, motion: Float) -> Float:
        """The pose (4, 4) after a motion (6,) [mm, deg]."""
        vector = np.deg2rad(motion[3:] @ self.directions_cam)
        angle = float(np.linalg.norm(vector))
        R = axis_angle(vector / angle, angle) if angle > 0 else np.eye(3)
        T, c = self.T_cam_obj, self.centre_cam
        return transform(R @ T[:3, :3], R @ (T[:3, 3] - c) + c + 1e-3 * motion[:3] @ self.directions_cam)

    def motion_to(self, T_cam_obj: Float, T_from: Float) -> Float:
        """The motion (6,) that leads from one pose (4, 4) to another [mm, deg]."""
        D = T_cam_obj @ inverse(T_from)
        shift = D[:3, :3] @ self.centre_cam + D[:3, 3] - self.centre_cam
        turn = rotation_vector(D[:3, :3])
        return np.concatenate([self.directions_cam @ shift * 1e3, np.rad2deg(self.directions_cam @ turn)])

    def along(self, axis: Axis) -> Float:
        """(6,) the motion along or about an axis by 1 mm or 1°."""
        part = self.directions_cam @ axis.direction_cam
        return np.concatenate([part, np.zeros(3)] if axis.kind == "shift" else [np.zeros(3), part])

    def ends(self) -> list[tuple[Float, Float]]:
        """The poses (4, 4) after one unit of each motion forth, and back."""
        return [(self.moved(motion), self.moved(-motion)) for motion in np.diag(self.unit)]


@dataclass(frozen=True, eq=False)
class SmallMotions:
    """Uncertainty of a pose, as motions that lead from it to the true pose."""

    six: SixMotions
    offset: Float
    """(6,) the likeliest motion [mm, deg]."""
    covariance: Float
    """(6, 6) covariance of the motion [mm, deg]."""

    def within(self, axis: Axis) -> tuple[float, float]:
        """The 95 % interval of a motion along an axis [mm] or [deg]."""
        along = self.six.along(axis)
        middle, spread = float(along @ self.offset), float(np.sqrt(max(along @ self.covariance @ along, 0.0)))
        return min(middle - CANNOT_TELL * spread, 0.0), max(middle + CANNOT_TELL * spread, 0.0)

    def allow(self, motion: Float) -> bool:
        """Whether all parts of a motion (6,) lie within their joint 95 % intervals."""
        return bool((np.abs(motion) <= ALL_SIX * np.sqrt(np.diag(self.covariance))).all())


@dataclass(frozen=True, eq=False)
class AllowedPoses:
    """Poses of an object that its score cannot tell from an answer, or that score more: small motions, far ones along
    an axis, and poses by themselves such as flips.
    """

    T_cam_obj: Float
    """(4, 4) the answer."""
    score: float
    """Score of the answer."""
    T_best: Float
    """(4, 4) the pose with the highest score near the answer."""
    small: SmallMotions
    extents: tuple[Extent, ...]
    """Extents along each of the twelve axes: three shifts and three turns of the table, then of the model."""
    alike: tuple[AlikePose, ...]
    """Poses apart from the answer by more than a small motion, the one that scores most first."""
    furthest: AlikePose | None
    """The allowed pose that is furthest from the answer, where it is further than 10 % of the diameter; None where
    one is better than the answer."""
    radius_mm: float
    """Half of the model's diameter: the motion of a far point by a turn of 1 rad."""

    @property
    def undetermined_mm(self) -> float:
        """The furthest shift that the score cannot tell [mm]."""
        return max(extent.width for extent in self.extents if extent.axis.kind == "shift")

    @property
    def undetermined_deg(self) -> float:
        """The furthest turn that the score cannot tell [deg]; 180 about an axis of symmetry."""
        return max(extent.width for extent in self.extents if extent.axis.kind == "turn")

    @cached_property
    def least_certain(self) -> Extent:
        """The extent along which the object's surface could be furthest from the answer's."""

        def reach_mm(extent: Extent) -> float:
            return extent.width if extent.axis.kind == "shift" else np.deg2rad(extent.width) * self.radius_mm

        widest = max(map(reach_mm, self.extents))
        # The table's axes come first: an upright can's axis is the vertical as well.
        return next(extent for extent in self.extents if reach_mm(extent) >= 0.9 * widest)

    @cached_property
    def anchors(self) -> tuple[Float, ...]:
        """The answer, and poses (4, 4) beyond small motions from it: along axes, and isolated ones."""
        along = (T for extent in self.extents for T in extent.along())
        return (self.T_cam_obj, *along, *(one.T_cam_obj for one in self.alike))


def _between(axis: Axis, one: Float, two: Float, gap: float, share: float) -> Float:
    """The pose a share of the way from one pose to another that a motion of ``gap`` along an axis leads to."""
    if axis.kind == "shift":
        return transform(one[:3, :3], (1 - share) * one[:3, 3] + share * two[:3, 3])
    # What the turn leaves is little, and is added linearly.
    rest = two @ inverse(axis.moved(one, gap))
    vector = rotation_vector(rest[:3, :3]) * share
    angle = float(np.linalg.norm(vector))
    R = axis_angle(vector / angle, angle) if angle > 0 else np.eye(3)
    moved = axis.moved(one, share * gap)
    at = moved[:3, 3]
    shift = (rest[:3, :3] @ at + rest[:3, 3] - at) * share
    return transform(R @ moved[:3, :3], at + shift)
