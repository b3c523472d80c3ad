"""A data set in BOP layout: images, cameras, ground truth, masks and targets of one split.

Foreign names stay here: ``cam_R_m2c``, ``cam_t_m2c`` [mm] become ``T_cam_obj`` [m].
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float, Mask
from verefine_viz.core.camera import Camera
from verefine_viz.core.errors import InputError, ShapeError, one_line, unknown
from verefine_viz.core.files import Numbered, Numbers3, Numbers3x3, array_of
from verefine_viz.core.geometry import as_rigid, rounding_note, transform
from verefine_viz.core.settings import ModelSampling
from verefine_viz.core.text_format import listed, unusable
from verefine_viz.scenes.annotations import (
    GroundTruth,
    InfoEntry,
    TruthEntry,
    ground_truth_of,
    object_of,
    pose_of,
    targets_path,
    usable_targets,
)
from verefine_viz.scenes.bop_files import (
    MaskFolder,
    SceneFiles,
    files_of_scene,
    meant_dataset,
    nearby_hint,
    scenes_in,
    sensors_of,
    splits_in,
)
from verefine_viz.scenes.coco_masks import CocoMasks
from verefine_viz.scenes.image_files import (
    CameraEntry,
    color_of,
    depth_scale_of,
    intrinsics_notes,
    intrinsics_of,
    read_depth,
    read_mask,
)
from verefine_viz.scenes.models import ModelLibrary

NO_COLOR = "the frame has no rgb or gray image; it is drawn without colour"
"""A note of images without; colour is optional."""
MOST_CHECKED = 2000
"""Frames whose ground truth is looked through when a data set is opened, spread evenly: a second at most."""
T = TypeVar("T")


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
        sensor: the one whose images are read, where scenes have several; empty = plain names, else the first one
            (:func:`~verefine_viz.scenes.bop_files.files_of_scene`).
        model_sampling: how the points are spread.
        needs_models: whether it is refused without models.

    Raises:
        InputError: the folder, the split or the models are not there.
    """

    def __init__(
        self,
        folder: Path | str,
        split: str,
        model_points: int = 2000,
        seed: int = 0,
        sensor: str = "",
        model_sampling: ModelSampling = "random",
        needs_models: bool = True,
    ) -> None:
        self.folder = Path(folder)
        self.split = split
        self.sensor = sensor
        if not self.folder.is_dir():
            raise InputError(f"data set folder {self.folder} does not exist; set scene.dataset to a BOP folder")
        splits = splits_in(self.folder)
        if split not in splits:
            raise InputError(f"{unknown('split', split, splits)} in {self.folder}{meant_dataset(self.folder, split)}")
        self._library = partial(ModelLibrary, self.folder, model_points, seed, model_sampling)
        if needs_models:
            _ = self.models
        self._scenes = scenes_in(self.folder / split)
        self._files: dict[int, SceneFiles] = {}
        self._coco: dict[int, CocoMasks] = {}
        self._cameras: dict[int, Numbered[CameraEntry]] = {}
        self.target_notes: tuple[str, ...] = ()
        """About the targets file, once :attr:`targets` were asked for."""
        self._scene_faults: dict[int, str] = {}
        """Why a scene's frames cannot be listed."""
        self._truths: dict[int, Numbered[tuple[TruthEntry, ...]] | None] = {}
        self._infos: dict[int, Numbered[tuple[InfoEntry, ...]] | None] = {}

    @cached_property
    def models(self) -> ModelLibrary:
        """Models of the objects."""
        return self._library()

    @property
    def name(self) -> str:
        """The folder's name: ycbv, lmo, …"""
        return one_line(self.folder.name)

    @property
    def scene_ids(self) -> tuple[int, ...]:
        return tuple(self._scenes)

    def files(self, scene_id: int) -> SceneFiles:
        """Where a scene's files are.

        Raises:
            InputError: no such scene, two folders of it, or it has no such sensor.
        """
        if scene_id not in self._scenes:
            raise InputError(f"{unknown('scene', scene_id, self._scenes)} in {self.folder / self.split}")
        folder, *others = self._scenes[scene_id]
        if others:
            raise InputError(f"{folder} and {others[0].name} are both scene {scene_id}; rename or remove one of them")
        if scene_id not in self._files:
            self._files[scene_id] = files_of_scene(folder, self.sensor)
        return self._files[scene_id]

    def sensor_notes(self, scene_ids: Iterable[int]) -> tuple[str, ...]:
        """A note about the first of some scenes of which one of several sensors was chosen here.

        Raises:
            InputError: as :meth:`files`.
        """
        for files in map(self.files, () if self.sensor else scene_ids):
            others = [name for name in sensors_of(files.folder) if name != files.sensor]
            if files.sensor and others:
                return (f"sensor {files.sensor} is read; also there (scene.sensor): {listed(others)}",)
        return ()

    def mask_notes(self, scene_ids: Iterable[int]) -> tuple[str, ...]:
        """A note about the first of some scenes whose visible masks are no images; as :meth:`sensor_notes`."""
        for files in map(self.files, scene_ids):
            if files.are_masks_listed:
                path = files.json("scene_gt_coco")
                return (f"masks come from {path.name}, as scene {files.folder.name} has no mask_visib/ and no mask/",)
        return ()

    def scene_notes(self) -> tuple[str, ...]:
        """Notes about scenes that were asked for their images and cannot list them, or not all."""
        of = f"{self.name}/{self.split}"
        keys = [fault for cameras in self._cameras.values() for fault in cameras.faults]
        return *unusable("scene", of, [*self._scene_faults.values()]), *unusable("image", of, keys)

    def truth_notes(self, frames: Sequence[tuple[int, int]]) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Notes about the ground truth of frames (scene_id, im_id): entries that cannot be used; rounded rotations."""
        chosen = [frames[int(k)] for k in np.linspace(0, len(frames) - 1, min(len(frames), MOST_CHECKED)).round()]
        part = f" ({MOST_CHECKED} of {len(frames)} frames checked)" * (len(frames) > MOST_CHECKED)
        of = f"the ground truth of {self.name}/{self.split}{part}"
        faults: list[str] = []
        taken: list[Float] = []
        files: dict[int, list[Numbered[Any]]] = {}
        for scene_id, im_id in chosen:
            if scene_id not in files:
                files[scene_id] = []
                for read in (self.truths, self.infos):
                    try:
                        files[scene_id] += filter(None, (read(scene_id),))
                    except InputError as error:
                        faults.append(str(error))
                faults += (fault for file in files[scene_id] for fault in file.faults)
            for file in files[scene_id]:
                _sort_out(file, im_id, faults, taken)
        return unusable("entry", of, faults), rounding_note(of, taken)

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
            path = self.files(scene_id).json("scene_camera")
            if not os.path.lexists(path):
                raise InputError(f"{path} does not exist{nearby_hint(path)}")
            self._cameras[scene_id] = Numbered(path, CameraEntry, "image")
        return self._cameras[scene_id]

    def truths(self, scene_id: int) -> Numbered[tuple[TruthEntry, ...]] | None:
        """What a scene's scene_gt.json has for each image, None without one; as :meth:`cameras`."""
        if scene_id not in self._truths:
            self._truths[scene_id] = _existing(self.files(scene_id).json("scene_gt"), tuple[TruthEntry, ...])
        return self._truths[scene_id]

    def infos(self, scene_id: int) -> Numbered[tuple[InfoEntry, ...]] | None:
        """What a scene's scene_gt_info.json has for each image, None without one; as :meth:`cameras`."""
        if scene_id not in self._infos:
            path = self.files(scene_id).json("scene_gt_info")
            self._infos[scene_id] = _existing(path, tuple[InfoEntry, ...])
        return self._infos[scene_id]

    def depth_file(self, scene_id: int, im_id: int) -> Path:
        """Where the depth image is.

        Raises:
            InputError: no such scene, or image.
        """
        files = self.files(scene_id)
        path = files.image("depth", im_id)
        if path is None:
            expected = files.expected("depth", im_id)
            raise InputError(f"{expected} is missing; a depth image is needed{nearby_hint(expected)}")
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
        """Whether the image is listed; of a scene that cannot list its images none is (:meth:`scene_notes`)."""
        if scene_id not in self._scenes or scene_id in self._scene_faults:
            return False
        try:
            return im_id in self.cameras(scene_id)
        except InputError as error:
            self._scene_faults[scene_id] = str(error)
            return False

    @property
    def frames(self) -> tuple[tuple[int, int], ...]:
        """(scene_id, im_id) of all images of the scenes that can list theirs; of the others tell the
        :meth:`scene_notes`.
        """
        frames: list[tuple[int, int]] = []
        for scene_id in self._scenes:
            try:
                frames += [(scene_id, im_id) for im_id in self.image_ids(scene_id)]
            except InputError as error:
                self._scene_faults[scene_id] = str(error)
        return tuple(frames)

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
        cameras = self.cameras(scene_id)
        entry, where = cameras[im_id], cameras.where(im_id)
        K, scale_mm = intrinsics_of(entry, where), depth_scale_of(entry, where)
        path = self.depth_file(scene_id, im_id)
        depth_m = read_depth(path, scale_mm)
        if not depth_m.any():
            raise InputError(f"{path} is 0 everywhere: the frame has no depth, nothing can be verified in it")
        rgb, notes = self._color(scene_id, im_id, depth_m.shape)
        notes += intrinsics_notes(K, depth_m.shape)
        if depth_m.max() < 0.05 or np.median(depth_m[depth_m > 0]) > 20:
            median_m = float(np.median(depth_m[depth_m > 0]))
            notes += (f"median depth is {median_m:.3g} m; check 'depth_scale' ({scale_mm:g} mm) in scene_camera.json",)
        try:
            camera = Camera(K, depth_m.shape[1], depth_m.shape[0])
        except ShapeError as error:
            raise InputError(f"{where}: {error}") from None
        R_world_cam, T_map_cam, own_notes = _camera_pose(entry, where)
        return BopImage(camera, depth_m, rgb, R_world_cam, T_map_cam, notes + own_notes)

    def annotated_objects(self, scene_id: int, im_id: int) -> frozenset[int] | None:
        """The objects that :meth:`ground_truth` has of an image, without their poses, which take ten times as long.

        Raises:
            InputError: scene_gt.json is damaged.
        """
        truths = self.truths(scene_id)
        if truths is None or im_id not in truths:
            return None
        objects: set[int] = set()
        for entry in truths[im_id]:
            with suppress(InputError):
                objects.add(object_of(entry, truths.where(im_id)))
        return frozenset(objects)

    def ground_truth(self, scene_id: int, im_id: int) -> tuple[GroundTruth, ...] | None:
        """The annotated instances of an image in the file's order; None where the data set has no scene_gt. An entry
        that names no object is left out.

        Raises:
            InputError: scene_gt.json is damaged.
        """
        truths = self.truths(scene_id)
        if truths is None or im_id not in truths:
            return None
        entries, where = truths[im_id], truths.where(im_id)
        of_image: tuple[InfoEntry, ...] = ()
        with suppress(InputError):  # Then visible shares are not known, as without the file.
            infos = self.infos(scene_id)
            of_image = () if infos is None or im_id not in infos else infos[im_id]
        # Visible masks that were drawn, not rendered, may be larger than the rendered silhouette.
        visible = {k: min(max(info.share, 0.0), 1.0) for k, info in enumerate(of_image) if info.share is not None}
        known: list[GroundTruth] = []
        for gt_id, entry in enumerate(entries):
            with suppress(InputError):
                known.append(ground_truth_of(entry, gt_id, visible.get(gt_id), f"{where}, entry {gt_id}"))
        return tuple(known)

    def mask(self, scene_id: int, im_id: int, gt_id: int, kind: MaskFolder, shape: tuple[int, int]) -> Mask:
        """The mask (H, W) of one annotated instance.

        Raises:
            InputError: it is missing, damaged or of another size.
        """
        files = self.files(scene_id)
        folder, expected = files.images(kind), files.expected(kind, im_id, gt_id)
        if kind == "mask_visib" and files.are_masks_listed:
            return self._listed_mask(files, scene_id, im_id, gt_id, shape)
        if not folder.is_dir():
            other = "mask" if kind == "mask_visib" else "mask_visib"
            hint = f"set scene.masks to {other!r} or to the path of a detections JSON"
            raise InputError(f"{folder} is missing; {hint}{nearby_hint(folder)}")
        path = files.image(kind, im_id, gt_id)
        if path is None:
            raise InputError(
                f"{expected} is missing; add it, or set scene.masks to a detections JSON{nearby_hint(expected)}"
            )
        return read_mask(path, shape)

    def _listed_mask(self, files: SceneFiles, scene_id: int, im_id: int, gt_id: int, shape: tuple[int, int]) -> Mask:
        if scene_id not in self._coco:
            self._coco[scene_id] = CocoMasks(files.json("scene_gt_coco"))
        cameras = self.cameras(scene_id)
        K = intrinsics_of(cameras[im_id], cameras.where(im_id))
        return self._coco[scene_id].mask(im_id, gt_id, self.ground_truth(scene_id, im_id) or (), K, shape)

    @cached_property
    def targets(self) -> Mapping[tuple[int, int], Mapping[int, int]] | None:
        """What the benchmark asks for, as ``target_counts`` of the targets file that ``evaluate`` takes as well; None
        without one, or where nothing of it can be used (:attr:`target_notes`).
        """
        path = targets_path(self.folder, self.split)
        if path is None:
            return None
        try:
            counts, faults = usable_targets(path)
        except InputError as error:
            self.target_notes = (f"{error}; all images count",)
            return None
        self.target_notes = unusable("entry", path.name, faults)
        return counts or None

    def detection_files(self) -> tuple[str, ...]:
        """JSON files in the data set's folder that look like detections, for hints in errors."""
        paths = [*self.folder.glob("*detect*.json"), *self.folder.glob("*detect*.json.gz")]
        return tuple(sorted(p.name for p in paths))

    def _color(
        self, scene_id: int, im_id: int, shape: tuple[int, ...]
    ) -> tuple[NDArray[np.uint8] | None, tuple[str, ...]]:
        files = self.files(scene_id)
        path = files.image("rgb", im_id) or files.image("gray", im_id)
        if path is None:
            near = nearby_hint(files.expected("rgb", im_id)) or nearby_hint(files.expected("gray", im_id))
            return None, (NO_COLOR + near,)
        return color_of(path, shape)


def _sort_out(file: Numbered[Any], im_id: int, faults: list[str], taken: list[Float]) -> None:
    """Add what is wrong with an image's entries in scene_gt.json or scene_gt_info.json, and rotations that are good."""
    if im_id not in file:
        return
    try:
        entries = file[im_id]
    except InputError as error:
        faults.append(str(error))
        return
    for gt_id, entry in enumerate(entries):
        if not isinstance(entry, TruthEntry):
            return
        where = f"{file.where(im_id)}, entry {gt_id}"
        try:
            fault = ground_truth_of(entry, gt_id, None, where).fault
        except InputError as error:
            fault = str(error)
        if fault:
            faults.append(fault)
        elif not entry.is_without_pose:
            taken.append(pose_of(entry, where)[0])


def _existing(path: Path, kind: type[T]) -> Numbered[T] | None:
    return Numbered(path, kind, "image") if os.path.lexists(path) else None


def _camera_pose(entry: CameraEntry, where: str) -> tuple[Float | None, Float | None, tuple[str, ...]]:
    """Camera to world: the rotation (3, 3), all of it (4, 4) [m]; and a note where the entry has something else."""
    try:
        if entry.cam_R_w2c is None:
            return None, None, ()
        R_cam_world = array_of(Numbers3x3, entry.cam_R_w2c)
        R_world_cam = as_rigid(transform(R_cam_world, np.zeros(3)), f"{where}: 'cam_R_w2c'")[:3, :3].T
    except ShapeError as error:
        return None, None, (f"{error}; the camera's pose is left out",)
    except ValueError as error:
        return None, None, (f"{where}: 'cam_R_w2c': {error}; the camera's pose is left out",)
    if entry.cam_t_w2c is None:
        return R_world_cam, None, ()
    try:
        t_mm = array_of(Numbers3, entry.cam_t_w2c)
    except ValueError as error:
        return R_world_cam, None, (f"{where}: 'cam_t_w2c': {error}; the camera's position is left out",)
    return R_world_cam, transform(R_world_cam, -R_world_cam @ (t_mm * 1e-3)), ()
