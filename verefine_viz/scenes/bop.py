"""A data set in BOP layout: images, cameras, ground truth, masks and targets of one split.

Foreign names stay here: ``cam_R_m2c``, ``cam_t_m2c`` [mm] become ``T_cam_obj`` [m].
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float, Mask
from verefine_viz.core.camera import Camera
from verefine_viz.core.errors import InputError, ShapeError, unknown
from verefine_viz.core.geometry import as_rigid, transform
from verefine_viz.core.json_files import (
    id_of,
    integer_of,
    number_of,
    numbers_of,
    position_of,
    read_json,
    read_numbered,
)
from verefine_viz.core.text_format import listed
from verefine_viz.scenes.image_files import (
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
MOST_INSTANCES = 100_000
"""Of an object in an image that a targets file may ask for."""


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
        self._json: dict[Path, dict[int, Any]] = {}

    @property
    def name(self) -> str:
        """The folder's name: ycbv, lmo, …"""
        return self.folder.name

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
        return tuple(sorted(self.of_images(scene_id, "scene_camera.json")))

    def of_images(self, scene_id: int, name: str) -> dict[int, Any]:
        """What a scene's scene_camera.json, scene_gt.json or scene_gt_info.json has for each image.

        Raises:
            InputError: no such scene, or the file is missing or damaged.
        """
        path = self.scene_folder(scene_id) / name
        if path not in self._json:
            self._json[path] = read_numbered(path, "image")
        return self._json[path]

    def instances(self, scene_id: int, im_id: int, name: str) -> list[Any] | None:
        """What scene_gt.json or scene_gt_info.json lists for an image; None without such a file, or image in it.

        Raises:
            InputError: no such scene, or the file is damaged.
        """
        path = self.scene_folder(scene_id) / name
        content = self.of_images(scene_id, name) if os.path.lexists(path) else {}
        if im_id not in content:
            return None
        entries = content[im_id]
        if not isinstance(entries, list):
            raise InputError(f"{path}, image {im_id} is a JSON {type(entries).__name__}, expected a list of instances")
        return entries

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
        entries = self.of_images(scene_id, "scene_camera.json").values()
        return any(isinstance(entry, dict) and "cam_R_w2c" in entry for entry in entries)

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
        where = f"{folder / 'scene_camera.json'}, image {im_id}"
        entry = self.of_images(scene_id, "scene_camera.json")[im_id]
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
        return BopImage(camera, depth_m, rgb, R_world_cam, _T_map_cam(entry, R_world_cam, where), notes)

    def ground_truth(self, scene_id: int, im_id: int) -> tuple[GroundTruth, ...] | None:
        """The annotated instances of an image in the file's order; None where the data set has no scene_gt.

        Raises:
            InputError: scene_gt.json is damaged, or an entry has no obj_id.
        """
        entries = self.instances(scene_id, im_id, "scene_gt.json")
        if entries is None:
            return None
        visible = self._visible_shares(scene_id, im_id)
        where = f"{self.scene_folder(scene_id) / 'scene_gt.json'}, image {im_id}"
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
        """What the benchmark asks for, as :func:`target_counts` of the first targets file; None without one.

        Raises:
            InputError: the file is damaged.
        """
        paths = sorted(self.folder.glob(f"{self.split.split('_')[0]}_targets_bop*.json"))
        return target_counts(paths[0]) if paths else None

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

    def _visible_shares(self, scene_id: int, im_id: int) -> dict[int, float]:
        entries = self.instances(scene_id, im_id, "scene_gt_info.json") or []
        where = f"{self.scene_folder(scene_id) / 'scene_gt_info.json'}, image {im_id}"
        shares = (number_of(entry, "visib_fract", f"{where}, entry {k}") for k, entry in enumerate(entries))
        # Visible masks that were drawn, not rendered, may be larger than the rendered silhouette.
        return {k: min(max(share, 0.0), 1.0) for k, share in enumerate(shares)}


def target_counts(path: Path) -> dict[tuple[int, int], dict[int, int]]:
    """(scene, image) → object → instances of a targets file, in its order; an object listed twice counts as the last.

    Where the first entry names no object (BOP'24), none counts: all inner dictionaries are empty.

    Raises:
        InputError: the file is missing or damaged, or an entry lacks a number; the entry is named.
    """
    counts: dict[tuple[int, int], dict[int, int]] = {}
    entries = read_json(path, list)
    for k, entry in enumerate(entries):
        where = f"{path}, entry {k}"
        of_image = counts.setdefault((integer_of(entry, "scene_id", where), integer_of(entry, "im_id", where)), {})
        if "obj_id" in entries[0]:
            of_image[integer_of(entry, "obj_id", where)] = _instances(entry, where)
    return counts


def _instances(entry: Any, where: str) -> int:
    n = integer_of(entry, "inst_count", where)
    if not 0 <= n <= MOST_INSTANCES:
        raise InputError(f"{where}: 'inst_count' is {n}, expected 0 or more instances, up to {MOST_INSTANCES}")
    return n


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


def pose_of(entry: Any, where: str) -> tuple[Float, Float]:
    """R (3, 3) and t (3,) [mm] of an entry of scene_gt.json, with the digits of the file.

    Raises:
        InputError: a number is missing, or too large.
    """
    return numbers_of(entry, "cam_R_m2c", 9, where).reshape(3, 3), position_of(entry, "cam_t_m2c", where)


def _R_world_cam(entry: dict[str, Any], where: str) -> Float | None:
    if "cam_R_w2c" not in entry:
        return None
    R_cam_world = numbers_of(entry, "cam_R_w2c", 9, where).reshape(3, 3)
    try:
        return as_rigid(transform(R_cam_world, np.zeros(3)), f"{where}: 'cam_R_w2c'")[:3, :3].T
    except ShapeError as error:
        raise InputError(str(error)) from None


def _T_map_cam(entry: dict[str, Any], R_world_cam: Float | None, where: str) -> Float | None:
    if R_world_cam is None or "cam_t_w2c" not in entry:
        return None
    t_cam_world = numbers_of(entry, "cam_t_w2c", 3, where) * 1e-3
    return transform(R_world_cam, -R_world_cam @ t_cam_world)


def _ground_truth(entry: Any, gt_id: int, visib_fract: float | None, where: str) -> GroundTruth:
    obj_id = integer_of(entry, "obj_id", where)
    try:
        R, t_mm = pose_of(entry, where)
        pose = as_rigid(transform(R, t_mm * 1e-3), f"{where}: the pose")
    except (InputError, ShapeError) as error:
        return GroundTruth(gt_id, obj_id, None, visib_fract, str(error))
    return GroundTruth(gt_id, obj_id, pose, visib_fract)
