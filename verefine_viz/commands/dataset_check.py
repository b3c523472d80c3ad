"""What ``verefine-viz datasets check`` does: which parts of a BOP folder are there, and whether they fit together."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from itertools import product
from pathlib import Path
from typing import get_args

import numpy as np

from verefine_viz.commands.dataset_ground_truth import check_truths, each_frame, object_sizes, registration
from verefine_viz.commands.dataset_parts import MOST_FAULTS, Parts
from verefine_viz.core.errors import InputError, VerefineError
from verefine_viz.core.text_format import MOST_NAMED, first_of
from verefine_viz.evaluation.bop_model import EvalModels
from verefine_viz.evaluation.ground_truth import (
    VISIB_FRACT,
    BopGroundTruth,
    read_targets,
    targets_path,
    visible_targets,
)
from verefine_viz.scenes.bop import NO_COLOR, BopDataset, MaskFolder
from verefine_viz.scenes.frames import frame_name
from verefine_viz.scenes.segments import FEWEST_MASK_PX

N_OPENED = 40
"""Frames of a split that are opened, spread evenly: 0.1 to 0.5 s each."""
N_DRAWN = 6
"""Frames in which objects are drawn as well, spread evenly: about a second each."""


def check_split(folder: Path, split: str) -> Parts:
    """Checks one split of a data set. What is missing or wrong is a finding, not an error."""
    parts = Parts()
    try:
        dataset = BopDataset(folder, split)
    except VerefineError as error:
        if any(folder.glob("models*/obj_*")):
            parts.add("models", "damaged", str(error))
            parts.skip("all the rest", "not checked, because the models cannot be read")
            parts.before_all = f"models that can be read ({error}); nothing else was checked"
        else:
            parts.add("models", str(error), "fetch the archive with the models and unpack it here")
            parts.skip("all the rest", "not checked, because there are no models yet")
            parts.before_all = "models; nothing else was checked"
        return parts
    _check_models(dataset, parts)
    frames = _check_frames(dataset, parts)
    if not frames:
        parts.skip("all the rest", "not checked, because there are no frames yet")
        return parts
    _check_camera_poses(dataset, parts)
    opened = _spread(frames, N_OPENED)
    _check_images(dataset, opened, parts)
    _check_masks(dataset, opened, parts)
    _check_scoring(dataset, opened, parts)
    if parts.ground_truth and parts.depth and parts.models:
        drawn = _spread(frames, N_DRAWN)
        is_in_place = _check_sizes(dataset, drawn, parts)
        for result, advice in registration(dataset, drawn, is_in_place):
            parts.add("registration", result, advice)
        _check_each_frame(dataset, opened, parts)
    else:
        needed = {"models": parts.models, "depth": parts.depth, "ground truth": parts.ground_truth}
        lacking = " and ".join(what for what, there in needed.items() if not there)
        for name in ("sizes", "registration", "each frame"):
            parts.skip(name, f"not checked, needs {lacking}")
    return parts


def _spread(frames: Sequence[tuple[int, int]], most: int) -> list[tuple[int, int]]:
    return [frames[int(k)] for k in np.linspace(0, len(frames) - 1, min(most, len(frames))).round()]


def _check_models(dataset: BopDataset, parts: Parts) -> None:
    library, broken, notes = dataset.models, list[str](), _without_diameter(dataset)
    for obj_id in library.ids:
        try:
            model = library.get(obj_id)
            notes += library.notes(obj_id)
            if not 0.005 < model.diameter_m < 5:
                notes.append(f"{model.name} is {model.diameter_m * 1e3:.4g} mm across: its unit is wrong")
        except VerefineError as error:
            broken.append(str(error))
    parts.models = len(broken) < len(library.ids)
    if not library.ids:
        broken.append("expected meshes, obj_000001.ply and so on: fetch the archive with the models and unpack it here")
    parts.add("models", f"{len(library.ids)} in {library.folder.name}/", "; ".join([*broken, *notes]))
    if not (dataset.folder / "models_eval").is_dir() and library.folder.name != "models_eval":
        parts.add(
            "models_eval", "not there: errors are measured on models/, the benchmark's own numbers on models_eval/"
        )


def _without_diameter(dataset: BopDataset) -> list[str]:
    """Which models lack the diameter that scores need; a folder without models_info.json has none, and wants none."""
    faults: list[str] = []
    with suppress(VerefineError):
        models = EvalModels(dataset.folder)
        for obj_id in dataset.models.ids:
            try:
                models.diameter_mm(obj_id)
            except VerefineError as error:
                faults.append(str(error))
    return [*faults, "evaluate refuses answers about objects without diameter"] if faults else []


def _check_frames(dataset: BopDataset, parts: Parts) -> list[tuple[int, int]]:
    frames: list[tuple[int, int]] = []
    why = "no scene_camera.json lists any; nothing else was checked"
    for scene_id in dataset.scene_ids:
        try:
            image_ids = dataset.image_ids(scene_id)
            frames += [(scene_id, im_id) for im_id in image_ids]
            if not image_ids:
                parts.add(f"scene {scene_id}", "no frames", "its scene_camera.json lists none")
        except VerefineError as error:
            parts.add(f"scene {scene_id}", "cannot be used", str(error))
            why = str(error)
    n = len(dataset.scene_ids)
    parts.add("frames", f"{len(frames)} in {n} scene{'s' * (n != 1)}", "" if frames else "there is nothing to run")
    parts.before_all = "" if frames else f"frames: {why}"
    try:
        targets = dataset.targets
    except VerefineError as error:
        parts.add("targets", "damaged", str(error))
        return frames
    if targets:
        known = set(frames)
        parts.add("targets", *_present([ids for ids in targets if ids in known], [*targets.keys() - known]))
    return frames


def _present(there: Sequence[tuple[int, int]], missing: Sequence[tuple[int, int]]) -> tuple[str, str]:
    """Of the frames of a targets file, how many can be run; that a part of a data set has not all is no fault."""
    n = len(there) + len(missing)
    if not missing:
        return f"{n} frames", ""
    such = f"such as {frame_name(min(missing))}"
    if there:
        return f"{len(there)} of its {n} frames are here; the others, {such}, are left out", ""
    return f"{n} frames", f"none of them is here, {such}: the targets belong to other images; all images here are run"


def _check_camera_poses(dataset: BopDataset, parts: Parts) -> None:
    for scene_id in dataset.scene_ids:
        with suppress(VerefineError):  # Reported already.
            cameras = dataset.cameras(scene_id)
            parts.frames += len(cameras)
            parts.with_camera_pose += sum(camera.cam_R_w2c is not None for camera in cameras.values())
    if parts.with_camera_pose:
        result = f"known for {parts.with_camera_pose} of {parts.frames} frames"
        few = parts.with_camera_pose < parts.frames
        parts.add("camera poses", result + "; in the others scene.gravity world takes the table's normal" * few)


def _check_sizes(dataset: BopDataset, sampled: list[tuple[int, int]], parts: Parts) -> bool:
    """Whether masks lie where the ground truth has the objects; True where that is unknown."""
    kind = _mask_folder(parts)
    if kind is None:
        return True
    verdict = object_sizes(dataset, sampled, kind)
    parts.add("sizes", verdict.message, verdict.advice)
    return verdict.cause in (None, "depth", "masks")


def _mask_folder(parts: Parts) -> MaskFolder | None:
    kinds: list[MaskFolder] = ["mask_visib", "mask"]
    return next((kind for kind in kinds if kind in parts.masks), None)


def _check_each_frame(dataset: BopDataset, opened: Sequence[tuple[int, int]], parts: Parts) -> None:
    """Frame by frame, where nothing that is off in all frames together explains what is off in each."""
    kind = _mask_folder(parts)
    if any(row.advice for row in parts.findings if row.name in ("sizes", "registration")):
        parts.skip("each frame", "not checked, because the frames are off together")
    elif kind is not None:
        finding = each_frame(dataset, opened, kind)
        if finding is not None:
            parts.add("each frame", *finding)


def _check_scoring(dataset: BopDataset, opened: Sequence[tuple[int, int]], parts: Parts) -> None:
    """Whether BOP scores find what they need besides images; what they would refuse is reported in their words.

    Without a targets file they ask for all frames of the split, of which those that are ``opened`` stand for all.
    """
    if not parts.ground_truth:  # Reported already.
        return
    try:
        models, truth = EvalModels(dataset.folder), BopGroundTruth(dataset)
        path, annotated = targets_path(dataset.folder, dataset.split), set(truth.images())
        targets = read_targets(path) if path else visible_targets(truth, [ids for ids in opened if ids in annotated])
        for obj_id in sorted({obj_id for counts in targets.counts.values() for obj_id in counts}):
            models.diameter_mm(obj_id)
        missing = [image for image in targets.counts if not dataset.has(*image)]
        if missing:
            which = f"{len(missing)} of the {len(targets.counts)} images of {targets.name}"
            raise InputError(f"{which}, such as {frame_name(missing[0])} (name a list of those here by --targets)")
        for image in targets.counts:
            truth.image(*image, with_depth=False)
    except VerefineError as error:
        parts.scoring = str(error)


def _check_images(dataset: BopDataset, sampled: Sequence[tuple[int, int]], parts: Parts) -> None:
    """Frames without colour are named, and nothing is wrong with them."""
    faults: list[str] = []
    medians_m: list[float] = []
    colourless: list[str] = []
    for ids in sampled:
        try:
            image = dataset.image(*ids)
        except VerefineError as error:
            faults.append(str(error))
            continue
        medians_m.append(float(np.median(image.depth_m[image.depth_m > 0])))
        faults += [f"image {frame_name(ids)}: {note}" for note in image.notes if note != NO_COLOR]
        colourless += [frame_name(ids)] * (image.rgb is None)
    parts.depth = bool(medians_m)
    opened = f"{len(medians_m)} of {len(sampled)} frames checked"
    result = f"median {np.median(medians_m):.2f} m in {opened}" if medians_m else f"none could be read in {opened}"
    if colourless:
        which = "all of them" if len(colourless) == len(medians_m) else first_of(colourless, MOST_NAMED)
        result += f"; no rgb or gray image in {which}: drawn without colour, which is optional"
    parts.add("depth and colour", result, "; ".join(dict.fromkeys(faults)))


def _check_masks(dataset: BopDataset, sampled: list[tuple[int, int]], parts: Parts) -> None:
    scenes: list[Path] = []
    for scene_id in dataset.scene_ids:
        with suppress(VerefineError):  # Reported already.
            scenes.append(dataset.scene_folder(scene_id))
    kinds: list[MaskFolder] = [
        kind for kind in get_args(MaskFolder) if scenes and all((s / kind).is_dir() for s in scenes)
    ]
    detections = dataset.detection_files()
    parts.masks, parts.detections = (*kinds, *detections), bool(detections)
    none = "" if parts.masks else f"masks are needed: {_without_masks(scenes)}, or a detections JSON"
    unreadable, small = list[str](), list[str]()
    for ids in sampled:
        _check_masks_of_frame(dataset, ids, kinds, unreadable, small)
    faults = [first_of(list(dict.fromkeys(unreadable)), MOST_FAULTS, "; ")] * bool(unreadable)
    if small:
        faults.append(
            f"{first_of(small, MOST_FAULTS)}, expected at least {FEWEST_MASK_PX} px, as no pose is found with fewer; "
            f"where an object is hidden, state a visib_fract below {VISIB_FRACT:g} in scene_gt_info.json"
        )
    parts.add("masks", ", ".join(parts.masks) or "none", none or "; ".join(faults))
    check_truths(dataset, sampled, parts)


def _without_masks(scenes: Sequence[Path]) -> str:
    """What is missing; folders of masks count where every scene has one."""
    lacking = [scene.name for scene in scenes if not any((scene / kind).is_dir() for kind in get_args(MaskFolder))]
    if not lacking or len(lacking) == len(scenes):
        return "a folder mask_visib/ per scene"
    return f"a folder mask_visib/ in every scene, also in {first_of(lacking, MOST_FAULTS)}"


def _check_masks_of_frame(
    dataset: BopDataset, ids: tuple[int, int], kinds: Sequence[MaskFolder], unreadable: list[str], small: list[str]
) -> None:
    """Adds what is wrong with the masks of a frame's annotated instances; other faults of it are reported already.

    A mask may be empty or nearly so where the object is known to be hidden.
    """
    with suppress(VerefineError):
        shape, truths = dataset.image(*ids).camera.shape, dataset.ground_truth(*ids) or ()
        for truth, kind in product(truths, kinds):
            try:
                n = np.count_nonzero(dataset.mask(*ids, truth.gt_id, kind, shape))
            except VerefineError as error:
                unreadable.append(str(error))
                continue
            if n < FEWEST_MASK_PX and (truth.visib_fract is None or truth.visib_fract >= VISIB_FRACT):
                small.append(f"{kind} of entry {truth.gt_id} in {frame_name(ids)} covers {n} px")
