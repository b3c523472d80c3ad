"""Errors of a pose against ground truth, and the error below which it counts as correct."""

from __future__ import annotations

from dataclasses import dataclass

CORRECT = 0.1
"""A pose with ADD(-S) below this share of the diameter counts as correct (Hinterstoisser 2012)."""


@dataclass(frozen=True)
class PoseErrors:
    """How far an estimate is from ground truth."""

    rotation_deg: float
    """Angle to the nearest of the poses that look the same [deg]."""
    translation_mm: float
    """Distance of the object's origin [mm]."""
    add_mm: float
    """Mean distance of corresponding model points [mm] (Hinterstoisser 2012)."""
    adds_mm: float
    """Mean distance of ground-truth points to the nearest estimated point [mm] (Xiang 2018)."""
    add_s_mm: float
    """ADD-S for symmetric objects, ADD for the others [mm]: the usual ADD(-S)."""
    relative: float
    """ADD(-S) as a share of the diameter."""

    @property
    def is_correct(self) -> bool:
        """Whether the pose counts as correct: :data:`CORRECT`."""
        return self.relative < CORRECT
