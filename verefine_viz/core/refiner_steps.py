"""What a refiner can say about itself: step by step, what it saw and answered, and the range that it was trained on.

Both are optional, for refiners of users' programs as well (docs/guide.md, "Your own refiner").
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import ShapeError
from verefine_viz.core.problem import Target
from verefine_viz.core.protocols import Refiner


@dataclass(frozen=True, eq=False)
class RefinerStep:
    """One step of a refiner.

    Raises:
        ShapeError: there are no crops, or they cannot be drawn side by side.
    """

    crops: Mapping[str, NDArray[np.float32] | NDArray[np.uint8]]
    """Images that it saw, by name, all of one size: numbers (H, W), NaN = none, or colours (H, W, 3)."""
    limits: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """Numbers drawn darkest and brightest, by name of a crop; without an entry, its smallest and largest number."""
    turn: Float = field(default_factory=lambda: np.zeros(3))
    """(3,) the answer's rotation vector [rad], in the frame of the crop: x right, y down, z away."""
    shift_m: Float = field(default_factory=lambda: np.zeros(3))
    """(3,) the answer's shift [m], in the same frame."""
    centre_px: Float | None = None
    """(2,) where the object's centre is in the crop: column, row; None = in the middle."""
    px_per_m: float = 0.0
    """Scale at the object's distance; 0 = the shift is not drawn to scale, only its number is shown."""
    points_px: Float | None = None
    """(n, 2) sampled points: column, row; None = it takes whole crops."""
    is_taken: bool = True
    """Whether the pose followed the answer."""
    expected_mm: float | None = None
    """Mean error of the object's points that it expects to remain [mm]; None = it does not say."""
    trained_mm: float | None = None
    """The largest such error that it was trained on [mm]."""
    confidence: float | None = None
    """The highest confidence of a point; None = it has none."""

    def __post_init__(self) -> None:
        shapes = {name: np.shape(crop) for name, crop in self.crops.items()}
        fits = all(len(shape) == 2 or (len(shape) == 3 and shape[2] == 3) for shape in shapes.values())
        if not fits or len({shape[:2] for shape in shapes.values()}) != 1:
            raise ShapeError(f"crops of a RefinerStep are {shapes}, expected at least one, all (H, W) or (H, W, 3)")
        for name, vector in (("turn", self.turn), ("shift_m", self.shift_m)):
            if np.shape(vector) != (3,):
                raise ShapeError(f"{name} of a RefinerStep is {np.shape(vector)}, expected (3,)")


@dataclass(frozen=True)
class TrainedRange:
    """Largest errors of a pose that a refiner was trained to correct."""

    rotation_deg: float
    """Largest rotation [deg]."""
    shift_radii: float
    """Largest shift of the object's middle, in halves of its diameter."""


@runtime_checkable
class LearnedRefiner(Refiner, Protocol):
    """A refiner that can say what it saw."""

    def explain(self, target: Target, T_cam_obj: Float) -> Sequence[RefinerStep]:
        """The steps of :meth:`Refiner.refine` from the same pose; none where the object does not show."""
        ...


@runtime_checkable
class TrainedRefiner(Refiner, Protocol):
    """A refiner that knows its range."""

    @property
    def trained_range(self) -> TrainedRange | None:
        """None where it is unknown."""
        ...
