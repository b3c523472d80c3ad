"""What a learned refiner says about a call: step by step, what it saw and what it answered."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float
from verefine_viz.core.problem import Target


@dataclass(frozen=True, eq=False)
class RefinerStep:
    """One step of a network."""

    crops: Mapping[str, NDArray[np.float32] | NDArray[np.uint8]]
    """By name, what it saw, all of one size: numbers (H, W), NaN where there are none, or colours (H, W, 3)."""
    limits: Mapping[str, tuple[float, float]]
    """By name of a crop of numbers: its darkest and brightest one."""
    turn: Float
    """(3,) the answer's rotation vector [rad], in the frame of the crop: x right, y down, z away."""
    shift_m: Float
    """(3,) the answer's shift [m], in the same frame."""
    centre_px: Float
    """(2,) where the object's centre is in the crop: column, row."""
    px_per_m: float
    """At the object's distance."""
    points_px: Float | None = None
    """(n, 2) sampled points: column, row; None = it takes whole crops."""
    is_taken: bool = True
    """Whether the pose followed the answer."""
    expected_mm: float | None = None
    """The mean error of the object's points that it expects to be left [mm]; None = it does not say."""
    trained_mm: float | None = None
    """The largest such error that it was trained on [mm]."""
    confidence: float | None = None
    """The highest confidence of a point; None = it has none."""


@dataclass(frozen=True)
class TrainedRange:
    """How far from the ground truth a pose may be that a refiner was trained to correct."""

    rotation_deg: float
    """Largest rotation [deg]."""
    shift_radii: float
    """Largest shift of the object's middle, in halves of its diameter."""


@runtime_checkable
class LearnedRefiner(Protocol):
    """A refiner that can say what it saw."""

    def explain(self, target: Target, T_cam_obj: Float) -> Sequence[RefinerStep]:
        """The steps of :meth:`Refiner.refine` from the same pose; none where the object does not show."""
        ...


@runtime_checkable
class TrainedRefiner(Protocol):
    """A refiner that knows its range."""

    @property
    def trained_range(self) -> TrainedRange | None:
        """None where it is unknown."""
        ...
