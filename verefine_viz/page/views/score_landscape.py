"""The score around a pose: curves along twelve axes, a map over two of them, and what fits as well: ``landscape``."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from verefine_viz.core.errors import InputError
from verefine_viz.diagnosis.ambiguity import describe
from verefine_viz.evaluation.landscape import CANNOT_TELL, N_AXES, Curve, Landscape
from verefine_viz.evaluation.near_symmetry import NearSymmetry
from verefine_viz.page import protocol as p
from verefine_viz.page.blobs import Blobs
from verefine_viz.page.moment import labels_of, moment_of
from verefine_viz.page.views.rows import pose_list
from verefine_viz.page.workspace import Workspace

Json = dict[str, Any]
SAME_AXIS = 0.99
"""Cosine of the angle up to which two axes of near symmetries count as one."""


def landscape(space: Workspace, want: p.LandscapeWanted, blobs: Blobs) -> Json:
    """Return one part of the landscape of an object's best pose after iteration k.

    Raises:
        InputError: the object has no pose, or there is no such axis.
    """
    branch = space.branch(want.branch)
    is_answer = branch.run.is_done and want.k == branch.run.length > 0
    moment = moment_of(branch, p.Look(branch=want.branch, k=want.k, obj=want.obj, answer=is_answer))
    target, evaluator = moment.target, moment.evaluator
    T_cam_obj = moment.poses.get("best")
    if T_cam_obj is None:
        raise InputError("this object has no pose")
    around = evaluator.landscape(target, T_cam_obj)
    if want.part == "curves":
        return {
            "T": pose_list(T_cam_obj),
            "score": around.score,
            "curves": [_curve(around, k, curve) for k, curve in enumerate(around.curves)],
            "undetermined": around.least_certain.describe(),
            "undetermined_mm": around.undetermined_mm,
            "undetermined_deg": around.undetermined_deg,
        }
    if want.part == "slice":
        if max(want.axes) >= N_AXES:
            raise InputError(f"there is no axis {max(want.axes)}, expected 0 to {N_AXES - 1}")
        return _slice(evaluator.score_slice(target, T_cam_obj, want.axes), T_cam_obj)
    other = evaluator.other_pose(target, T_cam_obj, branch.run.iterations_of(want.obj))
    name = labels_of(moment.problem)[want.obj]
    return {
        "other": other
        and {
            "T": pose_list(other.T_cam_obj),
            "score": other.score,
            "score_of_answer": other.score_of_answer,
            "noise": other.noise,
            "apart_mm": other.apart_mm,
            "words": describe(name, around, other),
        },
        "near": describe_turns(evaluator.near_symmetries(target.model)),
    }


def _curve(around: Landscape, number: int, curve: Curve) -> Json:
    """Return a curve with the pose of each of its samples."""
    axis = curve.axis
    return {
        "axis": number,
        "frame": axis.frame,
        "kind": axis.kind,
        "words": axis.words,
        "unit": axis.unit,
        "offsets": curve.offsets.tolist(),
        "scores": curve.scores.tolist(),
        "noise": (CANNOT_TELL * curve.noise).tolist(),
        "low": curve.low,
        "high": curve.high,
        "width": curve.width_text,
        "poses": [pose_list(axis.moved(around.T_cam_obj, x)) for x in curve.offsets.tolist()],
    }


def _slice(two: Any, T_cam_obj: Any) -> Json:
    n = len(two.scores)
    return {
        "across": {"words": two.across.words, "unit": two.across.unit, "offsets": two.across_offsets.tolist()},
        "up": {"words": two.up.words, "unit": two.up.unit, "offsets": two.up_offsets.tolist()},
        "scores": two.scores.tolist(),
        "poses": [[pose_list(two.pose(T_cam_obj, column, row)) for column in range(n)] for row in range(n)],
    }


def describe_turns(symmetries: Sequence[NearSymmetry]) -> list[str]:
    """List the turns after which a shape nearly looks the same: "180° about 3 axes: 1.4 to 1.8 mm apart"."""
    alike: dict[str, list[float]] = {}
    for axis in _by_axis(symmetries):
        angle = "any angle" if axis[0].is_continuous else f"{axis[0].angle_deg:.0f}°"
        alike.setdefault(angle, []).append(1e3 * max(one.distance_m for one in axis))
    lines: list[str] = []
    for angle, mm in alike.items():
        about = "" if len(mm) == 1 else f" about {len(mm)} axes"
        low, high = f"{min(mm):.1f}", f"{max(mm):.1f}"
        lines.append(f"{angle}{about}: {high if low == high else f'{low} to {high}'} mm apart")
    return lines


def _by_axis(symmetries: Sequence[NearSymmetry]) -> list[list[NearSymmetry]]:
    """Sort those about the same axis together, the least turn of each axis first."""
    axes: list[list[NearSymmetry]] = []
    for one in sorted(symmetries, key=lambda s: (not s.is_continuous, s.angle_deg)):
        same = next((axis for axis in axes if abs(axis[0].axis @ one.axis) > SAME_AXIS), None)
        if same is None:
            axes.append([one])
        else:
            same.append(one)
    return axes
