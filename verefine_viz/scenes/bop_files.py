"""Finds the files of a data set in BOP layout: splits, scenes, sensors, and hints at files beside a missing one."""

from __future__ import annotations

import difflib
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from verefine_viz.core.errors import InputError, one_line, unknown
from verefine_viz.core.files import id_of
from verefine_viz.core.text_format import first_of, listed
from verefine_viz.scenes.image_files import find_image

MaskFolder = Literal["mask_visib", "mask"]
LIKE = 0.8
"""Likeness of two names, by their letters alone, from which on one may be meant by the other."""
MOST_LIKE = 3
"""Most names beside a missing file that are shown."""
_CAMERAS = re.compile(r"scene_camera(?:_([\w.-]+))?\.json")
_ORDER = ("test", "train", "val")
"""Splits in the order in which they are tried; others follow."""


@dataclass(frozen=True)
class SceneFiles:
    """The files of one scene, under the names of one of its sensors where it has several (IPD, XYZ-IBD)."""

    folder: Path
    sensor: str = ""
    """cam1 for ``scene_camera_cam1.json``, ``depth_cam1/``, …; empty for the plain names."""

    def json(self, name: str) -> Path:
        """The path of scene_camera, scene_gt, scene_gt_info or scene_gt_coco."""
        return self.images(name).with_suffix(".json")

    def images(self, kind: str) -> Path:
        """The folder of rgb, gray, depth, mask or mask_visib."""
        return self.folder / (f"{kind}_{self.sensor}" if self.sensor else kind)

    def image(self, kind: str, *ids: int) -> Path | None:
        """An image, or the mask of an instance, whatever its format; None where it is missing."""
        return find_image(self.images(kind), _stem(ids))

    def expected(self, kind: str, *ids: int) -> Path:
        """The expected path of a missing image."""
        return self.images(kind) / f"{_stem(ids)}.png"

    @property
    def are_masks_listed(self) -> bool:
        """Whether scene_gt_coco.json has the visible masks, and no folder has any."""
        return (
            not self.images("mask_visib").is_dir()
            and not self.images("mask").is_dir()
            and self.json("scene_gt_coco").is_file()
        )

    def has_masks(self, kind: MaskFolder) -> bool:
        """Whether there are masks of a kind at all."""
        return self.images(kind).is_dir() or (kind == "mask_visib" and self.are_masks_listed)


def files_of_scene(folder: Path, sensor: str = "") -> SceneFiles:
    """The files of a scene.

    Args:
        folder: the scene's.
        sensor: which of its sensors; empty = the plain names, or where there are none, the first sensor that has ground
            truth, or at least depth.

    Raises:
        InputError: the scene has no such sensor; the message lists its sensors.
    """
    there = sensors_of(folder)
    if sensor and sensor not in there:
        if not any(there):
            raise InputError(f"{folder} has no sensor {sensor!r}, only files of plain names; leave scene.sensor empty")
        raise InputError(f"{unknown('sensor', sensor, filter(None, there))} in {folder}")
    if sensor or not there or "" in there:
        return SceneFiles(folder, sensor)
    files = [SceneFiles(folder, name) for name in there]
    return min(files, key=lambda f: (not f.json("scene_gt").exists(), not f.images("depth").is_dir(), f.sensor))


def sensors_of(scene: Path) -> tuple[str, ...]:
    """The sensors whose cameras a scene has, by name; the empty one is that of plain names."""
    named = (_CAMERAS.fullmatch(path.name) for path in scene.glob("scene_camera*.json"))
    return tuple(sorted(match[1] or "" for match in named if match))


def scenes_in(split: Path) -> dict[int, list[Path]]:
    """The folders of each scene by number: one each, unless two differ by the zeros in front."""
    scenes: dict[int, list[Path]] = {}
    for path in _folders_in(split):
        if (scene_id := id_of(path.name)) is not None:
            scenes.setdefault(scene_id, []).append(path)
    return dict(sorted(scenes.items()))


def splits_in(folder: Path) -> tuple[str, ...]:
    """The folders of a data set that hold scenes, by name."""
    return tuple(path.name for path in _folders_in(folder) if scenes_in(path))


def splits_to_open(folder: Path) -> tuple[str, ...]:
    """The splits of a data set with a scene that lists its images, in the order to try: with ground truth first, then
    test.

    None for a folder whose scenes list no images, or that holds no data.
    """
    splits = {path.parent.parent.name for path in folder.glob("*/[0-9]*/scene_camera*.json")}
    ranks = {name: next((k for k, first in enumerate(_ORDER) if name.startswith(first)), 9) for name in splits}
    return tuple(sorted(splits, key=lambda name: (not has_truth(folder / name), ranks[name], name)))


def has_truth(split: Path) -> bool:
    """Whether any scene of a split has ground truth."""
    folders = (folder for folders in scenes_in(split).values() for folder in folders)
    return any(files_of_scene(folder).json("scene_gt").exists() for folder in folders)


@dataclass(frozen=True)
class Inside:
    """A folder within a data set: a split, or a scene of one."""

    dataset: Path
    split: str
    scene_id: int | None
    """None for a split."""


def inside_dataset(folder: Path) -> Inside | None:
    """The place of a folder within a data set; None where it is neither a split nor a scene with images."""
    places: list[Inside] = []
    for path in (folder.absolute(), folder.resolve()):  # A link may lead out of the data set, or into it.
        if sensors_of(path) and (scene_id := id_of(path.name)) is not None:
            places.append(Inside(path.parent.parent, path.parent.name, scene_id))
        elif any(map(sensors_of, path.glob("[0-9]*"))):
            places.append(Inside(path.parent, path.name, None))
    with_models = [one for one in places if has_models(one.dataset)]
    return next(iter((*with_models, *places)), None)


def datasets_below(folder: Path) -> tuple[Path, ...]:
    """The data sets that lie directly in a folder."""
    return tuple(path for path in _folders_in(folder) if splits_in(path))


def has_models(dataset: Path) -> bool:
    """Whether a data set's folder has a folder of object models."""
    return any(dataset.glob("models*"))


def _folders_in(folder: Path) -> list[Path]:
    """The folders in a folder; none where it is not a folder, or cannot be read."""
    try:
        return sorted(path for path in folder.iterdir() if path.is_dir())
    except OSError:
        return []


def meant_dataset(folder: Path, split: str) -> str:
    """A hint where a folder without a split lies in the data set, or holds it; else empty."""
    near = [place for place in (*folder.resolve().parents[:2], *_folders_in(folder)) if scenes_in(place / split)]
    if len(near) > 1:
        return f"; data sets that have it: {listed(near)}; set scene.dataset to one of them"
    return f"; the data set is {near[0]}: set scene.dataset to it" if near else ""


def nearby_hint(path: Path) -> str:
    """A hint at names beside a missing file, or beside its missing folder, that may be meant; else empty."""
    if not path.parent.is_dir():
        return "" if path.parent == path else nearby_hint(path.parent)
    try:
        names = sorted(other.name for other in path.parent.iterdir() if not other.name.startswith("."))
    except OSError:
        return ""
    like = [one_line(name) for name in names if _is_like(name, path.name)]
    return f"; in {one_line(path.parent.name)}/ there is {first_of(like, MOST_LIKE)}" if like else ""


def _is_like(name: str, wanted: str) -> bool:
    """Whether two names have the same numbers or, without numbers, nearly the same letters; endings hardly count."""
    stem, wanted_stem = name.partition(".")[0], wanted.partition(".")[0]
    if numbers := _numbers(wanted_stem):
        return _numbers(stem) == numbers
    letters, wanted_letters = (re.sub(r"[^a-z]", "", text.lower()) for text in (stem, wanted_stem))
    return difflib.SequenceMatcher(None, letters, wanted_letters).ratio() >= LIKE


def _numbers(text: str) -> list[int]:
    return [int(digits) for digits in re.findall(r"\d{1,18}", text)]


def _stem(ids: tuple[int, ...]) -> str:
    return "_".join(f"{number:06d}" for number in ids)
