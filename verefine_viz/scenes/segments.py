"""The instances of a frame: which pixels belong to which object, from mask images or from detections."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float, Mask, writable
from verefine_viz.core.camera import Camera
from verefine_viz.core.errors import InputError
from verefine_viz.core.frame_names import frame_name
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.problem import Hypothesis, Instance, LeftOut, Placed
from verefine_viz.core.settings import SceneSettings
from verefine_viz.core.text_format import listed
from verefine_viz.observation.observed_frame import segment_cloud
from verefine_viz.rendering.mesh import RenderMesh, render_mesh
from verefine_viz.rendering.rasterizer import draw_frame
from verefine_viz.scenes.annotations import GroundTruth
from verefine_viz.scenes.bop import BopDataset
from verefine_viz.scenes.bop_files import MaskFolder, nearby_hint
from verefine_viz.scenes.detections import Detection, DetectionsFile
from verefine_viz.scenes.models import ModelLibrary

FEWEST_MASK_PX = 10
"""Pixels of a mask below which nothing is solved well: point pair features need as many points, ICP three."""


@dataclass(frozen=True, eq=False)
class Segment:
    """One instance, before its model and its hypotheses are looked up."""

    instance_id: int
    obj_id: int
    mask: Mask
    T_cam_obj_gt: Float | None
    visib_fract: float | None

    def instance(
        self, depth_m: NDArray[np.floating], camera: Camera, pool: tuple[Hypothesis, ...], scene: SceneSettings
    ) -> Instance:
        """The instance with the cloud that depth (H, W) [m] shows in its mask, and its hypotheses."""
        cloud = segment_cloud(depth_m, camera, self.mask, scene.cloud_points, scene.seed)
        return Instance(self.instance_id, self.obj_id, self.mask, cloud, pool, self.T_cam_obj_gt, self.visib_fract)


@dataclass(frozen=True, eq=False)
class Segments:
    """All objects of a frame."""

    segments: tuple[Segment, ...]
    notes: tuple[str, ...]
    """About those that had to be left out."""
    left_out: tuple[LeftOut, ...]
    """Objects that are visible by ground truth."""


def segments_of_folder(
    dataset: BopDataset, scene_id: int, im_id: int, kind: MaskFolder, shape: tuple[int, int]
) -> Segments:
    """The annotated instances with their mask images; ``instance_id`` is the entry's place in scene_gt.

    Raises:
        InputError: the frame has no ground truth, so that it is unknown whose masks they are; or none of them exists.
    """
    entries = dataset.ground_truth(scene_id, im_id)
    if entries is None:
        known = dataset.detection_files()
        hint = f" ({', '.join(known)})" if known else ""
        raise InputError(
            f"frame {scene_id}/{im_id} of {dataset.name}/{dataset.split} has no scene_gt, so its masks have no object "
            f"ids; set scene.masks to the path of a detections JSON{hint}"
            f"{nearby_hint(dataset.files(scene_id).json('scene_gt'))}"
        )
    segments: list[Segment] = []
    notes: list[str] = []
    left_out: list[LeftOut] = []
    for entry in entries:
        name = f"{dataset.models.name(entry.obj_id)} (#{entry.gt_id})"
        try:
            mask = dataset.mask(scene_id, im_id, entry.gt_id, kind, shape)
        except InputError as error:
            notes.append(f"{name} is left out: {error}")
            if _is_seen(entry):
                left_out.append(replace(_left_out(dataset, entry, str(error), entry.gt_id), is_unreadable=True))
            continue
        if not mask.any():
            notes.append(f"{name} is left out: its mask is empty")
            # Without a visible share the empty mask is all that is known: nothing is seen of it.
            if entry.visib_fract:
                why = f"its mask is empty, though {entry.visib_fract:.0%} of it is visible"
                left_out.append(_left_out(dataset, entry, why, entry.gt_id))
            continue
        if entry.fault:
            notes.append(f"{name} has no ground truth: {entry.fault}")
        segments.append(Segment(entry.gt_id, entry.obj_id, mask, entry.T_cam_obj, entry.visib_fract))
    if entries and not segments:
        raise InputError(f"no instance of frame {scene_id}/{im_id} has a mask; {notes[0]}")
    return Segments(tuple(segments), tuple(notes), tuple(left_out))


def segments_of_detections(
    dataset: BopDataset, file: DetectionsFile, scene_id: int, im_id: int, camera: Camera
) -> Segments:
    """The detected instances; ``instance_id`` counts them from the highest score of the frame.

    Where ground truth or targets give how often each object is in the frame, only that many of its detections are used,
    as in BOP's localization task. Ground truth goes to the detection that its outline overlaps most.

    Raises:
        InputError: the frame has no detections, or none that can be used.
    """
    detections, notes = file.of_image(scene_id, im_id, camera.shape)
    if not detections:
        why = notes[0] if notes else f"its detections are of {listed(frame_name(ids) for ids in file.images)}"
        raise InputError(f"{file.path} has no masks for frame {scene_id}/{im_id}: {why}")
    empty = sum(not d.mask.any() for d in detections)
    if empty:
        notes += (f"{empty} detections in {file.path.name} have an empty mask; they are left out",)
    entries, damage = _truth(dataset, scene_id, im_id)
    notes += damage
    counts = _counts(dataset, entries, scene_id, im_id)
    used = _most_confident([d for d in detections if d.mask.any()], counts)
    n_too_many = len(detections) - empty - len(used)
    if n_too_many:
        notes += (f"{n_too_many} detections of objects that are not in the frame, or found too often, are left out",)
    segments = [Segment(k, d.obj_id, d.mask, None, None) for k, d in enumerate(used)]
    left_out: list[LeftOut] = []
    if entries is not None:
        unseen = Counter(e.obj_id for e in entries) - Counter(d.obj_id for d in used)
        notes += tuple(f"{dataset.models.name(i)} is in the ground truth but was not detected" for i in sorted(unseen))
        segments = _with_ground_truth(segments, entries, dataset.models, camera)
        given = {id(s.T_cam_obj_gt) for s in segments}
        missed = [e for e in entries if e.T_cam_obj is not None and id(e.T_cam_obj) not in given and _is_seen(e)]
        left_out = [_left_out(dataset, e, "it was not detected", None) for e in missed]
    if not segments:
        raise InputError(f"none of the detections of frame {scene_id}/{im_id} can be used: {'; '.join(notes)}")
    return Segments(tuple(segments), notes, tuple(left_out))


def all_left_out(dataset: BopDataset, scene_id: int, im_id: int, why: str, detected: bool) -> tuple[LeftOut, ...]:
    """All objects that are visible by ground truth in a frame that cannot be solved, before an image is read.

    Args:
        dataset: with ground truth, or there are none.
        scene_id: BOP scene.
        im_id: BOP image.
        why: what is wrong with the frame.
        detected: masks are detections, whose numbers are not those of ground truth.

    Raises:
        InputError: no such scene, or its ground truth is damaged.
    """
    seen = [e for e in dataset.ground_truth(scene_id, im_id) or () if _is_seen(e)]
    return tuple(_left_out(dataset, e, why, None if detected else e.gt_id) for e in seen)


def objects_of_frame(
    dataset: BopDataset, detections: DetectionsFile | None, scene_id: int, im_id: int
) -> frozenset[int] | None:
    """The objects of which a frame should have segments, before a mask is read; None where that is unknown.

    Raises:
        InputError: ground truth or targets are damaged.
    """
    if detections is None:
        return dataset.annotated_objects(scene_id, im_id)
    entries, _ = _truth(dataset, scene_id, im_id)
    counts = _counts(dataset, entries, scene_id, im_id)
    detected = detections.obj_ids(scene_id, im_id)
    return detected if counts is None else detected & frozenset(counts)


def _truth(dataset: BopDataset, scene_id: int, im_id: int) -> tuple[tuple[GroundTruth, ...] | None, tuple[str, ...]]:
    """The ground truth of a frame with detections, which does without; None where it is damaged, which is noted."""
    try:
        return dataset.ground_truth(scene_id, im_id), ()
    except InputError as error:
        return None, (f"the frame has no ground truth: {error}",)


def _counts(
    dataset: BopDataset, entries: Sequence[GroundTruth] | None, scene_id: int, im_id: int
) -> Mapping[int, int] | None:
    """How often each object is in a frame, by its ground truth, else by the targets; None without either."""
    if entries is not None:
        return Counter(e.obj_id for e in entries) or None
    return (dataset.targets or {}).get((scene_id, im_id)) or None


def _most_confident(detections: Sequence[Detection], counts: Mapping[int, int] | None) -> list[Detection]:
    if counts is None:
        return list(detections)
    left = dict(counts)
    used = []
    for detection in detections:  # highest score first
        if left.get(detection.obj_id, 0) > 0:
            left[detection.obj_id] -= 1
            used.append(detection)
    return used


def _with_ground_truth(
    segments: Sequence[Segment], entries: Sequence[GroundTruth], models: ModelLibrary, camera: Camera
) -> list[Segment]:
    """Each segment with the ground truth of its object; of several, the best overlapping pair goes first."""
    matched = list(segments)
    for obj_id in sorted({s.obj_id for s in segments}):
        mine = [k for k, s in enumerate(segments) if s.obj_id == obj_id]
        posed = [e for e in entries if e.obj_id == obj_id and e.T_cam_obj is not None]
        model = _readable(models, obj_id) if len(posed) > 1 or len(mine) > 1 else None
        if model is None:
            # One at most of each, or nothing of the object can be solved and any pairs count the same.
            shares = np.ones((len(mine), len(posed)))
        else:
            outlines = [silhouette(model, e.T_cam_obj, camera) for e in posed if e.T_cam_obj is not None]
            shares = np.array([[overlap(segments[k].mask, outline) for outline in outlines] for k in mine])
        while shares.size and shares.max() >= 0:
            row, column = np.unravel_index(np.argmax(shares), shares.shape)
            k, gt = mine[int(row)], posed[int(column)]
            matched[k] = replace(segments[k], T_cam_obj_gt=gt.T_cam_obj, visib_fract=gt.visib_fract)
            shares[row, :] = shares[:, column] = -1
    return matched


def _readable(models: ModelLibrary, obj_id: int) -> ObjectModel | None:
    """The object's model; None where it is damaged, which is noted when the frame's models are read."""
    try:
        return models.get(obj_id)
    except InputError:
        return None


def _is_seen(entry: GroundTruth) -> bool:
    """Whether anything of an instance is visible, or may be."""
    return entry.visib_fract is None or entry.visib_fract > 0


def _left_out(dataset: BopDataset, entry: GroundTruth, why: str, instance_id: int | None) -> LeftOut:
    name, has_gt = dataset.models.name(entry.obj_id), entry.T_cam_obj is not None
    return LeftOut(instance_id, entry.obj_id, name, why, has_gt, entry.visib_fract)


# Which pixels a model covers, and which of several masks that fits.


def silhouette(model: ObjectModel, T_cam_obj: Float, camera: Camera) -> Mask:
    """The pixels (H, W) on which the model appears, its holes left open."""
    return draw_placed([Placed(0, model, T_cam_obj)], camera)[1] == 0


def draw_placed(placed: Iterable[Placed], camera: Camera) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
    """Depth (H, W) [m] of posed models together, 0 beside them, and whose it is: instance_id, -1 beside them."""
    inv_z, owner = np.zeros(camera.shape, np.float32), np.full(camera.shape, -1, np.int32)
    meshes: dict[int, RenderMesh] = {}  # by identity: a model may be placed thousands of times
    for one in placed:
        if id(one.model) not in meshes:
            meshes[id(one.model)] = render_mesh(one.model.vertices, one.model.faces)
        face_of, pinhole = np.full(camera.shape, -1, np.int32), (camera.fx, camera.fy, camera.cx, camera.cy)
        draw_frame(writable(one.T_cam_obj), *meshes[id(one.model)].arrays, *pinhole, inv_z, face_of)
        owner[face_of >= 0] = one.instance_id
    return np.divide(1.0, inv_z, out=np.zeros_like(inv_z), where=inv_z > 0), owner


def overlap(a: Mask, b: Mask) -> float:
    """Intersection over union of two masks, in [0, 1]; 0 where both are empty."""
    union = np.count_nonzero(a | b)
    return np.count_nonzero(a & b) / union if union else 0.0


def best_owner(outline: Mask, masks: Sequence[Mask]) -> int:
    """Index of the mask that an outline overlaps most; of the nearest one where it overlaps none."""
    shares = [overlap(outline, mask) for mask in masks]
    if max(shares) > 0:
        return int(np.argmax(shares))
    centres = [_centre(mask) for mask in masks]
    return int(np.argmin([np.linalg.norm(_centre(outline) - c) for c in centres]))


def _centre(mask: Mask) -> Float:
    """Mean (v, u) of a mask [px]; the image's middle where it is empty."""
    v, u = np.nonzero(mask)
    return np.array([v.mean(), u.mean()]) if len(v) else np.array(mask.shape) / 2
