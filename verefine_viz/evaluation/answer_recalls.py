"""BOP recalls of a single answer: the shares of the thresholds of VSD, MSSD and MSPD that it passes.

The mean over many objects, 0 where one has no answer, is BOP's average recall with each answer matched to the object
that it is about, measured on the object's own mesh. Source: Hodan et al., BOP challenge 2019.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from msgspec import Struct

from verefine_viz.core.arrays import Float
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.observation import Observation
from verefine_viz.core.problem import Target
from verefine_viz.evaluation.averages import average_recalls
from verefine_viz.evaluation.bop_model import EvalModel, eval_model
from verefine_viz.evaluation.ground_truth import GtImage, GtInstance
from verefine_viz.evaluation.pair_errors import DrawnTruth, pair_errors
from verefine_viz.evaluation.vsd import DELTA_MM


class AnswerRecalls(Struct, frozen=True):
    """Shares of thresholds that an answer passes, 0 to 1."""

    ar_vsd: float = 0.0
    ar_mssd: float = 0.0
    ar_mspd: float = 0.0

    @property
    def ar(self) -> float:
        """Mean of the three."""
        return (self.ar_vsd + self.ar_mssd + self.ar_mspd) / 3


def answer_recalls(target: Target, T_est: Float, observation: Observation) -> AnswerRecalls:
    """Recalls of the answer ``T_est`` (4, 4) [m] for an object with ground truth.

    Args:
        target: the object.
        T_est: camera from object.
        observation: of the frame, whose depth says what is visible.
    """
    instance, T_gt = target.instance, target.instance.T_cam_obj_gt
    assert T_gt is not None
    gt = GtInstance(instance.instance_id, instance.obj_id, T_gt[:3, :3], T_gt[:3, 3] * 1e3, 1.0)
    image = GtImage(observation.camera.K, observation.camera.width, observation.depth_m * np.float32(1e3), (gt,))
    estimate = T_est[:3, :3], T_est[:3, 3] * 1e3
    pair = pair_errors(DrawnTruth(image), _model(target.model), [estimate], [gt], DELTA_MM)
    recalls = average_recalls(pair.kinds[:, 0])
    return AnswerRecalls(recalls.ar_vsd, recalls.ar_mssd, recalls.ar_mspd)


@lru_cache(maxsize=64)
def _model(model: ObjectModel) -> EvalModel:
    return eval_model(model)
