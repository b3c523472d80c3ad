"""Whether the ground truth of a split can be read, and belongs to the models and images that are there."""

from __future__ import annotations

from collections.abc import Sequence

from verefine_viz.commands.dataset_parts import MOST_FAULTS, Parts
from verefine_viz.commands.instance_check import unequal_counts
from verefine_viz.core.errors import VerefineError
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
    damage = list(dict.fromkeys(damage))
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
