"""A frame as SAM-6D's example has it: ``camera.json``, ``rgb.png``, ``depth.png``, the CAD model, and its results.

Poses are those of ``outputs/sam6d_results/detection_pem.json``, one per detection of the object, in millimetres; its
answer is the one with the highest score. Without it the mask is the best one of ``detection_ism.json``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import msgspec

from verefine_viz.core.arrays import Float, Mask
from verefine_viz.core.errors import InputError, ShapeError, one_line
from verefine_viz.core.files import Numbers3, Numbers3x3, read_entries, read_json
from verefine_viz.core.geometry import as_rigid, rounding_note, transform
from verefine_viz.core.number_kinds import Real
from verefine_viz.core.problem import ANSWER, Hypothesis, RecordedStep
from verefine_viz.core.text_format import unusable
from verefine_viz.scenes.detections import mask_of
from verefine_viz.scenes.image_files import CameraEntry, color_of, depth_scale_of, find_image, intrinsics_of, read_depth
from verefine_viz.scenes.recorded_frame import RecordedFrame, RecordedObject, image_of, meshes_in

CAMERA, POSES, DETECTIONS = "camera.json", "detection_pem.json", "detection_ism.json"
MOST_POSES = 20
"""Poses of the highest scores that count as hypotheses."""


class Sam6dDetection(msgspec.Struct, frozen=True):
    """A detection of the object, and its pose where it was estimated."""

    segmentation: msgspec.Raw
    score: Real = 0.0
    R: Numbers3x3 | None = None
    t: Numbers3 | None = None
    """[mm]."""


@dataclass(frozen=True, eq=False)
class _Detection:
    place: int
    """In its file."""
    score: float
    T_cam_obj: Float | None
    segmentation: msgspec.Raw


class Reader:
    """The one frame of such a folder; see :class:`~verefine_viz.scenes.recorded_frame.LayoutReader`."""

    LAYOUT = "layout of SAM-6D's example"
    LOOKS_LIKE = "camera.json, rgb.png, depth.png, *.ply"
    NEEDS = (
        ("camera.json", "cam_K [px] and depth_scale"),
        ("rgb.png", "the image"),
        ("depth.png", "its depth"),
    )
    is_sequence = has_truth = False
    names = ("0",)

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        meshes = meshes_in(folder)
        self._mesh = meshes[0] if meshes else folder / "*.ply"
        """Or where it should be, the model that SAM-6D was given [mm]."""
        more = f"the folder holds {len(meshes)} models; {self._mesh.name} is used"
        self.notes: tuple[str, ...] = (more,) * (len(meshes) > 1)
        self.objects: Mapping[str, int] = {one_line(self._mesh.stem if meshes else folder.resolve().name): 1}
        self._results = self._file(POSES) or self._file(DETECTIONS)
        self.has_poses = self._results is not None and self._results.name == POSES

    @staticmethod
    def recognizes(folder: Path) -> bool:
        has_images = all(find_image(folder, stem) is not None for stem in ("rgb", "depth"))
        return (folder / CAMERA).is_file() and has_images

    def frame(self, name: str) -> RecordedFrame:
        """The frame, with all poses as hypotheses, the best first."""
        camera, where = read_json(self._folder / CAMERA, CameraEntry), str(self._folder / CAMERA)
        depth_m = read_depth(image_of(self._folder, "depth"), depth_scale_of(camera, where))
        rgb, of_color = color_of(find_image(self._folder, "rgb"), depth_m.shape)
        detections, notes = self._detections()
        mask, of_mask = _best_mask(detections, depth_m.shape)
        posed = [one for one in detections if one.T_cam_obj is not None][:MOST_POSES]
        hypotheses = tuple(
            Hypothesis(one.T_cam_obj, one.score, f"SAM-6D {k}")
            for k, one in enumerate(posed, 1)
            if one.T_cam_obj is not None
        )
        scores = tuple(one.score for one in posed)
        steps = tuple(RecordedStep(0, h.T_cam_obj, ANSWER, scores[0]) for h in hypotheses[:1])
        (called,) = self.objects
        if self._results is None:
            notes = (f"no {POSES} and no {DETECTIONS}: the object has no mask",)
        one = RecordedObject(called, self._mesh, 1e-3, mask, hypotheses, scores, steps)
        return RecordedFrame("0", intrinsics_of(camera, where), depth_m, rgb, (one,), notes=notes + of_mask + of_color)

    def _detections(self) -> tuple[list[_Detection], tuple[str, ...]]:
        """Those that can be used, the best first; and notes about the others, and about rounded rotations."""
        if self._results is None:
            return [], ()
        entries, faults = read_entries(self._results, Sam6dDetection)
        used: list[_Detection] = []
        taken: list[Float] = []
        for k, one in entries:
            try:
                pose = _pose(one)
            except (InputError, ShapeError) as error:
                faults.append(f"entry {k}: {error}")
                continue
            used.append(_Detection(k, one.score, pose, one.segmentation))
            taken += [] if one.R is None else [one.R]
        used.sort(key=lambda one: -one.score)
        name = self._results.name
        return used, (*unusable("detection", name, faults), *rounding_note(name, taken))

    def answers(self, name: str) -> Mapping[str, tuple[Float | None, float | None]]:
        """No answers: a single frame has no motion."""
        return {}

    def _file(self, name: str) -> Path | None:
        places = (self._folder / "outputs" / "sam6d_results", self._folder / "sam6d_results", self._folder)
        others = sorted(self._folder.glob(f"*/sam6d_results/{name}"))
        return next((path for path in (*(place / name for place in places), *others) if path.is_file()), None)


def _pose(one: Sam6dDetection) -> Float | None:
    if one.R is None and one.t is None:
        return None
    if one.R is None or one.t is None:
        raise InputError("it has no 'R' or no 't'")
    return as_rigid(transform(one.R, one.t * 1e-3), "the pose")


def _best_mask(detections: Sequence[_Detection], shape: tuple[int, ...]) -> tuple[Mask | None, tuple[str, ...]]:
    """The mask of the best detection that has one which can be read, and a note about better ones."""
    faults: list[str] = []
    mask = None
    for one in detections:
        try:
            mask = mask_of(one.segmentation, (shape[0], shape[1]), f"entry {one.place}")
            break
        except InputError as error:
            faults.append(str(error))
    return mask, unusable("mask", "the detections", faults)
