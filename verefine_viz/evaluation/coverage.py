"""How much of what is asked for a results file speaks about, and rows in it that cannot be right."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from verefine_viz.core.geometry import RIGID_TOLERANCE
from verefine_viz.evaluation.pose_table import PoseTable
from verefine_viz.evaluation.targets import Targets


@dataclass(frozen=True)
class Coverage:
    """What of the targets a results file names at all, whatever its poses are worth."""

    images: int
    """Images of the targets with at least one estimate (localization: of an object that is asked for there)."""
    images_asked: int
    objects: int
    """Objects of the targets with at least one estimate in an image where they are asked for; detection: 0."""
    objects_asked: int
    not_finite: int
    """Rows with NaN or infinity in the pose: accepted by the official check, never right."""
    not_ranked: int
    """Rows whose score is NaN: accepted by the official check, but nobody knows which of several rows comes first."""
    not_rigid: int
    """Rows whose R is no rotation: accepted by the official check, errors are measured with R as it is."""

    @property
    def is_whole(self) -> bool:
        """Whether every image and every object has an estimate."""
        return self.images == self.images_asked and self.objects == self.objects_asked


def coverage(table: PoseTable, targets: Targets) -> Coverage:
    """What ``table`` says about ``targets``."""
    images, objects = 0, set[int]()
    for image, asked in targets.counts.items():
        there = table.by_image.get(image, {})
        found = asked.keys() & there.keys()
        images += bool(found) if targets.task == "localization" else bool(there)
        objects |= found
    finite = np.isfinite(table.R).all(axis=(1, 2)) & np.isfinite(table.t_mm).all(axis=1)
    R = table.R[finite]
    apart = np.abs(R.transpose(0, 2, 1) @ R - np.eye(3)).max(axis=(1, 2), initial=0.0)
    return Coverage(
        images,
        len(targets.counts),
        len(objects),
        len({obj_id for asked in targets.counts.values() for obj_id in asked}),
        int((~finite).sum()),
        int(np.isnan(table.scores).sum()),
        int(((apart > RIGID_TOLERANCE) | (np.linalg.det(R) < 0)).sum()),
    )
