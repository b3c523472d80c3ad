"""How good one answer is: the shares of BOP's thresholds that it passes, and its errors."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from pydantic import BaseModel, ConfigDict

from verefine_viz.core.arrays import Float
from verefine_viz.core.camera import Camera
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.problem import Problem, Target
from verefine_viz.evaluation.depth import model_depth
from verefine_viz.evaluation.errors import pose_errors
from verefine_viz.evaluation.largest import mspd_px, mssd_mm
from verefine_viz.evaluation.model import EvalModel, eval_model
from verefine_viz.evaluation.vsd import vsd

THRESHOLDS = np.arange(0.05, 0.51, 0.05)
"""For VSD, and as shares of the diameter for MSSD."""
THRESHOLDS_PX = np.arange(5.0, 51.0, 5.0)
"""For MSPD, in an image 640 wide."""


class Quality(BaseModel):
    """Of one object in one frame; an object without an answer fails everything."""

    model_config = ConfigDict(frozen=True)

    ar_vsd: float = 0.0
    ar_mssd: float = 0.0
    ar_mspd: float = 0.0
    add_s_mm: float | None = None
    relative: float | None = None
    """ADD(-S) as a share of the diameter."""
    rotation_deg: float | None = None
    translation_mm: float | None = None

    @property
    def ar(self) -> float:
        """Mean of the three recalls; over many objects, BOP's average recall."""
        return (self.ar_vsd + self.ar_mssd + self.ar_mspd) / 3


def quality(target: Target, T_est: Float | None, problem: Problem) -> Quality:
    """Of the answer ``T_est`` (4, 4) [m], or None. ``problem`` is the frame with all its depth, to see what is visible.

    Source: Hodan et al., BOP challenge 2019.
    """
    T_gt = target.instance.T_cam_obj_gt
    assert T_gt is not None, "studies keep objects with ground truth only"
    if T_est is None:
        return Quality()
    model, camera = _model(target.model), problem.observation.camera
    poses = T_est[:3, :3], T_est[:3, 3] * 1e3, T_gt[:3, :3], T_gt[:3, 3] * 1e3
    errors = pose_errors(target.model, T_est, T_gt)
    px = mspd_px(model, *poses, camera.K) * 640 / camera.width
    return Quality(
        ar_vsd=_recall(_vsd(model, poses, camera, problem), THRESHOLDS),
        ar_mssd=_recall(np.array([mssd_mm(model, *poses) / model.diameter_mm]), THRESHOLDS),
        ar_mspd=_recall(np.array([px]), THRESHOLDS_PX),
        add_s_mm=errors.add_s_mm,
        relative=errors.relative,
        rotation_deg=errors.rotation_deg,
        translation_mm=errors.translation_mm,
    )


def _vsd(model: EvalModel, poses: tuple[Float, Float, Float, Float], camera: Camera, problem: Problem) -> Float:
    R_est, t_est, R_gt, t_gt = poses
    estimate = model_depth(model, R_est, t_est, camera.K, camera.shape)
    truth = model_depth(model, R_gt, t_gt, camera.K, camera.shape)
    depth_mm = problem.observation.depth_m * np.float32(1e3)
    return vsd(depth_mm, estimate, truth, camera.K, model.diameter_mm)


def _recall(errors: Float, thresholds: Float) -> float:
    return float((errors[:, None] < thresholds).mean())


@lru_cache(maxsize=64)
def _model(model: ObjectModel) -> EvalModel:
    return eval_model(model)
