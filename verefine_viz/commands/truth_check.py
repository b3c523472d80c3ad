"""Whether the ground truth of a split can be read, and belongs to the models and images that are there."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress

from verefine_viz.commands.dataset_parts import MOST_FAULTS, Parts
from verefine_viz.commands.instance_check import unequal_counts
from verefine_viz.core.errors import VerefineError
from verefine_viz.core.jsonfile import read_json
from verefine_viz.core.listing import first_of
from verefine_viz.scenes.bop import BopDataset, GroundTruth


def check_truths(dataset: BopDataset, sampled: Sequence[tuple[int, int]], parts: Parts) -> None:
    """Adds what is there and what is wrong; frames whose ground truth is damaged do not stop the others."""
    truths: list[Sequence[GroundTruth]] = []
    damage: list[str] = []
    for ids in sampled:
        try:
            truths.append(dataset.ground_truth(*ids) or ())
        except VerefineError as error:
            damage.append(str(error))
    damage = list(dict.fromkeys([*damage, *_odd_keys(dataset)]))
    n_with = sum(bool(mine) for mine in truths)
    parts.ground_truth = n_with > 0
    parts.damaged_truth = damage[0] if damage and not parts.ground_truth else ""
    faults = [first_of(damage, MOST_FAULTS, "; ")] * bool(damage)
    faults += [t.fault for mine in truths for t in mine if t.fault][:MOST_FAULTS]
    if parts.masks and not parts.names_objects and not damage:
        faults.append(
            "nothing says which object is where: add scene_gt.json to the scenes, or a detections JSON (its name "
            f"holds “detect”) to {dataset.folder}"
        )
    strangers = sorted({t.obj_id for mine in truths for t in mine} - set(dataset.models.ids))
    if strangers and dataset.models.ids:
        faults.append(f"there is no model of object {', '.join(map(str, strangers))}; its instances are left out")
    where = f"in {n_with} of {len(sampled)} frames looked at"
    without = "damaged" if damage else "none: nothing can be measured, only looked at"
    parts.add("ground truth", where if n_with else without, "; ".join(faults))
    unequal = first_of(unequal_counts(dataset), MOST_FAULTS, "; ")
    if unequal:
        needed = (
            "all must list the same instances in the same order; evaluate refuses images where scene_gt_info differs"
        )
        parts.add("instances", "not the same in all files", f"{unequal}; {needed}")


def _odd_keys(dataset: BopDataset) -> Iterator[str]:
    """What in each scene's file is called by no number of an image, and would never be looked at."""
    for scene_id in dataset.scene_ids:
        path = dataset.scene_folder(scene_id) / "scene_gt.json"
        with suppress(VerefineError):  # Not there, or said already.
            odd = [key for key in read_json(path, dict) if not key.isdecimal()]
            if odd:
                yield f"{path} has {odd[0]!r} for an image, expected its number, as in {{'0': […], '1': […]}}"
