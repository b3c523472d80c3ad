"""Whether the files of a data set that list an image's instances list the same ones."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any, get_args

from verefine_viz.core.errors import VerefineError
from verefine_viz.core.jsonfile import read_json
from verefine_viz.scenes.bop import BopDataset, MaskFolder


def unequal_counts(dataset: BopDataset) -> tuple[str, ...]:
    """A sentence for each image of which other files list more or fewer instances than scene_gt.json does."""
    return tuple(fault for scene_id in dataset.scene_ids for fault in _of_scene(dataset, scene_id))


def _of_scene(dataset: BopDataset, scene_id: int) -> Iterator[str]:
    folder = dataset.scene_folder(scene_id)
    with suppress(VerefineError):  # A file that is damaged is a finding of its own.
        truths = _lengths(folder / "scene_gt.json")
        kinds = [kind for kind in sorted(get_args(MaskFolder)) if (folder / kind).is_dir()]
        others = {f"{kind}/": _masks(folder / kind) for kind in kinds}
        if (folder / "scene_gt_info.json").is_file():
            others = {"scene_gt_info.json": _lengths(folder / "scene_gt_info.json"), **others}
        for im_id, n in truths.items():
            wrong = [f"{found[im_id]} in {name}" for name, found in others.items() if found[im_id] != n]
            if wrong:
                yield f"image {scene_id}/{im_id}: {n} instances in scene_gt.json, {', '.join(wrong)}"


def _lengths(path: Path) -> Counter[int]:
    """How many entries a file has for each image."""
    content: dict[str, Any] = read_json(path, dict)
    return Counter({int(k): len(v) for k, v in content.items() if k.isdecimal() and isinstance(v, list)})


def _masks(folder: Path) -> Counter[int]:
    """How many masks there are of each image; they are called image_instance.png."""
    stems = {path.stem for path in folder.iterdir()}
    return Counter(int(image) for image in (stem.partition("_")[0] for stem in stems) if image.isdecimal())
