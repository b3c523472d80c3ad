"""A folder of images in order with a pose per frame, as FoundationPose's demo, BundleSDF and YCBInEOAT have them.

``rgb/`` and ``depth/`` (images of the same names), ``cam_K.txt``, ``mesh/*.obj``, and, if they exist, ``masks/``
(often of the first frame only), ``ob_in_cam/*.txt`` (the program's poses, 4×4 in metres) and ``annotated_poses/*.txt``
(ground truth).
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from pathlib import Path

from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import InputError, ShapeError, one_line
from verefine_viz.core.files import id_of
from verefine_viz.core.geometry import rounding_note
from verefine_viz.core.problem import ANSWER, Hypothesis, RecordedStep
from verefine_viz.core.text_format import unusable
from verefine_viz.scenes.image_files import SUFFIXES, color_of, find_image, read_mask
from verefine_viz.scenes.recorded_frame import (
    LABEL,
    RecordedFrame,
    RecordedObject,
    depth_of,
    image_of,
    matrix_in,
    meshes_in,
    natural_key,
    numbers_in,
    pose_in,
    unit_of,
)

CAMERA, DEPTH, RGB = "cam_K.txt", "depth", "rgb"
MASKS, MESHES = ("masks", "mask", "gt_mask"), ("mesh", "meshes", "model", "models", ".")
POSES, GROUND_TRUTH = ("ob_in_cam", "debug/ob_in_cam", "poses"), ("annotated_poses",)
POSE_SUFFIXES = (".txt", ".npy")


class Reader:
    """The frames of such a folder, with one object; see :class:`~verefine_viz.scenes.recorded_frame.LayoutReader`."""

    LAYOUT = "layout of FoundationPose's demo"
    LOOKS_LIKE = "cam_K.txt, depth/, rgb/, mesh/"
    NEEDS = (
        ("cam_K.txt", "the 3×3 camera matrix [px]"),
        ("depth", "a depth image [mm] per frame"),
    )
    is_sequence = True

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        stems = {path.stem for path in (folder / DEPTH).iterdir() if path.suffix.lower() in SUFFIXES}
        if not stems:
            raise InputError(f"{folder / DEPTH} holds no image; expected {', '.join(SUFFIXES)}")
        self.names: tuple[str, ...] = tuple(sorted(stems, key=natural_key))
        self.objects: Mapping[str, int] = {one_line(folder.resolve().name): 1}
        poses, of_poses = self._pose_files(POSES)
        truths, of_truths = self._pose_files(GROUND_TRUTH)
        self._poses, self._truths = poses, truths
        self.notes: tuple[str, ...] = (*of_poses, *of_truths, *_pose_notes(poses), *_pose_notes(truths))
        self.has_poses, self.has_truth = bool(poses), bool(truths)

    @staticmethod
    def recognizes(folder: Path) -> bool:
        return (folder / CAMERA).is_file() and (folder / DEPTH).is_dir()

    def frame(self, name: str) -> RecordedFrame:
        """One frame; a pose that cannot be read becomes a note."""
        path = image_of(self._folder / DEPTH, name)
        depth, notes = depth_of(path)
        color = find_image(self._folder / RGB, name)
        rgb, of_color = color_of(color, depth.shape)
        notes += of_color
        if color is None:
            notes.append(f"{RGB}/ has no image {name}")
        if len(self._mesh_files) > 1:
            first, second, *_ = self._mesh_files
            notes.append(f"the folder holds {len(self._mesh_files)} meshes; {first.name} is used, not {second.name}")
        mask_file = next((file for kind in MASKS if (file := find_image(self._folder / kind, name))), None)
        pose, T_gt = (self._pose(files, name, notes) for files in (self._poses, self._truths))
        poses = () if pose is None else (Hypothesis(pose, 1.0, POSES[0]),)
        mask = None
        try:
            mask = None if mask_file is None else read_mask(mask_file, depth.shape, mask_file.parent / LABEL)
        except InputError as error:
            notes.append(f"the mask is left out: {error}")
        steps = () if pose is None else (RecordedStep(0, pose, ANSWER),)
        (called,) = self.objects
        one = RecordedObject(called, *self._mesh, mask, poses, (None,) * len(poses), steps, T_gt)
        return RecordedFrame(name, self._K, depth, rgb, (one,), notes=tuple(notes))

    def answers(self, name: str) -> Mapping[str, tuple[Float | None, float | None]]:
        """The program's pose of a frame; it has no score."""
        (called,) = self.objects
        return {called: (self._pose(self._poses, name, []), None)}

    def _pose_files(self, kinds: tuple[str, ...]) -> tuple[dict[str, Path], tuple[str, ...]]:
        """The pose file of each frame that has one, with a note where names do not match."""
        kind = next((kind for kind in kinds if (self._folder / kind).is_dir()), None)
        if kind is None:
            return {}, ()
        files = [path for path in (self._folder / kind).iterdir() if path.suffix.lower() in POSE_SUFFIXES]
        by_name = {_number(path.stem): path for path in files}
        known = {name: by_name[_number(name)] for name in self.names if _number(name) in by_name}
        if known or not files:
            return known, ()
        if len(files) != len(self.names):
            what = f"{kind}/ has {len(files)} poses of other names than the {len(self.names)} frames"
            return {}, (f"{what}; they are left out",)
        in_turn = sorted(files, key=lambda path: natural_key(path.name))
        note = f"the poses of {kind}/ are named otherwise than the frames; they are paired in order"
        return dict(zip(self.names, in_turn, strict=True)), (note,)

    def _pose(self, files: Mapping[str, Path], name: str, notes: list[str]) -> Float | None:
        if not files:
            return None
        if name not in files:
            notes.append(f"{next(iter(files.values())).parent.name}/ has no pose of this frame")
            return None
        try:
            return pose_in(files[name])
        except (InputError, ShapeError) as error:
            notes.append(f"{files[name].parent.name}/{files[name].name} is left out: {error}")
            return None

    @cached_property
    def _K(self) -> Float:
        return matrix_in(self._folder / CAMERA)

    @cached_property
    def _mesh_files(self) -> tuple[Path, ...]:
        return tuple(file for kind in MESHES for file in meshes_in(self._folder / kind))

    @cached_property
    def _mesh(self) -> tuple[Path, float]:
        """The mesh file, or its expected place, and its unit [m]."""
        if not self._mesh_files:
            return self._folder / MESHES[0] / "*.obj", 1.0
        file = self._mesh_files[0]
        return file, unit_of(file)


def _pose_notes(files: Mapping[str, Path]) -> tuple[str, ...]:
    """Notes about the poses of all frames: invalid ones, and rounded rotations."""
    faults: list[str] = []
    taken: list[Float] = []
    for path in files.values():
        try:
            pose_in(path)
            taken.append(numbers_in(path).reshape(-1, 4)[:3, :3])
        except (InputError, ShapeError) as error:
            text = str(error)
            faults.append(text if path.name in text else f"{path.name}: {text}")
    name = f"{next(iter(files.values())).parent.name}/" if files else ""
    return *unusable("pose", name, faults), *rounding_note(name, taken)


def _number(stem: str) -> int | str:
    """Key by which names are compared: numbers without leading zeros."""
    number = id_of(stem)
    return stem if number is None else number
