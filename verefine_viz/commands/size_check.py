"""Whether the objects of a data set appear as large as their models do in their true poses."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from heapq import nlargest

import numpy as np

from verefine_viz.calibration.camera_check import MOST, Verdict, compared, verdict
from verefine_viz.calibration.outlines import OutlineFit
from verefine_viz.core.arrays import Float, Mask
from verefine_viz.core.errors import VerefineError
from verefine_viz.core.model import ObjectModel
from verefine_viz.scenes.bop import BopDataset, MaskFolder


def object_sizes(dataset: BopDataset, sampled: Sequence[tuple[int, int]], kind: MaskFolder) -> Verdict:
    """What the masks in ``kind`` of these frames tell together; what cannot be read is said already."""
    fits: list[OutlineFit] = []
    for ids in sampled:
        with suppress(VerefineError):
            image = dataset.image(*ids)
            together = np.zeros(image.camera.shape, np.bool_)
            # A frame may hold thousands of instances, so no more masks are held than are looked at.
            largest = nlargest(MOST, _objects(dataset, ids, kind, together), lambda one: np.count_nonzero(one[2]))
            fits += compared(largest, image.camera, image.depth_m, together)
    return verdict(fits)


def _objects(
    dataset: BopDataset, ids: tuple[int, int], kind: MaskFolder, together: Mask
) -> Iterator[tuple[ObjectModel, Float, Mask]]:
    """Model, true pose and mask (H, W) of each instance of a frame of which all are known.

    Masks of all instances, also of others, are added to ``together`` (H, W).
    """
    for truth in dataset.ground_truth(*ids) or ():
        with suppress(VerefineError):
            mask = dataset.mask(*ids, truth.gt_id, kind, together.shape)
            together |= mask
            if mask.any() and truth.T_cam_obj is not None:
                yield dataset.models.get(truth.obj_id), truth.T_cam_obj, mask
