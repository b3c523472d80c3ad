"""Whether the objects of a data set appear as large as their models do in their true poses."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress

import numpy as np

from verefine_viz.calibration.camera_check import Verdict, compared, verdict
from verefine_viz.calibration.outlines import OutlineFit
from verefine_viz.core.arrays import Float, Mask
from verefine_viz.core.errors import VerefineError
from verefine_viz.core.model import ObjectModel
from verefine_viz.scenes.bop import BopDataset, GroundTruth, MaskFolder


def object_sizes(dataset: BopDataset, sampled: Sequence[tuple[int, int]], kind: MaskFolder) -> Verdict:
    """What the masks in ``kind`` of these frames tell together; what cannot be read is said already."""
    fits: list[OutlineFit] = []
    for ids in sampled:
        with suppress(VerefineError):
            image = dataset.image(*ids)
            shape = image.camera.shape
            masks = [(truth, _mask(dataset, ids, truth, kind, shape)) for truth in dataset.ground_truth(*ids) or ()]
            objects = [_posed(dataset, truth, mask) for truth, mask in masks if mask.any()]
            together = np.any([mask for _, mask in masks], axis=0)
            known = [one for one in objects if one is not None]
            fits += compared(known, image.camera, image.depth_m, together)
    return verdict(fits)


def _mask(
    dataset: BopDataset, ids: tuple[int, int], truth: GroundTruth, kind: MaskFolder, shape: tuple[int, int]
) -> Mask:
    """The mask (H, W) of an instance, empty where it cannot be read."""
    with suppress(VerefineError):
        return dataset.mask(*ids, truth.gt_id, kind, shape)
    return np.zeros(shape, np.bool_)


def _posed(dataset: BopDataset, truth: GroundTruth, mask: Mask) -> tuple[ObjectModel, Float, Mask] | None:
    """The model of an instance in its true pose; None where one of them is not known."""
    with suppress(VerefineError):
        if truth.T_cam_obj is not None:
            return dataset.models.get(truth.obj_id), truth.T_cam_obj, mask
    return None
