"""Images as DeepIM's demo has them: ``000000-color.png``, ``-depth.png``, ``meta.yml``, and PoseCNN's results.

``posecnn_results/000000-color.png.mat`` holds labels and initial poses, ``deepim_results_RGBD/`` (or ``_COLOR``) the
poses after each iteration of DeepIM. Models are those of YCB-Video.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import InputError, ShapeError
from verefine_viz.core.files import Numbers3x3, read_yaml
from verefine_viz.core.problem import ANSWER, Hypothesis, RecordedStep
from verefine_viz.scenes.image_files import color_of, read_depth, size_text
from verefine_viz.scenes.layouts.ycb_video import CLASSES, model_of
from verefine_viz.scenes.mat_file import mat_arrays
from verefine_viz.scenes.recorded_frame import (
    RecordedFrame,
    RecordedObject,
    images_in,
    pose_of_quat,
)

META, POSECNN, DEEPIM = "meta.yml", "posecnn_results", ("deepim_results_RGBD", "deepim_results_COLOR")
COLOR, DEPTH = "-color.png", "-depth.png"
MODELS = ("models", "../models", "../YCB_Video/models", "../YCB_Object/models")


class CameraFile(msgspec.Struct, frozen=True):
    """The camera of all images."""

    INTRINSICS: Numbers3x3


class Reader:
    """The frames of such a folder; see :class:`~verefine_viz.scenes.recorded_frame.LayoutReader`."""

    LAYOUT = "layout of DeepIM's demo"
    LOOKS_LIKE = "000000-color.png, 000000-depth.png, meta.yml, posecnn_results/"
    NEEDS = (
        ("meta.yml", "INTRINSICS [px]"),
        ("posecnn_results", "initial poses"),
    )
    is_sequence = has_truth = False
    has_poses = True

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._K = read_yaml(folder / META, CameraFile).INTRINSICS
        self.names: tuple[str, ...] = tuple(images_in(folder, f"*{DEPTH}"))
        if not self.names:
            raise InputError(f"{folder} has no depth; expected 000000{DEPTH} [mm] beside 000000{COLOR}")
        self.objects: Mapping[str, int] = {name: k for k, name in enumerate(CLASSES, 1)}
        self._models = next((folder / place for place in MODELS if (folder / place).is_dir()), folder / "models")
        missing = f"{self._models} is missing; put YCB-Video's models there ({CLASSES[0]}/textured_simple.obj, …)"
        self.notes = () if self._models.is_dir() else (missing,)

    @staticmethod
    def recognizes(folder: Path) -> bool:
        return (folder / META).is_file() and (folder / POSECNN).is_dir()

    def frame(self, name: str) -> RecordedFrame:
        """One frame: PoseCNN's poses, then DeepIM's iterations."""
        depth_m = read_depth(self._folder / f"{name}{DEPTH}", 1.0)
        rgb, of_color = color_of(self._folder / f"{name}{COLOR}", depth_m.shape)
        path = self._folder / POSECNN / f"{name}{COLOR}.mat"
        arrays = mat_arrays(path, "labels", "rois", "poses")
        labels, rois, poses = (arrays.get(key, np.zeros((0, 0))) for key in ("labels", "rois", "poses"))
        if labels.shape != depth_m.shape:
            raise InputError(
                f"{path}: labels are {size_text(labels.shape)} pixels, depth is {size_text(depth_m.shape)}"
            )
        if len(rois) != len(poses) or rois.shape[1:] != (7,) or poses.shape[1:] != (7,):
            raise InputError(f"{path}: rois {rois.shape} and poses {poses.shape}, expected (n, 7) both")
        iterations = self._iterations(name, len(poses))
        notes = [*of_color]
        objects: list[RecordedObject] = []
        for k, (index, score) in enumerate(rois[:, (1, 6)].tolist()):
            if not 1 <= index <= len(CLASSES):
                notes.append(f"object {index:g} of {path.name} is none of YCB-Video; it is left out")
                continue
            called = CLASSES[int(index) - 1]
            mesh = model_of(self._models, called)
            try:
                first = Hypothesis(pose_of_quat(poses[k, :4], poses[k, 4:]), score, "PoseCNN")
            except ShapeError as error:
                notes.append(f"{called} has no initial pose: {error}")
                objects.append(RecordedObject(called, mesh, 1.0, labels == index))
                continue
            taken: list[Float] = []
            for number, one in enumerate(iterations, 1):
                try:
                    taken.append(pose_of_quat(one[k, 2:6], one[k, 6:9]))
                except ShapeError as error:
                    notes.append(f"{called}: iteration {number} of DeepIM is left out: {error}")
            words = ["DeepIM"] * (len(taken) - 1) + [ANSWER]
            steps = tuple(RecordedStep(0, T, what) for T, what in zip(taken, words, strict=False))
            steps = steps or (RecordedStep(0, first.T_cam_obj, ANSWER),)
            objects.append(RecordedObject(called, mesh, 1.0, labels == index, (first,), (score,), steps))
        return RecordedFrame(name, self._K, depth_m, rgb, tuple(objects), notes=tuple(notes))

    def answers(self, name: str) -> Mapping[str, tuple[Float | None, float | None]]:
        """None: the images are not a video."""
        return {}

    def _iterations(self, name: str, n_objects: int) -> NDArray[np.float64]:
        """DeepIM's poses (iterations, objects, 9), each (_, class - 1, quaternion wxyz, position); none without its
        results.
        """
        files = (self._folder / kind / f"{name}{COLOR}.mat" for kind in DEEPIM)
        path = next((file for file in files if file.is_file()), None)
        poses = np.zeros((0, 0, 9)) if path is None else mat_arrays(path, "poses_est").get("poses_est", np.zeros(0))
        if path is not None and (poses.ndim != 3 or poses.shape[1:] != (n_objects, 9)):
            raise InputError(f"{path}: poses_est {poses.shape}, expected (iterations, {n_objects}, 9)")
        return poses
