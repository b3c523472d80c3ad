"""The Extended APC data set as its authors publish it: ``scene-0001/frame-000000.color.png``, ``gt_info.yml``, ….

A depth image has tenths of millimetres, the bits of each value rotated by three; a mask has each pixel's object number.
``gt_info.yml`` holds the camera's pose in the world, whose z is up, the intrinsics, the objects with their poses in the
world, and which of them are to be placed one after another. Positions are metres, quaternions (w, x, y, z). This is the
layout that the authors' code reads (github.com/cmitash/PhysimGlobalPose: ``SceneCfg.cpp``, ``utilities.cpp``); the
scene that comes with it, ``test-scene/``, has no poses of objects.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Literal

import msgspec
import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import InputError, ShapeError
from verefine_viz.core.files import Numbers3x3, array_of, read_yaml
from verefine_viz.core.geometry import inverse
from verefine_viz.scenes.image_files import DEEPEST_M, color_of, read_steps, size_text
from verefine_viz.scenes.recorded_frame import RecordedFrame, RecordedObject, meshes_in, pose_of_quat

INFO, FRAME = "gt_info.yml", "frame-000000"
OBJECTS = (
    "crayola_24_ct",
    "expo_dry_erase_board_eraser",
    "folgers_classic_roast_coffee",
    "scotch_duct_tape",
    "up_glucose_bottle",
    "laugh_out_loud_joke_book",
    "soft_white_lightbulb",
    "kleenex_tissue_box",
    "dove_beauty_bar",
    "elmers_washable_no_run_school_glue",
    "rawlings_baseball",
)
"""Objects in the order of their numbers, from 1 (``obj_config.yml``)."""
MODELS = ("models", "models_visualization", "src/physim_pose_estimation/models_visualization")
"""Folders that hold meshes [m], or one folder of meshes per object, in the data set's folder or its parent."""
STEP_MM = 0.1

Numbers7 = np.ndarray[tuple[Literal[7]], np.dtype[np.float64]]
Order = tuple[tuple[int, ...], ...]


class SceneCamera(msgspec.Struct, frozen=True):
    """The camera of a scene."""

    camera_pose: Numbers7
    camera_intrinsics: Numbers3x3


class ObjectEntry(msgspec.Struct, frozen=True):
    """An object of a scene."""

    name: str
    pose: Any = None
    """Not checked here, but object by object."""


class Info(msgspec.Struct, frozen=True):
    """A scene: ``scene`` has ``object_1``, …, and ``dependency_order``, numbers of objects, cluster by cluster."""

    camera: SceneCamera
    scene: dict[str, ObjectEntry | Order | int | float | str | None]


class Reader:
    """The scenes of the data set, or one of them; see :class:`~verefine_viz.scenes.recorded_frame.Recording`."""

    LAYOUT = "layout of Extended APC"
    LOOKS_LIKE = f"scene-0001/{INFO}, {FRAME}.color.png, {FRAME}.depth.png, {FRAME}.mask.png"
    NEEDS = (
        (INFO, "the camera, and the objects with their poses"),
        (f"{FRAME}.color.png", "the image"),
        (f"{FRAME}.depth.png", "its depth"),
    )
    is_sequence = has_poses = False

    def __init__(self, folder: Path) -> None:
        self._scenes = {_name(scene): scene for scene in _scenes(folder)}
        self.names: tuple[str, ...] = tuple(self._scenes)
        self.objects: Mapping[str, int] = {name: k for k, name in enumerate(OBJECTS, 1)}
        self.has_truth = _have_truth(self._scenes.values())
        near = (folder, folder.resolve().parent)
        self._models = tuple(path for place in near for name in MODELS if (path := place / name).is_dir())
        expected = f"expected {MODELS[0]}/{OBJECTS[0]}/{OBJECTS[0]}.obj, … or {MODELS[0]}/{OBJECTS[0]}.ply, … there"
        self.notes: tuple[str, ...] = (
            () if self._models else (f"{folder} has no models; {expected} or in the folder around it",)
        )

    @staticmethod
    def recognizes(folder: Path) -> bool:
        return any(True for _ in _scenes(folder))

    def frame(self, name: str) -> RecordedFrame:
        """One scene, its objects at ground truth where that is given."""
        scene = self._scenes[name]
        info = _info(scene)
        depth_m = _depth_m(scene / f"{FRAME}.depth.png")
        mask_path = scene / f"{FRAME}.mask.png"
        labels = read_steps(mask_path, 1.0) if mask_path.is_file() else None
        if labels is not None and labels.shape != depth_m.shape:
            raise InputError(f"{mask_path} is {size_text(labels.shape)} pixels, depth is {size_text(depth_m.shape)}")
        try:
            T_cam_world = inverse(_pose(info.camera.camera_pose))
        except ShapeError as error:
            raise InputError(f"{scene / INFO}: camera_pose: {error}") from None
        notes: list[str] = []
        objects: list[RecordedObject] = []
        for one in _objects(info, scene):
            T_gt = None
            try:
                T_gt = None if one.pose is None else T_cam_world @ _pose(array_of(Numbers7, one.pose))
            except ValueError as error:
                notes.append(f"{one.name} has no ground truth: {error}")
            number = self.objects.get(one.name)
            mask = None if labels is None or number is None else labels == number
            objects.append(RecordedObject(one.name, self._mesh(one.name), 1.0, mask, T_cam_obj_gt=T_gt))
        order = info.scene.get("dependency_order")
        clusters = order if isinstance(order, tuple) else ()
        if sorted(k for cluster in clusters for k in cluster) != [*range(1, len(objects) + 1)]:
            notes += [f"dependency_order of {scene / INFO} does not name each object once; it is ignored"] * bool(order)
            clusters = ()
        rgb, of_color = color_of(scene / f"{FRAME}.color.png", depth_m.shape)
        return RecordedFrame(
            name,
            info.camera.camera_intrinsics,
            depth_m,
            rgb,
            tuple(objects),
            down_cam=-T_cam_world[:3, 2],
            notes=(*notes, *of_color),
            order=tuple(tuple(k - 1 for k in cluster) for cluster in clusters),
        )

    def answers(self, name: str) -> Mapping[str, tuple[Float | None, float | None]]:
        """None: the layout holds no program's poses."""
        return {}

    def _mesh(self, called: str) -> Path | None:
        """The mesh of an object, preferably the one named after it; None where there is none."""
        for models in self._models:
            files = [*meshes_in(models / called), *(p for p in meshes_in(models) if p.stem == called)]
            if files:
                return min(files, key=lambda path: (path.stem != called, path.name))
        return None


def _scenes(folder: Path) -> list[Path]:
    """The scenes that a folder holds, or the one that it is."""
    return [path for path in (folder, *sorted(folder.glob("scene-*"))) if (path / INFO).is_file()]


def _name(scene: Path) -> str:
    """The frame of a scene: its number in the folder's name, or in the file, where it has one."""
    number = scene.resolve().name.rpartition("-")[2]
    number = number if number.isdecimal() else _info(scene).scene.get("id")
    return f"{int(number)}/0" if isinstance(number, int | str) and str(number).isdecimal() else "0/0"


def _info(scene: Path) -> Info:
    return read_yaml(scene / INFO, Info)


def _objects(info: Info, scene: Path) -> list[ObjectEntry]:
    """The objects of a scene in the order of their numbers."""
    entries = [info.scene.get(f"object_{k}") for k in range(1, 1 + len(info.scene))]
    objects = [entry for entry in entries if isinstance(entry, ObjectEntry)]
    if not objects:
        raise InputError(f"{scene / INFO} names no object; expected scene: object_1: name: {OBJECTS[0]!r}")
    return objects


def _have_truth(scenes: Iterable[Path]) -> bool:
    """Whether all objects of the first scene that can be read have a pose; InputError where none can be read."""
    faults: list[InputError] = []
    for scene in scenes:
        try:
            return all(one.pose is not None for one in _objects(_info(scene), scene))
        except InputError as error:
            faults.append(error)
    raise faults[0]


def _pose(numbers: Float) -> Float:
    return pose_of_quat(numbers[3:], numbers[:3])


def _depth_m(path: Path) -> np.ndarray:
    """The depth (H, W) [m], the bits of each value in the file rotated back by three."""
    steps = read_steps(path, STEP_MM).astype(np.uint16)
    depth_m = ((steps << 13 | steps >> 3) * (STEP_MM * 1e-3)).astype(np.float32)
    if depth_m.max(initial=0) > DEEPEST_M:
        raise InputError(f"{path} holds depth of {depth_m.max():.3g} m, expected at most {DEEPEST_M:g} m")
    return depth_m
