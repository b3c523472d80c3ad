"""Frames as NVIDIA's NDDS exports them: what DOPE is trained with, and Falling Things.

``000000.json``, ``.jpg`` or ``.png``, ``.depth.png`` (0.1 mm a step), ``.depth.mm.16.png`` or ``.depth.npy``, and
``.seg.png`` or ``.cs.png`` with each pixel's class, and possibly ``.is.png`` with its instance as a number of three
bytes; for a stereo camera ``000000.left.json`` and so on. Positions are centimetres in OpenCV's camera frame.

An object's axes are those of its model as NVDU aligns it. The published model has other axes:
``fixed_model_transform`` of ``_object_settings.json``, transposed, takes it [m] to the aligned one [cm]. The object's
box in the frames, ``cuboid``, decides which of the two a mesh is, and its unit.

Source: the readme of Falling Things ("FAT dataset overview").
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float, Mask
from verefine_viz.core.errors import InputError, ShapeError, one_line
from verefine_viz.core.files import Numbers3, Numbers4x4, read_json, sorted_out
from verefine_viz.core.geometry import apply, as_rigid, inverse, transform
from verefine_viz.core.number_kinds import Real
from verefine_viz.core.text_format import unusable
from verefine_viz.scenes.image_files import color_of, find_image, read_depth, read_steps, size_text
from verefine_viz.scenes.meshes import read_geometry
from verefine_viz.scenes.recorded_frame import (
    RecordedFrame,
    RecordedObject,
    depth_of,
    meshes_in,
    natural_key,
    pose_of_quat,
)

CAMERAS, OBJECTS = "_camera_settings.json", "_object_settings.json"
DEPTHS = {".depth.mm.16": 1.0, ".depth": 0.1}
"""Names of depth images, with millimetres per step."""
NEAREST_M = 0.0256
"""An image that is nowhere this deep is not depth: 255 steps of 0.1 mm."""
LABELS, INSTANCES = (".seg", ".cs"), ".is"
MODELS_AROUND = 3
"""Folders around the frames' own in which ``models/`` is looked for."""
UNITS_M = (0.01, 1.0, 0.001)
CENTIMETRE_M = 0.01
MOST_OFF = 0.2
"""Largest deviation of a mesh's box, as a share of its diagonal; that of a thinned mesh is less."""

Numbers4 = np.ndarray[tuple[Literal[4]], np.dtype[np.float64]]
Numbers8x3 = np.ndarray[tuple[Literal[8], Literal[3]], np.dtype[np.float64]]


class Pinhole(msgspec.Struct, frozen=True):
    """Intrinsics [px]."""

    fx: Real
    fy: Real
    cx: Real
    cy: Real


class ExportedCamera(msgspec.Struct, frozen=True):
    """Name of the camera, such as ``left``."""

    intrinsic_settings: Pinhole
    name: str = ""


class CameraList(msgspec.Struct, frozen=True):
    """The file of the cameras."""

    camera_settings: tuple[ExportedCamera, ...]


class ExportedObject(msgspec.Struct, frozen=True, rename={"called": "class"}):
    """A class of objects."""

    called: str
    segmentation_class_id: int | None = None
    fixed_model_transform: Numbers4x4 | None = None
    """Transposed: the published model [m] to the aligned one [cm]."""


class ObjectList(msgspec.Struct, frozen=True):
    """The file of the objects."""

    exported_objects: tuple[ExportedObject, ...]


class PosedObject(msgspec.Struct, frozen=True, rename={"called": "class"}):
    """An object of a frame."""

    called: str
    location: Numbers3
    """[cm]."""
    quaternion_xyzw: Numbers4
    instance_id: int | None = None
    cuboid: Numbers8x3 | None = None
    """Corners of its box in the camera frame [cm]."""


class FrameFile(msgspec.Struct, frozen=True):
    """The file of a frame."""

    objects: tuple[msgspec.Raw, ...]


@dataclass(frozen=True, eq=False)
class _Pixels:
    """What each pixel of a frame shows, (H, W) each."""

    depth_m: NDArray[np.float32]
    K: Float
    classes: Float
    instances: NDArray[np.int64]
    """Instances; -1 where they are unknown."""

    def of(
        self, class_id: int, one: PosedObject, origin_m: Float, alike_m: Sequence[Float]
    ) -> tuple[Mask, tuple[str, ...]]:
        """The pixels of an object; where several of its class share pixels, each pixel goes to the nearest, with a
        note.

        Args:
            class_id: of its class.
            one: the object.
            origin_m: (3,) where it is.
            alike_m: origins of all objects of its class, its own included.
        """
        if one.instance_id is not None and (own := self.instances == one.instance_id).any():
            return own, ()
        of_class: Mask = self.classes == class_id
        if len(alike_m) == 1:
            return of_class, ()
        v, u = np.nonzero(of_class & (self.depth_m > 0))
        points = (np.linalg.inv(self.K) @ np.stack([u, v, np.ones(len(u))]) * self.depth_m[v, u]).T
        away = np.min([np.linalg.norm(points - other, axis=1) for other in alike_m], axis=0)
        is_nearest = np.linalg.norm(points - origin_m, axis=1) <= away
        nearest = np.zeros_like(of_class)
        nearest[v[is_nearest], u[is_nearest]] = True
        return nearest, (f"{one_line(one.called)} is {len(alike_m)} times in the frame; its pixels go to the nearest",)


class Reader:
    """The frames of such a folder; see :class:`~verefine_viz.scenes.recorded_frame.LayoutReader`."""

    LAYOUT = "layout of NDDS (DOPE, Falling Things)"
    LOOKS_LIKE = f"{CAMERAS}, {OBJECTS}, 000000.json, 000000.png, 000000.depth.png, 000000.seg.png"
    NEEDS = (
        (CAMERAS, "intrinsics [px]"),
        (OBJECTS, "classes, their numbers in 000000.seg.png, and fixed_model_transform"),
    )
    is_sequence = has_poses = False
    has_truth = True

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        stems = (path.name.removesuffix(".json") for path in folder.glob("[0-9]*.json"))
        self.names: tuple[str, ...] = tuple(
            sorted((stem for stem in stems if self._depth_file(stem) is not None), key=natural_key)
        )
        if not self.names:
            raise InputError(
                f"{folder} is in the {self.LAYOUT}, but has no frame with depth, and poses are verified by depth; "
                "export it as 000000.depth.png (0.1 mm a step) or 000000.depth.mm.16.png"
            )
        self._cameras = read_json(folder / CAMERAS, CameraList).camera_settings
        exported = read_json(folder / OBJECTS, ObjectList).exported_objects
        if not self._cameras or not exported:
            raise InputError(f"{folder / (OBJECTS if self._cameras else CAMERAS)} lists nothing")
        self._exported = {one_line(one.called): one for one in exported}
        self.objects: Mapping[str, int] = {called: k for k, called in enumerate(self._exported, 1)}
        around = (folder, *folder.resolve().parents[:MODELS_AROUND])
        self._models = next((place / "models" for place in around if (place / "models").is_dir()), folder / "models")
        self._meshes: dict[str, tuple[Path, float, Float, tuple[str, ...]]] = {}
        missing = f"{self._models} is missing; expected {next(iter(self._exported))}.obj, … as NVDU aligned or got them"
        self.notes = () if self._models.is_dir() else (missing,)

    @staticmethod
    def recognizes(folder: Path) -> bool:
        return (folder / CAMERAS).is_file() and (folder / OBJECTS).is_file()

    def frame(self, name: str) -> RecordedFrame:
        """One frame with its visible objects at ground truth."""
        depth_m, notes = self._depth(name)
        rgb, of_color = color_of(find_image(self._folder, name), depth_m.shape)
        pixels = _Pixels(
            depth_m, self._K(name), self._labels(name, depth_m.shape), self._instances(name, depth_m.shape)
        )
        entries, faults = sorted_out(read_json(self._folder / f"{name}.json", FrameFile).objects, PosedObject)
        notes += [*of_color, *unusable("object", f"{name}.json", faults)]
        posed: list[tuple[PosedObject, Float]] = []
        for _, one in entries:
            try:
                posed.append((one, pose_of_quat(np.roll(one.quaternion_xyzw, 1), one.location * CENTIMETRE_M)))
            except ShapeError as error:
                notes.append(f"{one_line(one.called)} is left out: {error}")
        objects: list[RecordedObject] = []
        for one, T in posed:
            called = one_line(one.called)
            exported = self._exported.get(called)
            if exported is None or exported.segmentation_class_id is None:
                notes.append(f"{called} is left out: {OBJECTS} has no segmentation_class_id of it")
                continue
            alike_m = [other_T[:3, 3] for other, other_T in posed if other.called == one.called]
            mask, of_mask = pixels.of(exported.segmentation_class_id, one, T[:3, 3], alike_m)
            notes += of_mask
            if not mask.any():
                notes.append(f"{called} is left out: no pixel is of it")
                continue
            mesh, unit_m, T_obj_mesh, of_mesh = self._mesh(called, exported, one, T)
            notes += of_mesh
            objects.append(RecordedObject(called, mesh, unit_m, mask, T_cam_obj_gt=T @ T_obj_mesh))
        return RecordedFrame(name, pixels.K, depth_m, rgb, tuple(objects), notes=tuple(notes))

    def answers(self, name: str) -> Mapping[str, tuple[Float | None, float | None]]:
        """None: the layout holds no program's poses."""
        return {}

    def _depth_file(self, name: str) -> tuple[Path, float] | None:
        files = ((find_image(self._folder, f"{name}{ending}"), scale_mm) for ending, scale_mm in DEPTHS.items())
        return next(((path, scale_mm) for path, scale_mm in files if path is not None), None)

    def _depth(self, name: str) -> tuple[NDArray[np.float32], list[str]]:
        """Depth (H, W) [m]; the unit of an array is inferred from its median."""
        given = self._depth_file(name)
        if given is None:
            raise InputError(f"{self._folder / name}.depth.png is missing")
        path, scale_mm = given
        if path.suffix == ".npy":
            return depth_of(path)
        depth_m = read_depth(path, scale_mm)
        if 0 < depth_m.max(initial=0) < NEAREST_M:
            raise InputError(f"{path} holds a picture of depth in 8 bits; export depth as {name}.depth.mm.16.png")
        return depth_m, []

    def _labels(self, name: str, shape: tuple[int, ...]) -> Float:
        """The class of each pixel (H, W)."""
        files = (find_image(self._folder, f"{name}{ending}") for ending in LABELS)
        path = next((path for path in files if path is not None), None)
        if path is None:
            raise InputError(f"{self._folder / name}.seg.png is missing; export the segmentation by class")
        labels = read_steps(path, 1.0)
        if labels.shape != shape:
            raise InputError(f"{path} is {size_text(labels.shape)} pixels, depth is {size_text(shape)}")
        return labels

    def _instances(self, name: str, shape: tuple[int, ...]) -> NDArray[np.int64]:
        """The instance of each pixel (H, W), -1 without an image of them."""
        path = find_image(self._folder, f"{name}{INSTANCES}")
        colors, _ = color_of(path, shape)
        return np.full(shape, -1) if colors is None else colors.astype(np.int64) @ (1 << 16, 1 << 8, 1)

    def _K(self, name: str) -> Float:
        """The matrix (3, 3) [px] of the camera that a frame is named after (``000000.left``), else of the first one."""
        own = (one for one in self._cameras if name.endswith(f".{one.name}"))
        camera = next(own, self._cameras[0]).intrinsic_settings
        return np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1.0]])

    def _mesh(
        self, called: str, exported: ExportedObject, one: PosedObject, T: Float
    ) -> tuple[Path, float, Float, tuple[str, ...]]:
        """An object's mesh, its unit [m], the pose (4, 4) [m] of its axes in the object's, and a note where it does not
        fit.
        """
        if called not in self._meshes:
            names = dict.fromkeys((called, called.removesuffix("_16k")))
            own = (self._models / name / inner for name in names for inner in ("", "google_16k"))
            files = [file for folder in own for file in meshes_in(folder)]
            files += [file for file in meshes_in(self._models) if file.stem in names]
            if not files:
                return self._models / f"{called}.obj", CENTIMETRE_M, np.eye(4), ()
            box_m = None if one.cuboid is None else _box(apply(inverse(T), one.cuboid * CENTIMETRE_M))
            try:
                self._meshes[called] = files[0], *_placed(files[0], box_m, exported.fixed_model_transform)
            except InputError:  # A damaged mesh is named where the model is read.
                return files[0], CENTIMETRE_M, np.eye(4), ()
        return self._meshes[called]


def _placed(file: Path, box_m: Float | None, fixed: Float | None) -> tuple[float, Float, tuple[str, ...]]:
    """The unit [m] of a mesh and the pose (4, 4) [m] of its axes in the object's, the identity or ``fixed``, with which
    its box is nearest to ``box_m`` (2, 3); and a note where none fits.
    """
    if box_m is None:
        return CENTIMETRE_M, np.eye(4), (f"{file.name} counts as in centimetres and aligned: frames state no cuboid",)
    vertices, placements, notes = read_geometry(file)[0], [np.eye(4)], list[str]()
    if fixed is not None:
        scale = np.cbrt(abs(np.linalg.det(fixed[:3, :3]))) or 1.0
        try:
            T_fixed = transform(fixed[:3, :3].T / scale, fixed[3, :3] * CENTIMETRE_M)
            placements.append(as_rigid(T_fixed, f"fixed_model_transform of {file.name}"))
        except ShapeError as error:
            notes.append(str(error))
    choices = [*product(UNITS_M, placements)]
    off_m = [float(np.abs(_box(apply(T, vertices * unit_m)) - box_m).max()) for unit_m, T in choices]
    unit_m, T_obj_mesh = choices[int(np.argmin(off_m))]
    size_m = float(np.linalg.norm(box_m[1] - box_m[0]))
    if min(off_m) > MOST_OFF * size_m:
        notes.append(f"{file.name} is off the cuboid of {size_m:.3g} m that frames state by {min(off_m):.3g} m")
    return unit_m, T_obj_mesh, tuple(notes)


def _box(points: Float) -> Float:
    return np.stack([points.min(axis=0), points.max(axis=0)])
