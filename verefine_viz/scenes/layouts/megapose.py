"""A frame as MegaPose's example has it: ``camera_data.json``, ``image_rgb.png``, ``image_depth.png``, ``meshes/``.

``inputs/object_data.json`` lists objects with their boxes, ``outputs/object_data.json`` with their poses.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

import msgspec
import numpy as np
from msgspec import Meta

from verefine_viz.core.arrays import Float, Mask
from verefine_viz.core.errors import InputError, ShapeError, one_line
from verefine_viz.core.files import Numbers3x3, read_entries, read_json
from verefine_viz.core.geometry import inverse
from verefine_viz.core.number_kinds import Real
from verefine_viz.core.problem import ANSWER, Hypothesis, RecordedStep
from verefine_viz.core.text_format import unusable
from verefine_viz.scenes.image_files import color_of, find_image, read_depth, size_text
from verefine_viz.scenes.recorded_frame import RecordedFrame, RecordedObject, meshes_in, pose_of_quat

CAMERA, OBJECTS = "camera_data.json", "object_data.json"
Pose = tuple[tuple[Real, Real, Real, Real], tuple[Real, Real, Real]]
"""Quaternion (x, y, z, w), and position [m]."""


class CameraData(msgspec.Struct, frozen=True):
    """The camera."""

    K: Numbers3x3
    resolution: tuple[int, int]
    """Height and width."""
    TWC: Pose | None = None


class ObjectData(msgspec.Struct, frozen=True):
    """An object: where it was detected, or its pose."""

    label: Annotated[str, Meta(max_length=200)]
    bbox_modal: tuple[Real, Real, Real, Real] | None = None
    """Left, top, right, bottom [px]."""
    TWO: Pose | None = None


class Reader:
    """The one frame of such a folder; see :class:`~verefine_viz.scenes.recorded_frame.LayoutReader`."""

    LAYOUT = "layout of MegaPose's example"
    LOOKS_LIKE = "camera_data.json, image_rgb.png, image_depth.png, meshes/, inputs/object_data.json"
    NEEDS = (
        ("camera_data.json", "K [px] and resolution"),
        ("meshes", "a folder per label"),
    )
    is_sequence = has_truth = False
    names = ("0",)

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        (given, of_given), (answered, of_answered) = (self._listed(kind) for kind in ("inputs", "outputs"))
        self.notes: tuple[str, ...] = (*of_given, *of_answered)
        self._boxes = {one.label: one.bbox_modal for one in given if one.bbox_modal is not None}
        self._answered = answered or given
        if not self._answered:
            raise InputError(f"{folder} names no object; expected inputs/{OBJECTS} or outputs/{OBJECTS}")
        labels = sorted({one_line(one.label) for one in (*given, *answered)})
        self.objects: Mapping[str, int] = {label: k for k, label in enumerate(labels, 1)}
        self.has_poses = any(one.TWO is not None for one in answered)

    @staticmethod
    def recognizes(folder: Path) -> bool:
        return (folder / CAMERA).is_file() and (folder / "meshes").is_dir()

    def frame(self, name: str) -> RecordedFrame:
        """The frame; a pose that is none becomes a note."""
        camera = read_json(self._folder / CAMERA, CameraData)
        path = find_image(self._folder, "image_depth")
        if path is None:
            raise InputError(f"{self._folder / 'image_depth.png'} is missing; poses are verified by depth [mm]")
        depth_m = read_depth(path, 1.0)
        if depth_m.shape != camera.resolution:
            raise InputError(
                f"{path} is {size_text(depth_m.shape)} pixels, {CAMERA} says {size_text(camera.resolution)}"
            )
        rgb, of_color = color_of(find_image(self._folder, "image_rgb"), depth_m.shape)
        T_world_cam = np.eye(4) if camera.TWC is None else _pose(camera.TWC)
        notes = [*of_color]
        objects: list[RecordedObject] = []
        for one in self._answered:
            called = one_line(one.label)
            meshes = meshes_in(self._folder / "meshes" / one.label)
            pose = None
            try:
                pose = None if one.TWO is None else inverse(T_world_cam) @ _pose(one.TWO)
            except ShapeError as error:
                notes.append(f"{called}: {error}; it is left out")
            mask = None
            if pose is None and (box := self._boxes.get(one.label)) is not None:
                mask = _box_mask(box, depth_m.shape)
                notes.append(f"{called} has a box but no mask; all pixels of the box count as one")
            hypotheses = () if pose is None else (Hypothesis(pose, 1.0, "MegaPose"),)
            steps = tuple(RecordedStep(0, h.T_cam_obj, ANSWER) for h in hypotheses)
            mesh = meshes[0] if meshes else self._folder / "meshes" / one.label / "*.ply"
            objects.append(RecordedObject(called, mesh, 1e-3, mask, hypotheses, (None,) * len(hypotheses), steps))
        return RecordedFrame("0", camera.K, depth_m, rgb, tuple(objects), notes=tuple(notes))

    def answers(self, name: str) -> Mapping[str, tuple[Float | None, float | None]]:
        """None: one frame has no motion."""
        return {}

    def _listed(self, kind: str) -> tuple[list[ObjectData], tuple[str, ...]]:
        path = self._folder / kind / OBJECTS
        entries, faults = read_entries(path, ObjectData) if path.is_file() else ([], [])
        return [one for _, one in entries], unusable("entry", f"{kind}/{OBJECTS}", faults)


def _pose(given: Pose) -> Float:
    (x, y, z, w), t_m = given
    return pose_of_quat((w, x, y, z), t_m)


def _box_mask(box: tuple[float, float, float, float], shape: tuple[int, int]) -> Mask:
    height, width = shape
    left, top, right, bottom = (round(min(max(side, 0.0), 1e6)) for side in box)
    v, u = np.ogrid[:height, :width]
    return (left <= u) & (u <= right) & (top <= v) & (v <= bottom)
