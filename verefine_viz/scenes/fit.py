"""A glance at whether the depth of a frame, its true poses and those of results files are of the same world.

No image is drawn for it: the depth inside an object's mask is compared with the points of its model in a given pose.
What is off there by a factor, an axis or another camera is off for all objects, while a bad mask, a hidden object or a
poor estimate is off alone; so the objects of a frame are judged together.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path

import numpy as np
from scipy.spatial import KDTree

from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import apply, inverse, transform
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.problem import Hypothesis, Instance
from verefine_viz.scenes.pool import ResultsFile

POINTS = 100
"""Observed points per object that are looked at; as many as a median needs."""
FAR = 0.25
"""Depth that lies further than this from a model, as a share of its diameter, does not show the model there. In true
poses of YCB-V it lies within 0.03; where the camera's matrix is of an image of another size, at 0.3 and more."""
NEAR = 0.06
"""Depth that lies within this share of the diameter shows the model in about the right pose."""
TOO_NEAR = (5, 20)
"""So many times further than a file's pose lies the depth that belongs to it, where t is in centimetres: 10 times, give
or take what the object's own size adds."""
FEW = 3
"""Objects below which chance, or one wrong detection, may look like a rule."""


def truth_notes(
    instances: Sequence[Instance], models: Mapping[int, ObjectModel], dataset: Path, are_detected: bool
) -> tuple[str, ...]:
    """A note where the depth of a frame's objects lies nowhere near their true poses.

    Args:
        instances: of the frame.
        models: by obj_id.
        dataset: its folder, for the advice.
        are_detected: masks are detections, each of which may be of something else.
    """
    off = [
        distance(instance.points_cam, models[instance.obj_id], instance.T_cam_obj_gt)
        for instance in instances
        if instance.T_cam_obj_gt is not None and len(instance.points_cam)
    ]
    if len(off) < (FEW if are_detected else 1) or np.median(off) < FAR:
        return ()
    return (
        "depth in the objects' masks lies nowhere near their true poses: intrinsics, depth_scale and the units of "
        "models and ground truth do not belong together, so scores or errors are wrong; "
        f"`verefine-viz datasets check {dataset}` tells more",
    )


def pose_notes(
    files: Sequence[ResultsFile], instances: Sequence[Instance], models: Mapping[int, ObjectModel]
) -> tuple[str, ...]:
    """Which of ``files`` seem to give translations in centimetres, or rotations column by column.

    Args:
        files: that the hypotheses come from.
        instances: of a frame, with their hypotheses.
        models: by obj_id.
    """
    notes: list[str] = []
    for file in files:
        first = [(i, next((h for h in i.hypotheses if h.source == file.method), None)) for i in instances]
        posed = [(i, h) for i, h in first if h is not None and len(i.points_cam)]
        if posed and all(_is_tenfold(instance, hypothesis) for instance, hypothesis in posed):
            notes.append(
                f"{file.name}: every pose lies at about a tenth of the depth in its object's mask, so t looks like "
                "centimetres; BOP wants millimetres: multiply t by 10 (or depth_scale is 10 times too large)"
            )
        elif _fit_transposed([(i.points_cam, models[i.obj_id], h.T_cam_obj) for i, h in posed]):
            notes.append(
                f"{file.name}: the depth fits the poses far better with every R transposed, so R looks written column "
                "by column; BOP wants it row by row"
            )
    return tuple(notes)


def distance(points_cam: Float, model: ObjectModel, T_cam_obj: Float) -> float:
    """Median distance of observed points (N, 3) [m] to a posed model, as a share of its diameter."""
    some = sample(points_cam)
    return float(np.median(_tree(model).query(apply(inverse(T_cam_obj), some))[0])) / model.diameter_m


def sample(points_cam: Float) -> Float:
    """As many of the points (N, 3) as are looked at, a copy; of a sample all."""
    return points_cam[:: max(1, len(points_cam) // POINTS)].copy()


def share_near(points_cam: Float, model: ObjectModel, T_cam_obj: Float, near_m: float) -> float:
    """Share of observed points (N, 3) [m], N > 0, that lie within ``near_m`` of a posed model."""
    some = sample(points_cam)
    return float(np.mean(_tree(model).query(apply(inverse(T_cam_obj), some))[0] < near_m))


@lru_cache(maxsize=64)
def _tree(model: ObjectModel) -> KDTree:
    return KDTree(model.points, balanced_tree=False, compact_nodes=False)


def _is_tenfold(instance: Instance, hypothesis: Hypothesis) -> bool:
    """Whether a pose lies at a tenth of the depth of its object, and of its true depth where that is known."""
    nearest, farthest = TOO_NEAR
    z_m, T_gt = float(hypothesis.T_cam_obj[2, 3]), instance.T_cam_obj_gt
    known_m = [float(np.median(instance.points_cam[:, 2]))] + ([] if T_gt is None else [float(T_gt[2, 3])])
    return all(nearest * z_m < known < farthest * z_m for known in known_m)


def _fit_transposed(posed: Sequence[tuple[Float, ObjectModel, Float]]) -> bool:
    """Whether transposed rotations explain what is seen of most objects, and of none worse."""
    if len(posed) < FEW:
        return False
    off = np.array([distance(*one) for one in posed])
    if np.median(off) < NEAR:
        return False
    turned = np.array([distance(seen, model, transform(T[:3, :3].T, T[:3, 3])) for seen, model, T in posed])
    return bool(np.median(turned) < min(NEAR, 0.6 * np.median(off)) and (turned < 1.1 * off).all())
