"""Visible masks of annotated instances from scene_gt_coco.json, for data sets without mask images."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import msgspec
import numpy as np
from scipy.optimize import linear_sum_assignment

from verefine_viz.core.arrays import Float, Mask
from verefine_viz.core.errors import InputError
from verefine_viz.core.files import read_json, sorted_out
from verefine_viz.core.number_kinds import Id, Real
from verefine_viz.scenes.annotations import GroundTruth
from verefine_viz.scenes.detections import mask_of

UNKNOWN_PX = 1e6
"""Distance between a box and an instance if either is unknown [px]."""


class Annotation(msgspec.Struct, frozen=True):
    """An instance that is at least partly visible; its ids are not those of scene_gt."""

    image_id: Id
    category_id: Id
    """obj_id."""
    bbox: tuple[Real, Real, Real, Real] | None = None
    """x, y, width, height [px]."""
    segmentation: msgspec.Raw = msgspec.Raw(b"null")


class Content(msgspec.Struct, frozen=True):
    """The file."""

    annotations: tuple[msgspec.Raw, ...]


class CocoMasks:
    """The masks of a scene's images; each is decoded when it is asked for.

    Args:
        path: scene_gt_coco.json.

    Raises:
        InputError: the file is damaged.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._annotations: dict[int, list[tuple[int, Annotation]]] = {}
        annotations, self._faults = sorted_out(read_json(path, Content).annotations, Annotation)
        for k, annotation in annotations:
            self._annotations.setdefault(annotation.image_id, []).append((k, annotation))

    def mask(self, im_id: int, gt_id: int, entries: Sequence[GroundTruth], K: Float, shape: tuple[int, int]) -> Mask:
        """The visible mask (H, W) of an instance; all False where nothing of it is visible.

        Args:
            im_id: BOP image.
            gt_id: the instance's index in ``entries``.
            entries: the image's ground truth.
            K: camera matrix (3, 3) [px] of the image.
            shape: (height, width) of the image.

        Raises:
            InputError: the file has no mask of a visible instance, or the mask is damaged or of another size.
        """
        annotations = self._annotations.get(im_id, [])
        owned = owners([annotation for _, annotation in annotations], entries, K)
        if gt_id in owned:
            k, annotation = annotations[owned[gt_id]]
            return mask_of(annotation.segmentation, shape, f"{self._path}, annotation {k}")
        visible = any(entry.visib_fract for entry in entries if entry.gt_id == gt_id)
        if visible or not annotations:
            damage = "".join(f"; annotation of {fault}" for fault in self._faults[:1])
            raise InputError(f"{self._path} has no mask of entry {gt_id} of image {im_id}{damage}")
        return np.zeros(shape, bool)


def owners(annotations: Sequence[Annotation], entries: Sequence[GroundTruth], K: Float) -> dict[int, int]:
    """The index of the annotation of each instance, by gt_id; instances without visible pixels have none.

    Annotations are in the order of the visible instances. Where these are unknown (scene_gt_info.json is missing), each
    annotation goes to the instance whose origin appears nearest to the middle of its box.
    """
    owned: dict[int, int] = {}
    for obj_id in {annotation.category_id for annotation in annotations}:
        mine = [k for k, annotation in enumerate(annotations) if annotation.category_id == obj_id]
        visible = [entry for entry in entries if entry.obj_id == obj_id and entry.visib_fract != 0]
        if len(mine) == len(visible):
            owned |= {entry.gt_id: k for entry, k in zip(visible, mine, strict=True)}
        elif visible:
            away_px = np.array([[_away_px(annotations[k], entry, K) for entry in visible] for k in mine])
            rows, columns = linear_sum_assignment(away_px)
            owned |= {visible[column].gt_id: mine[row] for row, column in zip(rows, columns, strict=True)}
    return owned


def _away_px(annotation: Annotation, entry: GroundTruth, K: Float) -> float:
    """How far the origin of an instance appears from the middle of an annotation's box [px]."""
    if annotation.bbox is None or entry.T_cam_obj is None or entry.T_cam_obj[2, 3] <= 0:
        return UNKNOWN_PX
    x, y, width, height = annotation.bbox
    u, v, _ = K @ (entry.T_cam_obj[:3, 3] / entry.T_cam_obj[2, 3])
    return min(float(np.hypot(u - x - width / 2, v - y - height / 2)), UNKNOWN_PX)
