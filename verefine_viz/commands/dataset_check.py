"""Carries out ``verefine-viz datasets check``: what a BOP folder has, what is damaged, and whether it fits together."""

from __future__ import annotations

import re
from collections.abc import Sequence
from contextlib import suppress
from itertools import product
from pathlib import Path
from typing import get_args

import numpy as np

from verefine_viz.calibration.consistency import data_doubts
from verefine_viz.commands.dataset_parts import Parts
from verefine_viz.core.doubt import texts_of
from verefine_viz.core.errors import InputError, VerefineError
from verefine_viz.core.frame_names import FrameIds, frame_name
from verefine_viz.core.settings import HypothesesSettings, SceneSettings
from verefine_viz.core.text_format import MOST_NAMED, first_of
from verefine_viz.evaluation.bop_model import EvalModels
from verefine_viz.evaluation.ground_truth import (
    VISIB_FRACT,
    BopGroundTruth,
    read_targets,
    visible_targets,
)
from verefine_viz.scenes.annotations import GroundTruth, targets_path
from verefine_viz.scenes.bop import NO_COLOR, BopDataset
from verefine_viz.scenes.bop_files import MaskFolder, SceneFiles
from verefine_viz.scenes.bop_source import BopSource
from verefine_viz.scenes.segments import FEWEST_MASK_PX

N_OPENED = 40
"""Most frames of a split that are opened, spread evenly: about half a second each."""
MOST_FAULTS = 3
"""Most faults of one kind that are named."""


def check_split(folder: Path, split: str, sensor: str = "") -> Parts:
    """Check one split of a data set, of one sensor. What is missing or wrong is a finding, not an error."""
    parts = Parts()
    try:
        dataset = BopDataset(folder, split, sensor=sensor)
    except VerefineError as error:
        parts.add("models", "cannot be used", str(error))
        parts.skip("all the rest", "not checked, because it needs models")
        parts.before_all = f"models ({error}); nothing else was checked"
        return parts
    _check_models(dataset, parts)
    frames = _check_frames(dataset, parts)
    if not frames:
        parts.skip("all the rest", "not checked, because there are no frames yet")
        return parts
    opened = [frames[int(k)] for k in np.linspace(0, len(frames) - 1, min(N_OPENED, len(frames))).round()]
    _check_images(dataset, opened, parts)
    _check_masks(dataset, opened, parts)
    _check_truths(dataset, frames, opened, parts)
    _check_scoring(dataset, opened, parts)
    _check_plausibility(dataset, opened, parts)
    return parts


def _check_models(dataset: BopDataset, parts: Parts) -> None:
    library, faults, n_read = dataset.models, [*dataset.models.faults], 0
    for obj_id in library.ids:
        try:
            faults += library.notes(obj_id)
            n_read += 1
        except VerefineError as error:
            faults.append(str(error))
    parts.models = n_read > 0
    if not library.ids:
        faults.append("expected meshes, obj_000001.ply and so on: fetch the archive with the models and unpack it here")
    parts.add("models", f"{len(library.ids)} in {library.folder.name}/", "; ".join(faults))
    if not (dataset.folder / "models_eval").is_dir() and library.folder.name != "models_eval":
        parts.add("models_eval", "not there: errors are measured on models/, the benchmark's own on models_eval/")


def _check_frames(dataset: BopDataset, parts: Parts) -> list[FrameIds]:
    frames: list[FrameIds] = []
    why = "no scene_camera.json lists any"
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
    parts.before_all = "" if frames else f"frames ({why}); nothing else was checked"
    for note in dataset.sensor_notes(dict.fromkeys(scene_id for scene_id, _ in frames)):
        parts.add("sensor", note)
    targets = dataset.targets or {}
    if dataset.target_notes:
        parts.add("targets", "damaged", "; ".join(dataset.target_notes))
        return frames
    missing = sorted(targets.keys() - set(frames))
    if len(missing) == len(targets) > 0:
        such = f"none of them is here (the first is {frame_name(missing[0])})"
        parts.add("targets", f"{len(targets)} frames", f"{such}: the targets belong to other images; all here are run")
    elif missing:  # Many fetch a part of a data set: no fault.
        here = f"{len(targets) - len(missing)} of its {len(targets)} frames are here"
        parts.add("targets", f"{here}; the others, such as {frame_name(missing[0])}, are left out")
    elif targets:
        parts.add("targets", f"{len(targets)} frames")
    return frames


def _check_images(dataset: BopDataset, opened: Sequence[FrameIds], parts: Parts) -> None:
    faults: list[str] = []
    medians_m: list[float] = []
    colourless: list[str] = []
    for ids in opened:
        try:
            image = dataset.image(*ids)
        except VerefineError as error:
            faults.append(str(error))
            continue
        medians_m.append(float(np.median(image.depth_m[image.depth_m > 0])))
        faults += [f"image {frame_name(ids)}: {note}" for note in image.notes if note != NO_COLOR]
        colourless += [frame_name(ids)] * (image.rgb is None)
        parts.with_camera_pose += image.R_world_cam is not None
    parts.depth = bool(medians_m)
    n, of = len(medians_m), f"{len(medians_m)} of {len(opened)} frames checked"
    result = f"median {np.median(medians_m):.2f} m in {of}" if medians_m else f"none could be read in {of}"
    if colourless:
        which = "all of them" if len(colourless) == n else first_of(colourless, MOST_NAMED)
        result += f"; no rgb or gray image in {which}: drawn without colour, which is optional"
    parts.add("depth and colour", result, first_of(list(dict.fromkeys(faults)), MOST_FAULTS, "; "))
    if parts.with_camera_pose:
        others = "; in the others scene.gravity world takes the table's normal"
        few = parts.with_camera_pose < n
        parts.add("camera poses", f"known for {parts.with_camera_pose} of {n} frames checked" + others * few)


def _check_masks(dataset: BopDataset, opened: Sequence[FrameIds], parts: Parts) -> None:
    scenes: list[SceneFiles] = []
    for scene_id in dataset.scene_ids:
        with suppress(VerefineError):  # Reported already.
            scenes.append(dataset.files(scene_id))
    kinds: list[MaskFolder] = [k for k in get_args(MaskFolder) if scenes and all(s.has_masks(k) for s in scenes)]
    detections = dataset.detection_files()
    parts.masks, parts.detections = (*kinds, *detections), bool(detections)
    if not parts.masks:
        lacking = [s.folder.name for s in scenes if not any(map(s.has_masks, get_args(MaskFolder)))]
        some = f"every scene, also in {first_of(lacking, MOST_FAULTS)}" if len(lacking) < len(scenes) else "each scene"
        parts.add("masks", "none", f"masks are needed: a folder mask_visib/ in {some}, or a detections JSON")
        return
    unreadable: list[str] = []
    small: list[str] = []
    for ids in opened:
        with suppress(VerefineError):  # Reported already.
            shape, truths = dataset.image(*ids).camera.shape, dataset.ground_truth(*ids) or ()
            for truth, kind in product(truths, kinds):
                try:
                    n = np.count_nonzero(dataset.mask(*ids, truth.gt_id, kind, shape))
                except VerefineError as error:
                    unreadable.append(str(error))
                    continue
                if n < FEWEST_MASK_PX and (truth.visib_fract is None or truth.visib_fract >= VISIB_FRACT):
                    small.append(f"{kind} of entry {truth.gt_id} in {frame_name(ids)} covers {n} px")
    faults = [first_of(list(dict.fromkeys(unreadable)), MOST_FAULTS, "; ")] * bool(unreadable)
    if small:
        faults.append(
            f"{first_of(small, MOST_FAULTS)}, expected at least {FEWEST_MASK_PX} px, as no pose is found with fewer; "
            f"where an object is hidden, state a visib_fract below {VISIB_FRACT:g} in scene_gt_info.json"
        )
    listed = " (of scene_gt_coco.json)" * any(s.are_masks_listed for s in scenes)
    parts.add("masks", ", ".join(kind + listed * (kind == "mask_visib") for kind in parts.masks), "; ".join(faults))


def _check_truths(dataset: BopDataset, frames: Sequence[FrameIds], opened: Sequence[FrameIds], parts: Parts) -> None:
    """Add what the split has and what is wrong; a damaged entry or frame does not stop the others."""
    truths: list[Sequence[GroundTruth]] = []
    damage: list[str] = []
    for ids in opened:
        try:
            truths.append(dataset.ground_truth(*ids) or ())
        except VerefineError as error:
            damage.append(str(error))
    n_with, damage = sum(map(bool, truths)), list(dict.fromkeys(damage))
    parts.ground_truth = n_with > 0
    parts.damaged_ground_truth = damage[0] if damage and not parts.ground_truth else ""
    left_out, rounded = dataset.truth_notes(frames)
    faults = [*left_out]
    if parts.masks and not parts.names_objects and not damage:
        faults.append(
            "nothing says which object is where: add scene_gt.json to the scenes, or a detections JSON (its name "
            f"holds “detect”) to {dataset.folder}"
        )
    without_model = sorted({t.obj_id for entries in truths for t in entries} - set(dataset.models.ids))
    if without_model and dataset.models.ids:
        faults.append(f"there is no model of object {', '.join(map(str, without_model))}; its instances are left out")
    without = "damaged" if damage else "none: nothing can be measured, only shown"
    result = f"in {n_with} of {len(opened)} frames checked" if n_with else without
    result += "".join(f"; {note.partition(': ')[2]}" for note in rounded)  # As published files are: nothing to mend.
    parts.add("ground truth", result, "; ".join(faults))


def _check_scoring(dataset: BopDataset, opened: Sequence[FrameIds], parts: Parts) -> None:
    """Check whether BOP scores find what they need besides images; refusals are reported in their words.

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


def _check_plausibility(dataset: BopDataset, opened: Sequence[FrameIds], parts: Parts) -> None:
    """Check whether images, models, masks and poses fit together, as when a frame is opened to be solved.

    The poses are ground truth, else those of the results files that lie in the folder, as in one of kept frames.
    """
    results = tuple(map(str, sorted(dataset.folder.glob(f"*_*-{dataset.split}.csv"))))
    by_truth = next((kind for kind in get_args(MaskFolder) if kind in parts.masks and parts.ground_truth), "")
    masks = by_truth or next((str(dataset.folder / name) for name in dataset.detection_files()), "")
    poses = parts.ground_truth or results
    there = {"models": parts.models, "depth": parts.depth, "masks": masks, "ground truth or a results file": poses}
    if lacking := " and ".join(what for what, is_there in there.items() if not is_there):
        parts.skip("plausibility", f"not checked, needs {lacking}")
        return
    frames = tuple(frame_name(ids) for ids in opened)
    scene = SceneSettings(
        source="bop",
        dataset=str(dataset.folder),
        split=dataset.split,
        sensor=dataset.sensor,
        masks=masks,
        frames=frames,
    )
    initial = HypothesesSettings(source="perturb")
    if results and not by_truth:
        initial = HypothesesSettings(source="results", files=results)
    checked: list[str] = []
    doubts: dict[str, dict[str, str]] = {}
    """Doubts of the frames, grouped by what would fit."""
    try:
        source = BopSource(scene, initial)
    except VerefineError as error:
        parts.add("plausibility", "not checked", str(error))
        return
    for frame in frames:
        with suppress(VerefineError):  # Reported already.
            problem = source.problem(frame)
            if any(i.T_cam_obj_gt is not None or i.hypotheses for i in problem.instances):
                checked.append(frame)
                for doubt in texts_of(data_doubts(problem)):
                    same = re.sub(r"\d[\d.]*", "#", re.sub(r"^what is seen of .*?; ", "", doubt))
                    doubts.setdefault(same, {}).setdefault(frame, doubt)
    what = "ground truth" if parts.ground_truth else "initial poses"
    if not checked:
        parts.skip("plausibility", f"not checked, because no frame with {what} can be opened")
        return
    n, n_off = len(checked), len({frame for of in doubts.values() for frame in of})
    does, fits = ("does", "fits") if parts.ground_truth else ("do", "fit")
    result = f"{does} not fit in {n_off} of {n}" if doubts else f"{fits} images, masks and models in {n} of {n}"
    often = [_in_frames(of, n) for of in sorted(doubts.values(), key=len, reverse=True)]
    parts.add("plausibility", f"{what} {result} frames checked", first_of(often, MOST_FAULTS, "; "))


def _in_frames(doubts: dict[str, str], n_checked: int) -> str:
    """One sentence for a doubt in several frames."""
    frame, doubt = next(iter(doubts.items()))
    every = "all " if len(doubts) == n_checked else ""
    return f"in {frame}: {doubt}" if len(doubts) == 1 else f"in {every}{len(doubts)} frames, such as {frame}: {doubt}"
