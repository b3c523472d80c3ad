"""Whether a refiner starts within the range that it was trained on, and the same start brought into it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import axis_angle, rotation_vector, transform
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.refiner_steps import TrainedRange
from verefine_viz.evaluation.rotation_errors import symmetric_angles_rad


@dataclass(frozen=True, eq=False)
class Start:
    """How far a pose is from the nearest of the poses that look like the ground truth."""

    T_gt: Float
    """(4, 4) that pose [m]."""
    turn: Float
    """(3,) rotation vector from it to the start, camera frame [rad]."""
    shift_m: Float
    """(3,) the same of the object's middle [m]."""
    middle_obj: Float
    """(3,) middle of the model's bounding box, in its own frame [m]."""
    radius_m: float
    """Half of the diameter."""

    @property
    def rotation_deg(self) -> float:
        """Angle of the turn."""
        return float(np.rad2deg(np.linalg.norm(self.turn)))

    @property
    def shift_mm(self) -> float:
        """Length of the shift."""
        return 1e3 * float(np.linalg.norm(self.shift_m))

    def is_beyond(self, trained: TrainedRange) -> bool:
        """Whether the refiner was trained on no pose that is as far."""
        return self.rotation_deg > trained.rotation_deg or self.shift_mm > self.largest_shift_mm(trained)

    def largest_shift_mm(self, trained: TrainedRange) -> float:
        """The range for an object of this size."""
        return 1e3 * trained.shift_radii * self.radius_m

    def brought_within(self, trained: TrainedRange, share: float) -> Float:
        """The pose (4, 4) in the same direction, turned and shifted by no more than this share of the range."""
        shorter = min(1.0, share * trained.rotation_deg / max(self.rotation_deg, 1e-9))
        nearer = min(1.0, share * self.largest_shift_mm(trained) / max(self.shift_mm, 1e-9))
        R_gt, t_gt = self.T_gt[:3, :3], self.T_gt[:3, 3]
        angle = float(np.linalg.norm(self.turn))
        R = axis_angle(self.turn, shorter * angle) @ R_gt if angle > 0 else R_gt
        return transform(R, R_gt @ self.middle_obj + t_gt + nearer * self.shift_m - R @ self.middle_obj)


def start_of(model: ObjectModel, T_cam_obj: Float, T_gt: Float) -> Start:
    """How far a pose (4, 4) is from the ground truth (4, 4), over the model's declared symmetries."""
    T_alike = T_gt @ model.symmetries[int(np.argmin(symmetric_angles_rad(model, T_cam_obj, T_gt)))]
    middle = model.middle_m
    turn = rotation_vector(T_cam_obj[:3, :3] @ T_alike[:3, :3].T)
    shift_m = (T_cam_obj - T_alike)[:3, :3] @ middle + (T_cam_obj - T_alike)[:3, 3]
    return Start(T_alike, turn, shift_m, middle, model.diameter_m / 2)
