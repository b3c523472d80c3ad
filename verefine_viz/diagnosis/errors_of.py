"""The error of many poses of one instance, quickly."""

from __future__ import annotations

import numpy as np
from scipy.spatial import KDTree

from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import apply, inverse
from verefine_viz.core.model import ObjectModel


class ErrorOf:
    """ADD(-S) of poses of a model against one true pose, as a share of the diameter."""

    def __init__(self, model: ObjectModel, T_cam_obj_gt: Float) -> None:
        self._model = model
        self._truth = apply(T_cam_obj_gt, model.points)
        # The nearest estimated point is looked up in the model's frame, where one tree lasts for all poses.
        self._tree = KDTree(model.points) if model.is_symmetric else None

    def __call__(self, T_cam_obj: Float) -> float:
        """As :func:`verefine_viz.evaluation.errors.pose_errors` has it in ``relative``."""
        if self._tree is not None:
            distance_m = self._tree.query(apply(inverse(T_cam_obj), self._truth))[0]
        else:
            distance_m = np.linalg.norm(apply(T_cam_obj, self._model.points) - self._truth, axis=1)
        return float(np.mean(distance_m)) / self._model.diameter_m
