"""Notes about single objects of a data set's frame."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from verefine_viz.core.data_remedies import MADE_FROM_TRUTH
from verefine_viz.core.frame_names import FrameIds
from verefine_viz.core.geometry import FARTHEST_M, apply, distance_m
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.problem import Instance
from verefine_viz.core.text_format import listed
from verefine_viz.scenes.hypothesis_pool import ResultsFile
from verefine_viz.scenes.segments import FEWEST_MASK_PX

FAR = 2.5
"""Initial poses that are so many times as far away as the depth in their mask get a note. Estimates are wrong at times,
but the worst of 36 real ones (YCB-V, four methods) lay at 1.16 times the depth."""
_FAR_FROM_DEPTH = "far from the depth inside its mask"


def instance_notes(
    ids: FrameIds,
    instances: Sequence[Instance],
    models: Mapping[int, ObjectModel],
    source: str,
    files: Sequence[ResultsFile],
) -> tuple[str, ...]:
    """A sentence for what an object lacks, and where its depth is not where its poses are.

    Args:
        ids: of the frame.
        instances: of the frame.
        models: by obj_id.
        source: where initial poses come from (``hypotheses.source``).
        files: results files that they come from.
    """
    notes: list[str] = []
    for instance in instances:
        model = models[instance.obj_id]
        name = _name(instance, model)
        if not instance.hypotheses and source == "results":
            notes.append(f"{without(instance, model)}{_no_pose_reason(ids, instance, instances, files)}")
        if not instance.hypotheses and source == "perturb":
            notes.append(
                f"{without(instance, model)}there is no ground truth to disturb; set hypotheses.source to 'results' "
                "and name results files"
            )
        n_pixels = np.count_nonzero(instance.mask)
        if n_pixels < FEWEST_MASK_PX:
            notes.append(
                f"{name}: its mask covers {n_pixels} px, too few to find a pose; expected at least {FEWEST_MASK_PX}"
            )
        if len(instance.points_cam):
            seen_m = float(np.median(instance.points_cam[:, 2]))
            elsewhere = [*_elsewhere(instance, seen_m, model.diameter_m)] or [*_beside(instance, model)]
            notes += [f"{name}: {sentence}" for sentence in elsewhere]
        else:
            notes.append(f"{name} has no depth inside its mask")
    return tuple(notes)


def within_reach(instance: Instance, model: ObjectModel) -> tuple[Instance, tuple[str, ...]]:
    """The instance without initial poses that are further away than ``FARTHEST_M``, and a sentence about these."""
    far = [h for h in instance.hypotheses if distance_m(h.T_cam_obj) > FARTHEST_M]
    if not far:
        return instance, ()
    left = tuple(h for h in instance.hypotheses if distance_m(h.T_cam_obj) <= FARTHEST_M)
    n, n_all = len(far), len(instance.hypotheses)
    begin = (
        f"{_name(instance, model)}: {n} of its {n_all} poses" if left else f"{without(instance, model)}{n} of {n_all}"
    )
    note = (
        f"{begin} {'is' if n == 1 else 'are'} left out, more than {FARTHEST_M:g} m away, "
        f"{'such as ' if n > 1 else ''}{far[0].source}'s at {distance_m(far[0].T_cam_obj):.3g} m; "
        "check the unit of the translation"
    )
    return replace(instance, hypotheses=left), (note,)


def without(instance: Instance, model: ObjectModel) -> str:
    """How the note of an instance without hypotheses begins; the reason follows."""
    return f"{_name(instance, model)} has no hypothesis: "


def is_about_initial_poses(note: str, instance: Instance, model: ObjectModel) -> bool:
    """Whether a note is about the initial poses that an instance has, or that it has none."""
    is_far = note.startswith(f"{_name(instance, model)}: ") and _FAR_FROM_DEPTH in note
    return is_far or note.startswith(without(instance, model))


def _name(instance: Instance, model: ObjectModel) -> str:
    return f"{model.name} (#{instance.instance_id})"


def _no_pose_reason(
    ids: FrameIds, instance: Instance, instances: Sequence[Instance], files: Sequence[ResultsFile]
) -> str:
    """Why no row of ``files`` is an initial pose of an instance."""
    rows = {file.method: len(file.rows.get((*ids, instance.obj_id), ())) for file in files}
    where, n = f"for object {instance.obj_id} of this frame in", sum(rows.values())
    if n == 0:
        return f"no row {where} {', '.join(rows)}"
    owners = [f"#{other.instance_id}" for other in instances if other.obj_id == instance.obj_id and other.hypotheses]
    went = f"{'the only row' if n == 1 else f'all {n} rows'} {where} {', '.join(m for m, some in rows.items() if some)}"
    masks = "mask fits" if len(owners) == 1 else "masks fit"
    return f"{went} went to {listed(owners)}, whose {masks} better; add a row whose pose lies in this mask"


def _elsewhere(instance: Instance, seen_m: float, diameter_m: float) -> Iterator[str]:
    """A sentence about initial poses that are not where the depth inside the mask (``seen_m``) is."""
    away_m = [float(h.T_cam_obj[2, 3]) for h in instance.hypotheses]
    far = [k for k, z_m in enumerate(away_m) if z_m <= 0 or z_m > max(FAR * seen_m, seen_m + diameter_m)]
    if far:
        whose, z_m = instance.hypotheses[far[0]].source, away_m[far[0]]
        n = f"{len(far)} of its {len(away_m)} poses lie{'s' * (len(far) == 1)}" if len(away_m) > 1 else "its pose lies"
        such = f"{'such as ' * (len(far) > 1)}{whose}'s " + (f"at {z_m:.3g} m" if z_m > 0 else "behind the camera")
        yield f"{n} {_FAR_FROM_DEPTH} ({seen_m:.3g} m), {such}"


def _beside(instance: Instance, model: ObjectModel) -> Iterator[str]:
    """A sentence where every estimated pose lies further than the model is large from all depth inside the mask."""
    given = [h for h in instance.hypotheses if not h.source.startswith(MADE_FROM_TRUTH)]
    middles_cam = [apply(h.T_cam_obj, model.points.mean(axis=0)) for h in given]
    away_m = [float(np.linalg.norm(instance.points_cam - middle, axis=1).min()) for middle in middles_cam]
    if away_m and min(away_m) > model.diameter_m:
        which = "its pose lies" if len(given) == 1 else f"all {len(given)} poses lie"
        yield f"{which} {_FAR_FROM_DEPTH}, {min(away_m):.2g} m from it; check pose, mask and cam_K"
