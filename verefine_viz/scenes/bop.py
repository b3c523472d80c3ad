"""A data set in BOP layout: images, cameras, ground truth, masks and targets of one split.

Foreign names stay here: ``cam_R_m2c``, ``cam_t_m2c`` [mm] become ``T_cam_obj`` [m].
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Literal, TypeVar

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float, Mask
from verefine_viz.core.camera import Camera
from verefine_viz.core.errors import InputError, ShapeError, in_one_line, unknown
from verefine_viz.core.files import Id, Numbered, Numbers3, Numbers3x3, Real, id_of, read_json
from verefine_viz.core.geometry import as_rigid, check_reach, transform
from verefine_viz.core.text_format import listed
from verefine_viz.scenes.image_files import (
    CameraEntry,
    depth_scale_of,
    find_image,
    intrinsics_notes,
    intrinsics_of,
    read_color,
    read_depth,
    read_mask,
    size_text,
)
from verefine_viz.scenes.models import ModelLibrary

MaskFolder = Literal["mask_visib", "mask"]
NO_COLOR = "the frame has no rgb or gray image; it is drawn without colour"
"""A note of images without; colour is optional."""
T = TypeVar("T")


class TruthEntry(msgspec.Struct, frozen=True):
    """An instance's entry in scene_gt.json."""

    obj_id: Id
    cam_R_m2c: Numbers3x3 | None = None
    cam_t_m2c: Numbers3 | None = None
    """[mm]."""


class InfoEntry(msgspec.Struct, frozen=True):
    """An instance's entry in scene_gt_info.json."""

    visib_fract: Real


class TargetEntry(msgspec.Struct, frozen=True):
    """An entry of a targets file; without an object where the task is detection (BOP'24)."""

    scene_id: Id
    im_id: Id
    obj_id: Id | None = None
    inst_count: Annotated[int, Meta(ge=0, le=100_000)] | None = None


@dataclass(frozen=True, eq=False)
class GroundTruth:
    """One entry of scene_gt."""

    gt_id: int
    """Its place in the image's list; second number of the mask files."""
    obj_id: int
    T_cam_obj: Float | None
    """(4, 4) [m]; None where the file's numbers are no pose, for the reason ``fault``."""
    visib_fract: float | None
    fault: str = ""


@dataclass(frozen=True, eq=False)
class BopImage:
    """One image, as the files have it."""

    camera: Camera
    depth_m: NDArray[np.float32]
    """(H, W) [m]; 0 = not measured."""
    rgb: NDArray[np.uint8] | None
    R_world_cam: Float | None
    """(3, 3) camera to world, where the data set knows it."""
    T_map_cam: Float | None
    """(4, 4) camera to world, where the data set knows that as well [m]."""
    notes: tuple[str, ...]


class BopDataset:
    """One split of a data set; files are read when asked for, JSON files and models once.

    Args:
        folder: the data set, with ``models/`` and the split's folder in it.
        split: test, train_real, test_primesense, …
        model_points: points to sample on each model.
        seed: of that sampling.

    Raises:
        InputError: the folder, the split or the models are not there.
    """

    def __init__(self, folder: Path | str, split: str, model_points: int = 2000, seed: int = 0) -> None:
        self.folder = Path(folder)
        self.split = split
        if not self.folder.is_dir():
            raise InputError(f"data set folder {self.folder} does not exist; set scene.dataset to a BOP folder")
        splits = [p.name for p in sorted(self.folder.iterdir()) if p.is_dir() and _scenes_in(p)]
        if split not in splits:
            raise InputError(f"{unknown('split', split, splits)} in {self.folder}{_meant(self.folder, split)}")
        self.models = ModelLibrary(self.folder, model_points, seed)
        self._scenes = _scenes_in(self.folder / split)
        self._cameras: dict[int, Numbered[CameraEntry]] = {}
        self._truths: dict[int, Numbered[tuple[TruthEntry, ...]] | None] = {}
        self._infos: dict[int, Numbered[tuple[InfoEntry, ...]] | None] = {}

    @property
    def name(self) -> str:
        """The folder's name: ycbv, lmo, …"""
        return in_one_line(self.folder.name)

    @property
    def scene_ids(self) -> tuple[int, ...]:
        return tuple(self._scenes)

    def scene_folder(self, scene_id: int) -> Path:
        """Where a scene's files are.

        Raises:
            InputError: no such scene, or two folders of it.
        """
        if scene_id not in self._scenes:
            raise InputError(f"{unknown('scene', scene_id, self._scenes)} in {self.folder / self.split}")
        folder, *others = self._scenes[scene_id]
        if others:
            raise InputError(f"{folder} and {others[0].name} are both scene {scene_id}; rename or remove one of them")
        return folder

    def image_ids(self, scene_id: int) -> tuple[int, ...]:
        """The images of a scene that scene_camera.json lists, in order.

        Raises:
            InputError: no such scene, or its scene_camera.json is missing or damaged.
        """
        return tuple(sorted(self.cameras(scene_id)))

    def cameras(self, scene_id: int) -> Numbered[CameraEntry]:
        """What a scene's scene_camera.json has for each image.

        Raises:
            InputError: no such scene, or the file is missing or damaged.
        """
        if scene_id not in self._cameras:
            path = self.scene_folder(scene_id) / "scene_camera.json"
            self._cameras[scene_id] = Numbered(path, CameraEntry, "image")
        return self._cameras[scene_id]

    def truths(self, scene_id: int) -> Numbered[tuple[TruthEntry, ...]] | None:
        """What a scene's scene_gt.json has for each image, None without one; as :meth:`cameras`."""
        if scene_id not in self._truths:
            self._truths[scene_id] = _if_there(self.scene_folder(scene_id) / "scene_gt.json", tuple[TruthEntry, ...])
        return self._truths[scene_id]

    def infos(self, scene_id: int) -> Numbered[tuple[InfoEntry, ...]] | None:
        """What a scene's scene_gt_info.json has for each image, None without one; as :meth:`cameras`."""
        if scene_id not in self._infos:
            path = self.scene_folder(scene_id) / "scene_gt_info.json"
            self._infos[scene_id] = _if_there(path, tuple[InfoEntry, ...])
        return self._infos[scene_id]

    def depth_file(self, scene_id: int, im_id: int) -> Path:
        """Where the depth image is.

        Raises:
            InputError: no such scene, or image.
        """
        folder = self.scene_folder(scene_id) / "depth"
        path = find_image(folder, f"{im_id:06d}")
        if path is None:
            raise InputError(f"{folder / f'{im_id:06d}.png'} is missing; a depth image is needed")
        return path

    def knows_up(self, scene_id: int) -> bool:
        """Whether the camera's rotation (``cam_R_w2c``) is known in any image of a scene.

        Raises:
            InputError: as :meth:`image_ids`.
        """
        cameras = self.cameras(scene_id)
        for im_id in cameras:
            with suppress(InputError):  # That image's own trouble.
                if cameras[im_id].cam_R_w2c is not None:
                    return True
        return False

    def has(self, scene_id: int, im_id: int) -> bool:
        """Whether the image is on the disk."""
        return scene_id in self._scenes and im_id in self.image_ids(scene_id)

    def check(self, scene_id: int, im_id: int) -> None:
        """Nothing, if the image exists.

        Raises:
            InputError: no such scene or image; the message lists what there is.
        """
        ids = self.image_ids(scene_id)
        if im_id not in ids:
            place = f"scene {scene_id} of {self.name}/{self.split}"
            raise InputError(f"unknown image {im_id} in {place}; available: {listed(ids)}")

    def image(self, scene_id: int, im_id: int) -> BopImage:
        """Camera, depth and colour of one image.

        Raises:
            InputError: it does not exist, or one of its files is missing or damaged.
        """
        self.check(scene_id, im_id)
        folder = self.scene_folder(scene_id)
        cameras = self.cameras(scene_id)
        entry, where = cameras[im_id], cameras.where(im_id)
        K, scale_mm = intrinsics_of(entry, where), depth_scale_of(entry, where)
        path = self.depth_file(scene_id, im_id)
        depth_m = read_depth(path, scale_mm)
        if not depth_m.any():
            raise InputError(f"{path} is 0 everywhere: the frame has no depth, nothing can be verified in it")
        rgb, notes = self._color(folder, im_id, depth_m.shape)
        notes += intrinsics_notes(K, depth_m.shape)
        if depth_m.max() < 0.05 or np.median(depth_m[depth_m > 0]) > 20:
            median_m = float(np.median(depth_m[depth_m > 0]))
            notes += (f"median depth is {median_m:.3g} m; check 'depth_scale' ({scale_mm:g} mm) in scene_camera.json",)
        try:
            camera = Camera(K, depth_m.shape[1], depth_m.shape[0])
        except ShapeError as error:
            raise InputError(f"{where}: {error}") from None
        R_world_cam = _R_world_cam(entry, where)
        return BopImage(camera, depth_m, rgb, R_world_cam, _T_map_cam(entry, R_world_cam), notes)

    def ground_truth(self, scene_id: int, im_id: int) -> tuple[GroundTruth, ...] | None:
        """The annotated instances of an image in the file's order; None where the data set has no scene_gt.

        Raises:
            InputError: scene_gt.json is damaged, or an entry has no obj_id.
        """
        truths, infos = self.truths(scene_id), self.infos(scene_id)
        if truths is None or im_id not in truths:
            return None
        entries, where = truths[im_id], truths.where(im_id)
        of_image = () if infos is None or im_id not in infos else infos[im_id]
        # Visible masks that were drawn, not rendered, may be larger than the rendered silhouette.
        visible = {k: min(max(info.visib_fract, 0.0), 1.0) for k, info in enumerate(of_image)}
        return tuple(
            _ground_truth(entry, gt_id, visible.get(gt_id), f"{where}, entry {gt_id}")
            for gt_id, entry in enumerate(entries)
        )

    def mask(self, scene_id: int, im_id: int, gt_id: int, kind: MaskFolder, shape: tuple[int, int]) -> Mask:
        """The mask (H, W) of one annotated instance.

        Raises:
            InputError: it is missing, damaged or of another size.
        """
        folder = self.scene_folder(scene_id) / kind
        stem = f"{im_id:06d}_{gt_id:06d}"
        if not folder.is_dir():
            other = "mask" if kind == "mask_visib" else "mask_visib"
            raise InputError(f"{folder} is missing; set scene.masks to {other!r} or to the path of a detections JSON")
        path = find_image(folder, stem)
        if path is None:
            raise InputError(f"{folder / f'{stem}.png'} is missing; add it, or set scene.masks to a detections JSON")
        return read_mask(path, shape)

    @cached_property
    def targets(self) -> Mapping[tuple[int, int], Mapping[int, int]] | None:
        """What the benchmark asks for, as :func:`target_counts` of the targets file; None without one.

        Of several it is that of BOP'19, which ``evaluate`` takes as well, else the newest.

        Raises:
            InputError: the file is damaged.
        """
        paths = sorted(self.folder.glob(f"{self.split.split('_')[0]}_targets_bop*.json"))
        return target_counts(max(paths, key=lambda path: (path.name.endswith("bop19.json"), path))) if paths else None

    def detection_files(self) -> tuple[str, ...]:
        """JSON files in the data set's folder that look like detections, for hints in errors."""
        paths = [*self.folder.glob("*detect*.json"), *self.folder.glob("*detect*.json.gz")]
        return tuple(sorted(p.name for p in paths))

    def _color(
        self, folder: Path, im_id: int, shape: tuple[int, ...]
    ) -> tuple[NDArray[np.uint8] | None, tuple[str, ...]]:
        path = find_image(folder / "rgb", f"{im_id:06d}") or find_image(folder / "gray", f"{im_id:06d}")
        if path is None:
            return None, (NO_COLOR,)
        rgb = read_color(path)
        if rgb.shape[:2] != shape:
            raise InputError(f"{path} is {size_text(rgb.shape)} pixels, but the depth image is {size_text(shape)}")
        return rgb, ()


def _if_there(path: Path, kind: type[T]) -> Numbered[T] | None:
    return Numbered(path, kind, "image") if os.path.lexists(path) else None


def target_counts(path: Path) -> dict[tuple[int, int], dict[int, int]]:
    """(scene, image) → object → instances of a targets file, in its order; an object listed twice counts as the last.

    Where the first entry names no object (BOP'24), none counts: all inner dictionaries are empty.

    Raises:
        InputError: the file is missing or damaged, or an entry lacks a number; the entry is named.
    """
    counts: dict[tuple[int, int], dict[int, int]] = {}
    entries = read_json(path, tuple[TargetEntry, ...])
    for k, entry in enumerate(entries):
        of_image = counts.setdefault((entry.scene_id, entry.im_id), {})
        if entries[0].obj_id is None:
            continue
        if entry.obj_id is None or entry.inst_count is None:
            raise InputError(f"{path}: entry {k} has no 'obj_id' or no 'inst_count', as the first one has")
        of_image[entry.obj_id] = entry.inst_count
    return counts


def _meant(folder: Path, split: str) -> str:
    """A hint where ``folder`` lies in the data set, or holds it; empty where neither is so."""
    below = [path for path in folder.iterdir() if path.is_dir()]
    near = [place for place in (*folder.resolve().parents[:2], *sorted(below)) if _scenes_in(place / split)]
    if len(near) > 1:
        return f"; data sets that have it: {listed(near)}; set scene.dataset to one of them"
    return f"; the data set is {near[0]}: set scene.dataset to it" if near else ""


def _scenes_in(folder: Path) -> dict[int, list[Path]]:
    """The folders of each scene by number: one each, unless two differ by the zeros in front."""
    scenes: dict[int, list[Path]] = {}
    for path in sorted(folder.iterdir()) if folder.is_dir() else ():
        scene_id = id_of(path.name)
        if scene_id is not None and path.is_dir():
            scenes.setdefault(scene_id, []).append(path)
    return dict(sorted(scenes.items()))


def pose_of(entry: TruthEntry, where: str) -> tuple[Float, Float]:
    """R (3, 3) and t (3,) [mm] of an entry of scene_gt.json, with the digits of the file.

    Raises:
        InputError: one of them is missing, or t is out of reach.
    """
    if entry.cam_R_m2c is None or entry.cam_t_m2c is None:
        raise InputError(f"{where} has no 'cam_R_m2c' or no 'cam_t_m2c'")
    try:
        check_reach(entry.cam_t_m2c * 1e-3, f"{where}: 'cam_t_m2c'")
    except ShapeError as error:
        raise InputError(str(error)) from None
    return entry.cam_R_m2c, entry.cam_t_m2c


def _R_world_cam(entry: CameraEntry, where: str) -> Float | None:
    if entry.cam_R_w2c is None:
        return None
    try:
        return as_rigid(transform(entry.cam_R_w2c, np.zeros(3)), f"{where}: 'cam_R_w2c'")[:3, :3].T
    except ShapeError as error:
        raise InputError(str(error)) from None


def _T_map_cam(entry: CameraEntry, R_world_cam: Float | None) -> Float | None:
    if R_world_cam is None or entry.cam_t_w2c is None:
        return None
    return transform(R_world_cam, -R_world_cam @ (entry.cam_t_w2c * 1e-3))


def _ground_truth(entry: TruthEntry, gt_id: int, visib_fract: float | None, where: str) -> GroundTruth:
    try:
        R, t_mm = pose_of(entry, where)
        pose = as_rigid(transform(R, t_mm * 1e-3), f"{where}: the pose")
    except (InputError, ShapeError) as error:
        return GroundTruth(gt_id, entry.obj_id, None, visib_fract, str(error))
    return GroundTruth(gt_id, entry.obj_id, pose, visib_fract)
