"""Whether the files of a data set that list an image's instances list the same ones."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import get_args

from verefine_viz.core.errors import VerefineError
from verefine_viz.core.jsonfile import id_of
from verefine_viz.scenes.bop import BopDataset, MaskFolder


def unequal_counts(dataset: BopDataset) -> tuple[str, ...]:
    """A sentence for each image of which other files list more or fewer instances than scene_gt.json does."""
    return tuple(fault for scene_id in dataset.scene_ids for fault in _of_scene(dataset, scene_id))


def _of_scene(dataset: BopDataset, scene_id: int) -> Iterator[str]:
    with suppress(VerefineError):  # A file that is damaged is a finding of its own.
        folder = dataset.scene_folder(scene_id)
        truths = _lengths(dataset, scene_id, "scene_gt.json")
        kinds = [kind for kind in sorted(get_args(MaskFolder)) if (folder / kind).is_dir()]
        others = {f"{kind}/": _masks(folder / kind) for kind in kinds}
        if os.path.lexists(folder / "scene_gt_info.json"):
            others = {"scene_gt_info.json": _lengths(dataset, scene_id, "scene_gt_info.json"), **others}
        for im_id, n in truths.items():
            wrong = [f"{found[im_id]} in {name}" for name, found in others.items() if found[im_id] != n]
            if wrong:
                yield f"image {scene_id}/{im_id}: {n} instances in scene_gt.json, {', '.join(wrong)}"


def _lengths(dataset: BopDataset, scene_id: int, name: str) -> Counter[int]:
    """How many entries a file has for each image."""
    content = dataset.of_images(scene_id, name)
    return Counter({im_id: len(entries) for im_id, entries in content.items() if isinstance(entries, list)})


def _masks(folder: Path) -> Counter[int]:
    """How many masks there are of each image; they are called image_instance.png."""
    stems = {path.stem for path in folder.iterdir()}
    return Counter(im_id for stem in stems if (im_id := id_of(stem.partition("_")[0])) is not None)
