"""What a person should know about single objects of a data set's frame."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from verefine_viz.core.model import ObjectModel
from verefine_viz.core.problem import Instance
from verefine_viz.scenes.pool import ResultsFile


def instance_notes(
    instances: Sequence[Instance], models: Mapping[int, ObjectModel], source: str, files: Sequence[ResultsFile]
) -> tuple[str, ...]:
    """A sentence for whatever an object lacks, and where its depth is not where its true pose is.

    Args:
        instances: of the frame.
        models: by obj_id.
        source: where first poses come from (``hypotheses.source``).
        files: results files that they come from.
    """
    notes: list[str] = []
    for instance in instances:
        name = f"{models[instance.obj_id].name} (#{instance.instance_id})"
        if len(instance.points_cam) == 0:
            notes.append(f"{name} has no depth inside its mask")
        if not instance.hypotheses and source == "results":
            named = ", ".join(file.method for file in files)
            notes.append(f"{name} has no hypothesis: no row for object {instance.obj_id} of this frame in {named}")
        if not instance.hypotheses and source == "perturb":
            notes.append(
                f"{name} has no hypothesis: there is no ground truth to disturb; set hypotheses.source to 'results' "
                "and name results files"
            )
        if instance.T_cam_obj_gt is not None and len(instance.points_cam):
            seen_m, true_m = float(np.median(instance.points_cam[:, 2])), float(instance.T_cam_obj_gt[2, 3])
            if true_m <= 0:
                notes.append(f"{name}: its ground truth lies behind the camera ({true_m:.3g} m)")
            elif not 0.5 < seen_m / true_m < 2 and abs(seen_m - true_m) > models[instance.obj_id].diameter_m:
                notes.append(
                    f"{name}: depth inside its mask is {seen_m:.3g} m, its ground truth says {true_m:.3g} m; "
                    "check 'depth_scale' in scene_camera.json, and that 'cam_t_m2c' in scene_gt.json is in millimetres"
                )
    return tuple(notes)
