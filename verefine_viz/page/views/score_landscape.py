"""The score around a pose: curves along twelve axes, a map over two of them, and what fits as well: ``landscape``."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from verefine_viz.core.errors import InputError
from verefine_viz.diagnosis.other_pose import describe
from verefine_viz.evaluation.pose_axes import N_AXES
from verefine_viz.page import protocol as p
from verefine_viz.page.answers_to_wants import CurvesAnswer, OtherAnswer, OtherPose, ScoreCurve, SliceAnswer, SliceAxis
from verefine_viz.page.blobs import Blobs
from verefine_viz.page.frame_objects import labels_of
from verefine_viz.page.wire import pose_numbers

if TYPE_CHECKING:
    from verefine_viz.core.arrays import Float
    from verefine_viz.evaluation.near_symmetry import NearSymmetry
    from verefine_viz.evaluation.pose_landscape import Curve
    from verefine_viz.page.workspace import Workspace

SAME_AXIS = 0.99
"""Cosine of the angle up to which two axes of near symmetries count as one."""


def landscape(space: Workspace, want: p.LandscapeWanted, blobs: Blobs) -> CurvesAnswer | SliceAnswer | OtherAnswer:
    """Return one part of the landscape around a pose of an object.

    Raises:
        InputError: there is no such object or axis.
    """
    branch = space.branch(want.branch)
    problem, evaluator = branch.run.problem, branch.evaluator_of(want.k)
    target, T_cam_obj = problem.target(want.obj), p.pose_matrix(want.T)
    iterations = branch.run.iterations
    allowed = evaluator.allowed(target, T_cam_obj, iterations)
    if want.part == "curves":
        around = evaluator.landscape(target, T_cam_obj, iterations)
        return CurvesAnswer(
            T=pose_numbers(T_cam_obj),
            score=allowed.score,
            curves=[_curve(k, curve, T_cam_obj) for k, curve in enumerate(around.curves)],
            undetermined=allowed.least_certain.describe(),
            undetermined_mm=allowed.undetermined_mm,
            undetermined_deg=allowed.undetermined_deg,
        )
    if want.part == "slice":
        if max(want.axes) >= N_AXES:
            raise InputError(f"there is no axis {max(want.axes)}, expected 0 to {N_AXES - 1}")
        return _slice(evaluator.score_slice(target, T_cam_obj, want.axes, iterations), T_cam_obj)
    other, name = allowed.furthest, labels_of(problem)[want.obj]
    return OtherAnswer(
        other=other
        and OtherPose(
            T=pose_numbers(other.T_cam_obj),
            score=other.score,
            score_of_answer=other.score_of_answer,
            noise=other.noise,
            apart_mm=other.apart_mm,
            words=describe(name, allowed, other),
        ),
        near=_describe_turns(evaluator.near_symmetries(target.model)),
    )


def _curve(number: int, curve: Curve, T_cam_obj: Float) -> ScoreCurve:
    """Return a curve with the pose of each of its samples."""
    axis, extent = curve.axis, curve.extent
    return ScoreCurve(
        axis=number,
        frame=axis.frame,
        kind=axis.kind,
        words=axis.words,
        unit=axis.unit,
        offsets=curve.offsets.tolist(),
        scores=curve.scores.tolist(),
        low=extent.low,
        high=extent.high,
        width=extent.width_text,
        poses=[pose_numbers(axis.moved(T_cam_obj, x)) for x in curve.offsets.tolist()],
    )


def _slice(two: Any, T_cam_obj: Any) -> SliceAnswer:
    n = len(two.scores)
    return SliceAnswer(
        across=SliceAxis(two.across.words, two.across.unit, two.across_offsets.tolist()),
        up=SliceAxis(two.up.words, two.up.unit, two.up_offsets.tolist()),
        scores=two.scores.tolist(),
        poses=[[pose_numbers(two.pose(T_cam_obj, column, row)) for column in range(n)] for row in range(n)],
    )


def _describe_turns(symmetries: Sequence[NearSymmetry]) -> list[str]:
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
