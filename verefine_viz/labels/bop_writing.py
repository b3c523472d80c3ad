"""Writes labels as ground truth in BOP layout: into the data set of their frames, or as a new one.

In the data set: ``scene_gt.json``, ``scene_gt_info.json``, ``mask/`` and ``mask_visib/`` of each scene that has
labelled frames, and ``models_info.json`` where there is none. A new one holds the labelled frames under the names that
they have, with images, cameras, models and targets. All of it takes its place at the end, or nothing does.
"""

from __future__ import annotations

import os
import shutil
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from verefine_viz.core.errors import InputError, VerefineError
from verefine_viz.core.files import id_of, read_json
from verefine_viz.core.frame_names import FrameIds, frame_name, parse_frame
from verefine_viz.core.observation import Observation
from verefine_viz.core.problem import Placed
from verefine_viz.core.progress_token import NEVER_CANCELLED, ProgressToken
from verefine_viz.core.replacing import taking_places
from verefine_viz.core.text_format import unusable
from verefine_viz.core.writing import atomic, check_no_link, make_inside, write_json
from verefine_viz.evaluation.ground_truth import VISIB_FRACT
from verefine_viz.evaluation.instance_masks import instance_masks
from verefine_viz.labels.models_written import (
    INFO,
    Symmetries,
    folder_of,
    model_infos,
    readable,
    stated_infos,
    write_models,
)
from verefine_viz.scenes.annotations import targets_names
from verefine_viz.scenes.bop import BopDataset
from verefine_viz.scenes.bop_entries import FARTHEST_M, camera_entry, depth_image, truth_entry
from verefine_viz.scenes.bop_files import SceneFiles
from verefine_viz.scenes.image_files import write_image
from verefine_viz.scenes.labels import Label
from verefine_viz.scenes.unlabelled_frames import UnlabelledFrames

SPLIT = "test"
"""Split of a new data set whose frames come from another layout."""
NO_SYMMETRIES: Symmetries = {}


@dataclass
class TruthWritten:
    """Summary of the ground truth that was written."""

    folder: Path
    """Folder of the data set."""
    n_frames: int = 0
    n_objects: int = 0
    notes: tuple[str, ...] = ()
    """What was left out, or not replaced, a sentence each."""


def labels_to_write(
    labels: Mapping[str, Sequence[Label]], with_uncertain: bool = False
) -> dict[FrameIds, tuple[Label, ...]]:
    """The labels of each frame (scene, image) that count as ground truth: accepted ones, and uncertain ones where asked
    for. A frame whose labels do not count is left out; a frame that was labelled as holding nothing is kept.
    """
    states = ("accepted", "uncertain") if with_uncertain else ("accepted",)
    counted: dict[FrameIds, tuple[Label, ...]] = {}
    for frame, of in labels.items():
        chosen = tuple(one for one in of if one.state in states)
        if chosen or not of:
            counted[parse_frame(frame)] = chosen
    return dict(sorted(counted.items()))


def write_into_dataset(
    source: UnlabelledFrames,
    labels: Mapping[FrameIds, Sequence[Label]],
    symmetries: Symmetries = NO_SYMMETRIES,
    overwrite: bool = False,
    progress: ProgressToken = NEVER_CANCELLED,
) -> TruthWritten:
    """Write labels into the data set in BOP layout that their frames belong to.

    Args:
        source: the frames.
        labels: what is written (:func:`labels_to_write`).
        symmetries: confirmed ones, for ``models_info.json``; an existing file is not touched without ``overwrite``, and
            with it keeps all that it states.
        overwrite: whether existing files are moved to ``replaced-N`` beside them; if not, they are an error.
        progress: asked before each frame.

    Raises:
        InputError: the frames are of another layout, or their models of another folder; no label can be written;
            a file is there already, or cannot be written. Nothing was written.
        Cancelled: through ``progress``; nothing was written.
    """
    dataset = source.dataset
    if dataset is None:
        raise InputError(f"{source.title} is no data set in BOP layout; write its labels to a new folder: --to FOLDER")
    scenes = {scene_id: dataset.files(scene_id) for scene_id, _ in labels if scene_id in dataset.scene_ids}
    infos = _own_models(dataset, source) / INFO
    is_left_alone = infos.exists() and not overwrite
    places = [place for files in scenes.values() for place in _truth_places(files)]
    places += [] if is_left_alone else [infos]
    for folder in dict.fromkeys((dataset.folder / dataset.split, *(place.parent for place in places))):
        check_no_link(folder)
    with taking_places(places, overwrite) as parts:
        truths = {scene_id: _SceneTruth(files, parts.__getitem__) for scene_id, files in scenes.items()}
        notes = _add_frames(source, labels, truths.__getitem__, progress)
        if not is_left_alone:
            obj_ids, faults = readable(source.models)
            notes += unusable("model", infos.parent.name, faults)
            content = model_infos(source.models, obj_ids, symmetries)
            if content != stated_infos(source.models):
                write_json(parts[infos], content)
        elif symmetries:
            notes.append(f"{infos} is there and was left alone; to add the confirmed symmetries, overwrite")
        return _finished(dataset.folder, truths, notes)


def write_new_dataset(
    source: UnlabelledFrames,
    labels: Mapping[FrameIds, Sequence[Label]],
    out: Path,
    symmetries: Symmetries = NO_SYMMETRIES,
    overwrite: bool = False,
    progress: ProgressToken = NEVER_CANCELLED,
) -> TruthWritten:
    """Write labelled frames as a data set in BOP layout of its own.

    Images of a data set in BOP layout are hard links where the disk allows it.

    Args:
        source: the frames, of any layout.
        labels: what is written (:func:`labels_to_write`).
        out: the data set's folder, which may hold other things; is made.
        symmetries: confirmed ones, written beside those that the source's ``models_info.json`` states.
        overwrite: as in :func:`write_into_dataset`.
        progress: asked before each frame.

    Raises:
        InputError: no label can be written; a file is there already, or cannot be written. Nothing was written.
        Cancelled: through ``progress``; nothing was written.
    """
    split = SPLIT if source.dataset is None else source.dataset.split
    make_inside(out)
    places = [out / name for name in ("models", "obj_names.json", targets_names(split, "localization")[0], split)]
    with taking_places(places, overwrite) as parts:
        models, names, targets, scenes = (parts[place] for place in places)
        truths: dict[int, _SceneTruth] = {}
        images = _Images(source.dataset)

        def of_scene(scene_id: int) -> _SceneTruth:
            return truths.setdefault(scene_id, _SceneTruth(SceneFiles(scenes / f"{scene_id:06d}")))

        notes = _add_frames(source, labels, of_scene, progress, images.write)
        written = _finished(out, truths, notes)
        for files, cameras in images.cameras.items():
            write_json(files.json("scene_camera"), cameras)
        obj_ids = sorted({entry["obj_id"] for one in truths.values() for of in one.truths.values() for entry in of})
        write_models(models, source.models, obj_ids, symmetries)
        write_json(names, {str(obj_id): source.models.name(obj_id) for obj_id in obj_ids})
        write_json(targets, [entry for scene_id, one in truths.items() for entry in one.targets(scene_id)])
        return written


def _truth_places(files: SceneFiles) -> tuple[Path, Path, Path, Path]:
    return files.images("mask"), files.images("mask_visib"), files.json("scene_gt_info"), files.json("scene_gt")


class _SceneTruth:
    """The ground truth of a scene: masks are written frame by frame, the rest at the end.

    Args:
        files: the files of the scene.
        part_of: gives the path to write to for a place.
    """

    def __init__(self, files: SceneFiles, part_of: Callable[[Path], Path] = Path) -> None:
        self.files = files
        self._mask, self._mask_visib, self._gt_info, self._gt = map(part_of, _truth_places(files))
        self.truths: dict[int, list[dict[str, Any]]] = {}
        self.infos: dict[int, list[dict[str, Any]]] = {}

    def add(self, im_id: int, placed: Sequence[Placed], observation: Observation) -> None:
        masks = instance_masks(placed, observation.depth_m, observation.camera)
        for folder in (self._mask, self._mask_visib):
            make_inside(folder)
        for k, one in enumerate(masks):
            for folder, mask in ((self._mask, one.whole), (self._mask_visib, one.visible)):
                write_image(folder / f"{im_id:06d}_{k:06d}.png", mask.astype(np.uint8) * np.uint8(255))
        self.truths[im_id] = [truth_entry(one.T_cam_obj, one.model.obj_id) for one in placed]
        self.infos[im_id] = [one.info for one in masks]

    def finish(self) -> None:
        if self.truths:
            write_json(self._gt_info, {str(im_id): of for im_id, of in self.infos.items()})
            write_json(self._gt, {str(im_id): of for im_id, of in self.truths.items()})

    def targets(self, scene_id: int) -> list[dict[str, int]]:
        """Entries of a targets file: how many of each object are at least 10 % visible."""
        entries: list[dict[str, int]] = []
        for im_id, truths in self.truths.items():
            pairs = zip(truths, self.infos[im_id], strict=True)
            seen = Counter(entry["obj_id"] for entry, info in pairs if info["visib_fract"] >= VISIB_FRACT)
            ids = {"im_id": im_id, "scene_id": scene_id}
            entries += [{**ids, "obj_id": obj_id, "inst_count": seen[obj_id]} for obj_id in sorted(seen)]
        return entries


def _add_frames(
    source: UnlabelledFrames,
    labels: Mapping[FrameIds, Sequence[Label]],
    of_scene: Callable[[int], _SceneTruth],
    progress: ProgressToken,
    also: Callable[[SceneFiles, FrameIds, Observation], None] = lambda files, ids, observation: None,
) -> list[str]:
    """Add all frames to their scenes; return notes about labels and frames that are left out."""
    no_frames: list[str] = []
    no_models: list[str] = []
    for ids, of in labels.items():
        frame = frame_name(ids)
        progress.checkpoint(f"Writing the labels of frame {frame}.")
        placed: list[Placed] = []
        for label in of:
            try:
                placed.append(Placed(label.instance, source.models.get(label.obj_id), label.pose))
            except VerefineError as error:
                no_models.append(f"frame {frame}, instance {label.instance}: {error}")
        if of and not placed:
            continue
        try:
            observation = source.observation(frame)[0]
        except VerefineError as error:
            no_frames.append(f"{frame}: {error}")
            continue
        scene = of_scene(ids[0])
        scene.add(ids[1], placed, observation)
        also(scene.files, ids, observation)
    return [*unusable("label", source.title, no_models), *unusable("frame", source.title, no_frames)]


def _finished(folder: Path, truths: Mapping[int, _SceneTruth], notes: Sequence[str]) -> TruthWritten:
    frames = [of for one in truths.values() for of in one.truths.values()]
    if not frames:
        why = notes[0] if notes else "none is accepted, and no frame is marked as empty"
        raise InputError(f"there is no label to write: {why}")
    for one in truths.values():
        one.finish()
    return TruthWritten(folder, len(frames), sum(map(len, frames)), tuple(notes))


def _own_models(dataset: BopDataset, source: UnlabelledFrames) -> Path:
    """The folder of the data set's own models; InputError where the labels have other models."""
    folder = folder_of(source.models)
    if folder is None or folder.resolve() not in map(Path.resolve, dataset.folder.glob("models*")):
        raise InputError(
            f"the labels are of models that are not in {dataset.folder}; write them to a new folder: --to FOLDER"
        )
    check_no_link(folder)
    return folder


class _Images:
    """Writes the images of frames, and collects what ``scene_camera.json`` says of them."""

    def __init__(self, dataset: BopDataset | None) -> None:
        self._dataset = dataset
        self.cameras: dict[SceneFiles, dict[str, Any]] = {}
        self._taken_over: dict[int, dict[int | None, Any]] = {}
        """Entries of the data set's own file for each image, by scene."""

    def write(self, files: SceneFiles, ids: FrameIds, observation: Observation) -> None:
        """Write the images of a frame (scene, image)."""
        entry = _drawn(files, ids[1], observation) if self._dataset is None else self._copied(self._dataset, files, ids)
        self.cameras.setdefault(files, {})[str(ids[1])] = entry

    def _copied(self, dataset: BopDataset, files: SceneFiles, ids: FrameIds) -> dict[str, Any]:
        there = dataset.files(ids[0])
        color = "rgb" if there.image("rgb", ids[1]) else "gray"
        for kind in ("depth", color):
            image = there.image(kind, ids[1])
            if image is not None:
                make_inside(files.images(kind))
                _link_or_copy(image, files.images(kind) / f"{ids[1]:06d}{image.suffix}")
        if ids[0] not in self._taken_over:
            entries = read_json(there.json("scene_camera"), dict[str, Any])
            self._taken_over[ids[0]] = {id_of(key): entry for key, entry in entries.items()}
        return self._taken_over[ids[0]][ids[1]]


def _drawn(files: SceneFiles, im_id: int, observation: Observation) -> dict[str, Any]:
    """Write the images of a frame of another layout; return its entry of ``scene_camera.json``."""
    depth_m = np.where(observation.depth_m > FARTHEST_M, 0.0, observation.depth_m.astype(np.float64))
    steps, step_mm = depth_image(depth_m)
    for kind, image in (("depth", steps), ("rgb", observation.rgb)):
        if image is not None:
            make_inside(files.images(kind))
            write_image(files.expected(kind, im_id), image)
    support = observation.support
    is_given = support is not None and support.gravity_source == "given"
    return camera_entry(observation.camera.K, step_mm, -support.T_world_cam[2, :3] if support and is_given else None)


def _link_or_copy(file: Path, place: Path) -> None:
    try:
        os.link(file.resolve(), place)
    except OSError:  # Another disk, or one without links.
        with atomic(place) as part:
            shutil.copyfile(file, part)
