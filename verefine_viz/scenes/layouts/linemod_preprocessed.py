"""LINEMOD as DenseFusion has it (``Linemod_preprocessed``): a folder per object with ``gt.yml`` and ``info.yml``.

``data/01/{rgb,depth,mask}/0000.png`` (or ``.npy``) and ``models/obj_01.ply``, in millimetres. A mask is of the folder's
own object.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import ContentError, InputError
from verefine_viz.core.files import converted, id_of, read_yaml
from verefine_viz.core.geometry import rounding_note
from verefine_viz.scenes.annotations import TruthEntry, ground_truth_of, pose_of
from verefine_viz.scenes.image_files import (
    SUFFIXES,
    CameraEntry,
    color_of,
    depth_scale_of,
    find_image,
    intrinsics_of,
    read_mask,
)
from verefine_viz.scenes.recorded_frame import (
    LABEL,
    RecordedFrame,
    RecordedObject,
    depth_in_steps,
    image_of,
    natural_key,
)

CAMERAS, GROUND_TRUTH = "info.yml", "gt.yml"
T = TypeVar("T")


class Reader:
    """The frames of the data set or of one folder; see :class:`~verefine_viz.scenes.recorded_frame.LayoutReader`."""

    LAYOUT = "layout of DenseFusion's Linemod_preprocessed"
    LOOKS_LIKE = "data/01/gt.yml, data/01/info.yml, models/obj_01.ply"
    NEEDS = (
        (CAMERAS, "cam_K [px] and depth_scale of each image"),
        (GROUND_TRUTH, "the objects of each image and their poses"),
        ("depth", "a depth image per entry"),
    )
    is_sequence = has_poses = False
    has_truth = True

    def __init__(self, folder: Path) -> None:
        scenes = [folder] if _is_scene(folder) else sorted(filter(_is_scene, (folder / "data").iterdir()))
        self._scenes = {scene.resolve().name: _Folder(scene) for scene in scenes}
        self._models = scenes[0].resolve().parents[1] / "models"
        self.names: tuple[str, ...] = tuple(
            f"{name}/{image}" for name, scene in self._scenes.items() for image in scene.images
        )
        if not self.names:
            raise InputError(f"{scenes[0] / 'depth'} holds no image; expected 0000.png, …")
        self.objects: Mapping[str, int] = {_called(id_of(name) or 0): id_of(name) or 0 for name in self._scenes}
        self.notes = () if self._models.is_dir() else (f"{self._models} is missing; expected obj_01.ply, …",)

    @staticmethod
    def recognizes(folder: Path) -> bool:
        data = folder / "data"
        return _is_scene(folder) or (data.is_dir() and any(map(_is_scene, data.iterdir())))

    def frame(self, name: str) -> RecordedFrame:
        """One frame with its folder's object, at its ground truth."""
        folder_name, image = name.split("/")
        scene, obj_id = self._scenes[folder_name], id_of(folder_name) or 0
        camera, where = scene.entry(scene.cameras, CAMERAS, image, CameraEntry)
        depth_m, of_depth = depth_in_steps(image_of(scene.folder / "depth", image), depth_scale_of(camera, where))
        rgb, of_color = color_of(find_image(scene.folder / "rgb", image), depth_m.shape)
        entries, where_gt = scene.entry(scene.truths, GROUND_TRUTH, image, tuple[TruthEntry, ...])
        notes = [*scene.truth_notes, *of_depth, *of_color]
        if scene.are_counted_otherwise:
            notes.append(f"images of {folder_name}/ are counted otherwise than {CAMERAS}; they are paired in order")
        own = next((entry for entry in entries if entry.obj_id == obj_id), None)
        T_gt = None
        if own is None:
            notes.append(f"{where_gt} has no object {obj_id}")
        else:
            truth = ground_truth_of(own, 0, None, where_gt)
            T_gt = truth.T_cam_obj
            notes += [truth.fault] * bool(truth.fault)
        mask = read_mask(image_of(scene.folder / "mask", image), depth_m.shape, scene.folder / "mask" / LABEL)
        mesh = self._models / f"{_called(obj_id)}.ply"
        one = RecordedObject(_called(obj_id), mesh, 1e-3, mask, T_cam_obj_gt=T_gt)
        return RecordedFrame(name, intrinsics_of(camera, where), depth_m, rgb, (one,), notes=tuple(notes))

    def answers(self, name: str) -> Mapping[str, tuple[Float | None, float | None]]:
        """None: the layout holds no program's poses."""
        return {}


class _Folder:
    """One folder; its files are read once, when a frame of it is asked for."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.obj_id = id_of(folder.resolve().name) or 0
        stems = {path.stem for path in (folder / "depth").glob("*.*") if path.suffix.lower() in SUFFIXES}
        self.images = tuple(sorted(stems, key=natural_key))

    @cached_property
    def cameras(self) -> Mapping[int, Any]:
        return read_yaml(self.folder / CAMERAS, dict[int, Any])

    @cached_property
    def truths(self) -> Mapping[int, Any]:
        return read_yaml(self.folder / GROUND_TRUTH, dict[int, Any])

    @cached_property
    def truth_notes(self) -> tuple[str, ...]:
        """A note about rounded rotations of its own object."""
        taken: list[Float] = []
        for entries in self.truths.values():
            with suppress(ValueError, InputError):  # Reported with its frame.
                own = [one for one in converted(entries, tuple[TruthEntry, ...]) if one.obj_id == self.obj_id]
                taken += [pose_of(one, "")[0] for one in own if not one.is_without_pose]
        return rounding_note(f"{self.folder.name}/{GROUND_TRUTH}", taken)

    @cached_property
    def are_counted_otherwise(self) -> bool:
        """Whether images have other numbers than their entries, of which there are as many."""
        return len(self.cameras) == len(self.images) and {*map(id_of, self.images)} != {*self.cameras}

    def entry(self, entries: Mapping[int, Any], file: str, image: str, kind: type[T]) -> tuple[T, str]:
        """The entry of an image and what to call it; InputError where there is none, or something else."""
        where, number = f"{self.folder / file}, image {image}", id_of(image)
        if self.are_counted_otherwise and len(entries) == len(self.images):
            number = sorted(entries)[self.images.index(image)]
        if number is None or number not in entries:
            raise InputError(f"{where} is missing")
        try:
            return converted(entries[number], kind), where
        except ContentError as error:
            raise InputError(f"{where}: {error}") from None


def _is_scene(folder: Path) -> bool:
    return (
        (folder / GROUND_TRUTH).is_file() and (folder / CAMERAS).is_file() and id_of(folder.resolve().name) is not None
    )


def _called(obj_id: int) -> str:
    return f"obj_{obj_id:02d}"
