"""Ground truth that estimates are compared with: poses, depth images and models of a BOP folder or of problems."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import InputError, ShapeError, unknown
from verefine_viz.core.geometry import as_rigid, rounding_note, transform
from verefine_viz.core.problem import Problem
from verefine_viz.core.text_format import unusable
from verefine_viz.evaluation.bop_model import EvalModel, EvalModels, eval_model
from verefine_viz.scenes.annotations import (
    Task,
    TruthEntry,
    object_of,
    pose_of,
    target_counts,
    targets_names,
    targets_path,
)
from verefine_viz.scenes.bop import BopDataset
from verefine_viz.scenes.bop_files import SceneFiles, nearby_hint
from verefine_viz.scenes.image_files import depth_scale_of, image_width, intrinsics_of, read_steps


@dataclass(frozen=True)
class Targets:
    """What is asked for, images of a scene together, in the file's order."""

    name: str
    """Name of the file."""
    counts: Mapping[tuple[int, int], Mapping[int, int]]
    """(scene_id, im_id) → obj_id → instances; without objects where the task is detection."""
    task: Task
    """The one that the file was made for."""
    is_official: bool = True
    """Whether they are those of a targets file."""


def read_targets(path: Path) -> Targets:
    """A targets file; an image's object that is listed twice counts as it is listed last.

    Raises:
        InputError: it is missing or damaged, asks for nothing, or an entry lacks an id; the entry is named.
    """
    counts = target_counts(path)
    if not counts:
        raise InputError(f"{path} lists no targets, expected [{{'scene_id': …, 'im_id': …, …}}, …]")
    task: Task = "localization" if any(counts.values()) else "detection"
    if task == "localization" and not any(n for of_image in counts.values() for n in of_image.values()):
        raise InputError(f"{path} asks for no instance: every 'inst_count' is 0, expected 1 or more somewhere")
    scenes = list(dict.fromkeys(scene_id for scene_id, _ in counts))
    images = sorted(counts, key=lambda image: scenes.index(image[0]))
    return Targets(path.name, {image: counts[image] for image in images}, task)


def find_targets(dataset: Path, split: str, task: Task | None = None) -> Path:
    """The data set's targets file for a task, by default for localization where there is one.

    Raises:
        InputError: there is none.
    """
    path = targets_path(dataset, split, task)
    if path is None:
        there = ", ".join(sorted(p.name for p in dataset.glob("*targets*.json"))) or "none at all"
        names = " or ".join(targets_names(split, task))
        raise InputError(f"{dataset} has no {names} (targets files there: {there}); name one by --targets")
    return path


VISIB_FRACT = 0.1
"""Least visible share of an instance that is a target (BOP)."""


@dataclass(frozen=True, eq=False)
class GtInstance:
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
class GtImage:
    """One image."""

    K: Float
    """(3, 3) camera matrix [px]."""
    width: int
    """[px]."""
    depth_mm: NDArray[np.float32] | None
    """(H, W) [mm], 0 where nothing was measured; None where it was not asked for."""
    instances: tuple[GtInstance, ...]


class GtSource(Protocol):
    """Where ground truth comes from. Images may be asked for from several threads."""

    name: str
    """The data set's: itodd has its own tolerance, xyzibd its own limit of estimates."""

    def image(self, scene_id: int, im_id: int, with_depth: bool) -> GtImage:
        """One image; InputError where it is missing or damaged."""
        ...

    def model(self, obj_id: int) -> EvalModel:
        """One model; InputError where it is missing or damaged."""
        ...

    @property
    def notes(self) -> tuple[str, ...]:
        """How far scores can be compared with others."""
        ...


class BopGroundTruth:
    """The ground truth of a data set's split, as the official toolkit reads it: no digit is changed, also where R is
    rounded. An instance whose numbers are no pose (``core.geometry.as_rigid``) is left out, as the toolkit would score
    nonsense for it.

    Raises:
        InputError: the data set has no models.
    """

    def __init__(self, dataset: BopDataset) -> None:
        self.name = dataset.name
        self._dataset = dataset
        self._models = EvalModels(dataset.folder)
        self._without_info: set[int] = set()
        self._at_camera: dict[str, str] = {}
        """Instances within whose own size the camera would be, each with its distance."""
        self._left_out: dict[tuple[int, int, int], str] = {}
        """By scene, image and entry what is wrong with an instance."""
        self._rotations: dict[tuple[int, int, int], Float] = {}

    def image(self, scene_id: int, im_id: int, with_depth: bool) -> GtImage:
        files = self._dataset.files(scene_id)
        cameras, truths = self._dataset.cameras(scene_id), self._dataset.truths(scene_id)
        if truths is None:
            path = files.json("scene_gt")
            raise InputError(f"{path} is missing; without ground truth there is nothing to score{nearby_hint(path)}")
        for name, entries in (("scene_camera", cameras), ("scene_gt", truths)):
            if im_id not in entries:
                raise InputError(f"{files.json(name)} has no image {im_id}, which the targets name")
        camera, where = cameras[im_id], cameras.where(im_id)
        K, instances = intrinsics_of(camera, where), self._instances(scene_id, im_id)
        if not with_depth:
            return GtImage(K, _width(files, im_id), None, instances)
        scale_mm = depth_scale_of(camera, where)
        # The toolkit multiplies them in single precision.
        steps = read_steps(self._dataset.depth_file(scene_id, im_id), scale_mm)
        depth_mm = steps.astype(np.float32) * np.float32(scale_mm)
        return GtImage(K, depth_mm.shape[1], depth_mm, instances)

    def model(self, obj_id: int) -> EvalModel:
        return self._models.get(obj_id)

    def images(self) -> list[tuple[int, int]]:
        """Images of the split that have ground truth, (scene_id, im_id).

        Raises:
            InputError: a scene's files are damaged.
        """
        images: list[tuple[int, int]] = []
        for scene_id in self._dataset.scene_ids:
            if (with_truth := self._dataset.truths(scene_id)) is not None:
                images += [(scene_id, i) for i in self._dataset.image_ids(scene_id) if i in with_truth]
        return images

    @property
    def notes(self) -> tuple[str, ...]:
        notes = [*self._models.notes]
        faults = [self._left_out[key] for key in sorted(self._left_out)]
        name, use = f"the ground truth of {self.name}", "errors are measured with them as they are written"
        left_out = (
            f"{note}; scores over the others are no official ones" for note in unusable("instance", name, faults)
        )
        notes += (*left_out, *rounding_note(name, self._rotations.values(), use))
        if self._without_info:
            scenes = ", ".join(map(str, sorted(self._without_info)))
            notes.append(f"scene {scenes} has no scene_gt_info.json; all its instances count as visible")
        if self._at_camera:
            where, distance = min(self._at_camera.items())
            n = f"{len(self._at_camera)} instance{'s' * (len(self._at_camera) > 1)}"
            notes.append(
                f"the camera would be inside the object by the ground truth of {n}, as in {where}: {distance} away; "
                "expected 'cam_t_m2c' in millimetres"
            )
        return tuple(notes)

    def _instances(self, scene_id: int, im_id: int) -> tuple[GtInstance, ...]:
        """Instances of an image with a pose; all count as visible where the scene has no scene_gt_info.json."""
        truths, infos = self._dataset.truths(scene_id), self._dataset.infos(scene_id)
        assert truths is not None
        entries, where = truths[im_id], truths.where(im_id)
        shares: list[float | None] = [1.0] * len(entries)
        if infos is None:
            self._without_info.add(scene_id)
        else:
            shares = [info.share for info in infos[im_id]] if im_id in infos else []
        if len(shares) != len(entries):
            raise InputError(
                f"{self._dataset.files(scene_id).json('scene_gt_info')}, image {im_id} does not describe the "
                f"{len(entries)} instances of scene_gt.json one by one"
            )
        instances: list[GtInstance] = []
        for k, (entry, visib_fract) in enumerate(zip(entries, shares, strict=True)):
            if entry.is_without_pose:
                continue
            try:
                instances.append(_instance(k, entry, visib_fract, f"{where}, entry {k}"))
            except (InputError, ShapeError) as error:
                self._left_out[scene_id, im_id, k] = str(error)
        self._rotations |= {(scene_id, im_id, gt.gt_id): gt.R for gt in instances}
        for gt in instances:
            with suppress(InputError):  # Models are missing only where they are asked for.
                distance_mm = float(np.linalg.norm(gt.t_mm))
                if distance_mm < self._models.diameter_mm(gt.obj_id) / 2:
                    self._at_camera[f"{where}, entry {gt.gt_id}"] = f"{distance_mm:.3g} mm"
        return tuple(instances)


def _instance(k: int, entry: TruthEntry, visib_fract: float | None, where: str) -> GtInstance:
    R, t_mm = pose_of(entry, where)
    if visib_fract is None:
        raise InputError(f"{where} has no 'visib_fract' in scene_gt_info.json")
    as_rigid(transform(R, t_mm), f"{where}: the pose")
    return GtInstance(k, object_of(entry, where), R, t_mm, visib_fract)


class ProblemGroundTruth:
    """The ground truth of problems, such as the built-in scenes; instances without are left out.

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

    def image(self, scene_id: int, im_id: int, with_depth: bool) -> GtImage:
        if (scene_id, im_id) not in self._problems:
            frames = (f"{s}/{i}" for s, i in self._problems)
            raise InputError(unknown("frame", f"{scene_id}/{im_id}", frames))
        problem = self._problems[scene_id, im_id]
        instances = tuple(
            GtInstance(
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
        return GtImage(camera.K, camera.width, depth_mm, instances)

    def model(self, obj_id: int) -> EvalModel:
        if obj_id not in self._models:
            raise InputError(unknown("model", obj_id, self._models))
        return self._models[obj_id]


def visible_targets(ground_truth: GtSource, images: Iterable[tuple[int, int]]) -> Targets:
    """Every instance of some images, (scene_id, im_id), that is at least 10 % visible: how BOP chooses its targets.

    Raises:
        InputError: an image is missing or damaged.
    """
    counts: dict[tuple[int, int], dict[int, int]] = {}
    for image in images:
        instances = ground_truth.image(*image, with_depth=False).instances
        counts[image] = dict(Counter(gt.obj_id for gt in instances if gt.visib_fract >= VISIB_FRACT))
    return Targets("all instances that are at least 10 % visible", counts, "localization", is_official=False)


def _width(files: SceneFiles, im_id: int) -> int:
    """The image's width, from the header of whichever of its files is there."""
    path = next(filter(None, (files.image(kind, im_id) for kind in ("rgb", "gray", "depth"))), None)
    if path is None:
        raise InputError(f"{files.folder} has no rgb, gray or depth image {im_id:06d}; its width is needed")
    return image_width(path)
