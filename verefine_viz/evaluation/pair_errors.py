"""Computes all BOP errors of one object's estimates in an image against its instances; every pose is drawn once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.evaluation.bop_model import EvalModel
from verefine_viz.evaluation.ground_truth import GtImage, GtInstance
from verefine_viz.evaluation.vertex_errors import mspd_px, mssd_mm
from verefine_viz.evaluation.vsd import EMPTY, TAUS, DepthPatch, model_depth, spheres_overlap_in_image, vsd

NORMAL_WIDTH_PX = 640
"""MSPD is given for an image of this width [px]."""

Pose = tuple[Float, Float]
"""R (3, 3) and t (3,) [mm]."""


@dataclass(frozen=True, eq=False)
class PairErrors:
    """E estimates against G instances."""

    vsd: Float
    """(10, E, G) VSD in [0, 1] for each tolerance τ; 1 where it was not asked for."""
    mssd_mm: Float
    """(E, G) MSSD [mm]; infinite where the origins are a diameter apart."""
    mspd_px: Float
    """(E, G) MSPD [px of an image 640 wide]."""
    diameter_mm: float

    @property
    def kinds(self) -> Float:
        """(12, E, G): VSD for each τ, MSSD as a share of the diameter, MSPD."""
        return np.concatenate([self.vsd, [self.mssd_mm / self.diameter_mm, self.mspd_px]])


class DrawnTruth:
    """Ground-truth poses of one image, drawn when first needed and shared by several methods."""

    def __init__(self, image: GtImage) -> None:
        self.image = image
        self._patches: dict[int, DepthPatch] = {}

    def patch(self, model: EvalModel, gt: GtInstance) -> DepthPatch:
        """Depth of the model at ground truth."""
        if gt.gt_id not in self._patches:
            self._patches[gt.gt_id] = self.draw(model, (gt.R, gt.t_mm))
        return self._patches[gt.gt_id]

    def draw(self, model: EvalModel, pose: Pose) -> DepthPatch:
        """Depth of the model in a pose."""
        depth_mm = self.image.depth_mm
        return EMPTY if depth_mm is None else model_depth(model, *pose, self.image.K, depth_mm.shape)


def pair_errors(
    drawn: DrawnTruth, model: EvalModel, estimates: Sequence[Pose], instances: Sequence[GtInstance], delta_mm: float
) -> PairErrors:
    """Errors of all pairs, as the official scripts compute them, with their quick tests for pairs that cannot be near.

    Args:
        drawn: of the image; VSD is left out where it has no depth.
        model: of the object.
        estimates: E poses.
        instances: G of the object.
        delta_mm: tolerance of VSD's visibility [mm].
    """
    K, depth_mm = drawn.image.K, drawn.image.depth_mm
    n, m = len(estimates), len(instances)
    errors = PairErrors(np.ones((len(TAUS), n, m)), np.empty((n, m)), np.empty((n, m)), model.diameter_mm)
    scale = NORMAL_WIDTH_PX / drawn.image.width
    for e, (R, t_mm) in enumerate(estimates):
        patch = None
        for g, gt in enumerate(instances):
            pair = R, t_mm, gt.R, gt.t_mm
            near = np.linalg.norm(t_mm - gt.t_mm) < model.diameter_mm
            errors.mssd_mm[e, g] = mssd_mm(model, *pair) if near else np.inf
            errors.mspd_px[e, g] = scale * mspd_px(model, *pair, K)
            if depth_mm is not None and spheres_overlap_in_image(t_mm, gt.t_mm, model.diameter_mm):
                patch = drawn.draw(model, (R, t_mm)) if patch is None else patch
                gt_patch = drawn.patch(model, gt)
                errors.vsd[:, e, g] = vsd(depth_mm, patch, gt_patch, K, model.diameter_mm, delta_mm)
    return errors
