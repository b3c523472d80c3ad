"""How much of what is asked for a results file speaks about, which images are its own, rows that cannot be right."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Literal

import numpy as np

from verefine_viz.core.geometry import RIGID_TOLERANCE
from verefine_viz.evaluation.pose_table import Image, PoseTable
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


@dataclass(frozen=True)
class OwnImages:
    """Images of the targets that a results file is about, where these are not all of them."""

    images: frozenset[Image]
    known_from: Literal["run", "file"]
    """run: the batch that wrote the file says which frames it covered. file: only that there is an estimate is known,
    and an image without one may also be one in which nothing was found."""


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


def own_images(table: PoseTable, targets: Targets, covered: Collection[Image] | None) -> OwnImages | None:
    """The images of ``targets`` that ``table`` is about; None where these are all of them, or none.

    Args:
        table: the estimates.
        targets: what is asked for.
        covered: images that the run says it covered; None = it says nothing.
    """
    about = set(table.by_image if covered is None else covered) & targets.counts.keys()
    if not about or len(about) == len(targets.counts):
        return None
    return OwnImages(frozenset(about), "file" if covered is None else "run")


def why_none(table: PoseTable, targets: Targets) -> str:
    """How a table misses everything that is asked for, for people: in its scenes, its images, or its objects."""
    mine, asked = ({scene_id for scene_id, _ in images} for images in (table.by_image, targets.counts))
    if not mine & asked:
        return f"it names {_listed('scene', mine)}, the targets {_listed('scene', asked)}"
    both = mine & asked
    mine, asked = ({im_id for s, im_id in images if s in both} for images in (table.by_image, targets.counts))
    common = table.by_image.keys() & targets.counts.keys()
    if not common:
        return f"in {_listed('scene', both)} it names {_listed('image', mine)}, the targets {_listed('image', asked)}"
    mine, asked = ({i for image in common for i in rows[image]} for rows in (table.by_image, targets.counts))
    return f"in images asked for it names {_listed('object', mine)}, the targets {_listed('object', asked)}"


def _listed(word: str, ids: Collection[int], most: int = 5) -> str:
    """``scenes 48, 49, 50, 51, 52, …``."""
    first = [*map(str, sorted(ids)[:most]), *(["…"] if len(ids) > most else [])]
    return f"{word}{'s' * (len(ids) > 1)} {', '.join(first)}"
