"""What estimates are compared with: true poses, depth images and models, of a BOP folder or of problems in memory."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import InputError, unknown
from verefine_viz.core.json_files import (
    integer_of,
    key_of,
    number_of,
    numbers_of,
    position_of,
    read_json,
    read_numbered,
)
from verefine_viz.core.problem import Problem
from verefine_viz.evaluation.bop_model import EvalModel, EvalModels, eval_model
from verefine_viz.scenes.bop import BopDataset, instances_of
from verefine_viz.scenes.image_files import (
    check_deepest,
    depth_scale_of,
    find_image,
    image_width,
    intrinsics_of,
    read_steps,
)

# Which instances a score asks for: BOP's targets files, or every instance that is seen well enough.

Task = Literal["localization", "detection"]
"""localization: BOP'19 to '23, how many instances there are is known. detection: BOP'24, it is not."""


@dataclass(frozen=True)
class Targets:
    """What is asked for, images of a scene together, in the file's order."""

    name: str
    """Of the file, for people."""
    counts: Mapping[tuple[int, int], Mapping[int, int]]
    """(scene_id, im_id) → obj_id → instances; nothing is said about objects where the task is detection."""
    task: Task
    """The one that the file was made for."""
    is_official: bool = True
    """Whether the data set itself says what is asked for."""


def read_targets(path: Path) -> Targets:
    """A targets file; an image's object that is listed twice counts as it is listed last.

    Raises:
        InputError: it is missing or damaged, asks for nothing, or an entry lacks an id; the entry is named.
    """
    entries = read_json(path, list)
    if not entries:
        raise InputError(f"{path} lists no targets, expected [{{'scene_id': …, 'im_id': …, …}}, …]")
    key_of(entries[0], "scene_id", f"{path}, entry 0")
    task: Task = "localization" if "obj_id" in entries[0] else "detection"
    scenes: dict[int, dict[int, dict[int, int]]] = {}
    for k, entry in enumerate(entries):
        where = f"{path}, entry {k}"
        scene_id, im_id = integer_of(entry, "scene_id", where), integer_of(entry, "im_id", where)
        counts = scenes.setdefault(scene_id, {}).setdefault(im_id, {})
        if task == "localization":
            counts[integer_of(entry, "obj_id", where)] = instances_of(entry, where)
    if task == "localization" and not any(n for scene in scenes.values() for c in scene.values() for n in c.values()):
        raise InputError(f"{path} asks for no instance: every 'inst_count' is 0, expected 1 or more somewhere")
    images = {(scene_id, im_id): counts for scene_id, scene in scenes.items() for im_id, counts in scene.items()}
    return Targets(path.name, images, task)


def find_targets(dataset: Path, split: str, task: Task | None = None) -> Path:
    """The data set's targets file for a task, by default for localization where there is one.

    Raises:
        InputError: there is none.
    """
    found = targets_path(dataset, split, task)
    if found is None:
        there = ", ".join(sorted(p.name for p in dataset.glob("*targets*.json"))) or "none at all"
        names = " or ".join(_names(split, task))
        raise InputError(f"{dataset} has no {names} (targets files there: {there}); name one by --targets")
    return found


def targets_path(dataset: Path, split: str, task: Task | None = None) -> Path | None:
    """The same, None where there is none."""
    return next((dataset / name for name in _names(split, task) if os.path.lexists(dataset / name)), None)


def _names(split: str, task: Task | None) -> list[str]:
    years = {"localization": ("19",), "detection": ("24", "19"), None: ("19", "24")}[task]
    return [f"{split.split('_')[0]}_targets_bop{year}.json" for year in years]


VISIB_FRACT = 0.1
"""Instances that are less visible are no targets (BOP)."""


@dataclass(frozen=True, eq=False)
class Truth:
    """One instance of an image."""

    gt_id: int
    """Its place in the image's list."""
    obj_id: int
    R: Float
    """(3, 3) object to camera, with the file's digits."""
    t_mm: Float
    """(3,) [mm]."""
    visib_fract: float
    """Visible share of its silhouette."""


@dataclass(frozen=True, eq=False)
class TruthImage:
    """What is known about one image."""

    K: Float
    """(3, 3) camera matrix [px]."""
    width: int
    """[px]."""
    depth_mm: NDArray[np.float32] | None
    """(H, W) [mm], 0 where nothing was measured; None where it was not asked for."""
    truths: tuple[Truth, ...]


class TruthSource(Protocol):
    """Where truth comes from. Images may be asked for from several threads."""

    name: str
    """The data set's: itodd has its own tolerance, xyzibd its own limit of estimates."""

    def image(self, scene_id: int, im_id: int, with_depth: bool) -> TruthImage:
        """One image; InputError where it is missing or damaged."""
        ...

    def model(self, obj_id: int) -> EvalModel:
        """One model; InputError where it is missing or damaged."""
        ...

    @property
    def notes(self) -> tuple[str, ...]:
        """What a person should know about how far scores can be compared."""
        ...


class BopTruth:
    """The truth of a data set's split, read as the official toolkit reads it: no digit is changed.

    Raises:
        InputError: the data set has no models.
    """

    def __init__(self, dataset: BopDataset) -> None:
        self.name = dataset.name
        self._dataset = dataset
        self._models = EvalModels(dataset.folder)
        self._without_info: set[int] = set()
        self._scene = lru_cache(maxsize=4)(self._read_scene)

    def image(self, scene_id: int, im_id: int, with_depth: bool) -> TruthImage:
        folder, cameras, truths, infos = self._scene(scene_id)
        if im_id not in cameras:
            raise InputError(f"{folder / 'scene_camera.json'} has no image {im_id}, which the targets name")
        if im_id not in truths:
            raise InputError(f"{folder / 'scene_gt.json'} has no image {im_id}, which the targets name")
        where = f"{folder / 'scene_camera.json'}, image {im_id}"
        K = intrinsics_of(cameras[im_id], where)
        found = _truths(truths[im_id], infos, im_id, folder)
        if not with_depth:
            return TruthImage(K, _width(folder, im_id), None, found)
        path = find_image(folder / "depth", f"{im_id:06d}")
        if path is None:
            raise InputError(f"{folder / 'depth' / f'{im_id:06d}.png'} is missing; VSD needs the depth image")
        scale_mm = depth_scale_of(cameras[im_id], where)
        check_deepest(path, steps := read_steps(path), scale_mm)
        # The toolkit multiplies them in single precision.
        depth_mm = steps.astype(np.float32) * np.float32(scale_mm)
        return TruthImage(K, depth_mm.shape[1], depth_mm, found)

    def model(self, obj_id: int) -> EvalModel:
        return self._models.get(obj_id)

    def images(self) -> list[tuple[int, int]]:
        """Those of the split that have ground truth, (scene_id, im_id).

        Raises:
            InputError: a scene's files are damaged.
        """
        found: list[tuple[int, int]] = []
        for scene_id in self._dataset.scene_ids:
            if os.path.lexists(self._dataset.scene_folder(scene_id) / "scene_gt.json"):
                truths = self._scene(scene_id)[2]
                found += [(scene_id, i) for i in self._dataset.image_ids(scene_id) if i in truths]
        return found

    @property
    def notes(self) -> tuple[str, ...]:
        notes = [*self._models.notes]
        if self._without_info:
            scenes = ", ".join(map(str, sorted(self._without_info)))
            notes.append(f"scene {scenes} has no scene_gt_info.json; all its instances count as visible")
        return tuple(notes)

    def _read_scene(self, scene_id: int) -> tuple[Path, dict[int, Any], dict[int, Any], dict[int, Any] | None]:
        folder = self._dataset.scene_folder(scene_id)
        if not os.path.lexists(folder / "scene_gt.json"):
            raise InputError(f"{folder / 'scene_gt.json'} is missing; without ground truth there is nothing to score")
        info = folder / "scene_gt_info.json"
        has_info = os.path.lexists(info)
        if not has_info:
            self._without_info.add(scene_id)
        return (
            folder,
            read_numbered(folder / "scene_camera.json", "image"),
            read_numbered(folder / "scene_gt.json", "image"),
            read_numbered(info, "image") if has_info else None,
        )


class ProblemTruth:
    """The truth that problems carry, such as the built-in scenes; instances without a true pose are left out.

    Continuous symmetries are those of the problems' models, in coarser steps than the official ones.

    Raises:
        InputError: a frame occurs twice.
    """

    notes: tuple[str, ...] = ()

    def __init__(self, name: str, problems: Sequence[Problem]) -> None:
        self.name = name
        self._problems = {(p.scene_id, p.im_id): p for p in problems}
        if len(self._problems) < len(problems):
            raise InputError("a frame occurs twice among the problems; every scene/image can be scored once")
        models = {obj_id: model for p in problems for obj_id, model in p.models.items()}
        self._models = {obj_id: eval_model(model) for obj_id, model in models.items()}

    @property
    def targets(self) -> Targets:
        """Every instance that is at least 10 % visible."""
        return visible_targets(self, self._problems)

    def image(self, scene_id: int, im_id: int, with_depth: bool) -> TruthImage:
        if (scene_id, im_id) not in self._problems:
            frames = (f"{s}/{i}" for s, i in self._problems)
            raise InputError(unknown("frame", f"{scene_id}/{im_id}", frames))
        problem = self._problems[scene_id, im_id]
        truths = tuple(
            Truth(
                i.instance_id,
                i.obj_id,
                np.ascontiguousarray(i.T_cam_obj_gt[:3, :3]),
                i.T_cam_obj_gt[:3, 3] * 1e3,
                1.0 if i.visib_fract is None else i.visib_fract,
            )
            for i in problem.instances
            if i.T_cam_obj_gt is not None
        )
        camera = problem.observation.camera
        depth_mm = (problem.observation.depth_m * np.float32(1e3)).astype(np.float32) if with_depth else None
        return TruthImage(camera.K, camera.width, depth_mm, truths)

    def model(self, obj_id: int) -> EvalModel:
        if obj_id not in self._models:
            raise InputError(unknown("model", obj_id, self._models))
        return self._models[obj_id]


def visible_targets(truth: TruthSource, images: Iterable[tuple[int, int]]) -> Targets:
    """Every instance of some images, (scene_id, im_id), that is at least 10 % visible: how BOP chooses its targets.

    Raises:
        InputError: an image is missing or damaged.
    """
    counts = {
        image: dict(
            Counter(t.obj_id for t in truth.image(*image, with_depth=False).truths if t.visib_fract >= VISIB_FRACT)
        )
        for image in images
    }
    return Targets("all instances that are at least 10 % visible", counts, "localization", is_official=False)


def _truths(entries: Any, infos: dict[int, Any] | None, im_id: int, folder: Path) -> tuple[Truth, ...]:
    where = f"{folder / 'scene_gt.json'}, image {im_id}"
    if not isinstance(entries, list):
        raise InputError(f"{where} is a JSON {type(entries).__name__}, expected a list of instances")
    shares = [1.0] * len(entries)
    if infos is not None:
        place = f"{folder / 'scene_gt_info.json'}, image {im_id}"
        mine = infos.get(im_id)
        if not isinstance(mine, list) or len(mine) != len(entries):
            raise InputError(f"{place} does not describe the {len(entries)} instances of scene_gt.json one by one")
        shares = [number_of(info, "visib_fract", f"{place}, entry {k}") for k, info in enumerate(mine)]
    return tuple(
        Truth(
            k,
            integer_of(entry, "obj_id", f"{where}, entry {k}"),
            numbers_of(entry, "cam_R_m2c", 9, f"{where}, entry {k}").reshape(3, 3),
            position_of(entry, "cam_t_m2c", f"{where}, entry {k}"),
            shares[k],
        )
        for k, entry in enumerate(entries)
    )


def _width(folder: Path, im_id: int) -> int:
    """The image's width, from the header of whichever of its files is there."""
    found = (find_image(folder / kind, f"{im_id:06d}") for kind in ("rgb", "gray", "depth"))
    path = next((p for p in found if p is not None), None)
    if path is None:
        raise InputError(f"{folder} has no rgb, gray or depth image {im_id:06d}; its width is needed")
    return image_width(path)
