"""How good one answer is: the shares of BOP's thresholds that it passes, and its errors."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from pydantic import BaseModel, ConfigDict

from verefine_viz.core.arrays import Float
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.problem import Problem, Target
from verefine_viz.evaluation.errors import pose_errors
from verefine_viz.evaluation.model import EvalModel, eval_model
from verefine_viz.evaluation.pair_errors import Drawn, pair_errors
from verefine_viz.evaluation.recalls import average_recalls
from verefine_viz.evaluation.truth import Truth, TruthImage
from verefine_viz.evaluation.vsd import DELTA_MM


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
    instance, observation = target.instance, problem.observation
    truth = Truth(instance.instance_id, instance.obj_id, T_gt[:3, :3], T_gt[:3, 3] * 1e3, 1.0)
    image = TruthImage(observation.camera.K, observation.camera.width, observation.depth_m * np.float32(1e3), (truth,))
    estimate = T_est[:3, :3], T_est[:3, 3] * 1e3
    pair = pair_errors(Drawn(image), _model(target.model), [estimate], [truth], DELTA_MM)
    recalls = average_recalls(pair.kinds[:, 0])
    errors = pose_errors(target.model, T_est, T_gt)
    return Quality(
        ar_vsd=recalls.ar_vsd,
        ar_mssd=recalls.ar_mssd,
        ar_mspd=recalls.ar_mspd,
        add_s_mm=errors.add_s_mm,
        relative=errors.relative,
        rotation_deg=errors.rotation_deg,
        translation_mm=errors.translation_mm,
    )


@lru_cache(maxsize=64)
def _model(model: ObjectModel) -> EvalModel:
    return eval_model(model)
