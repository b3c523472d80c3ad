"""What makes physics doubtful in a frame: its plane, gravity, measured heights, and objects that stand on others."""

from __future__ import annotations

from typing import TYPE_CHECKING

from verefine_viz.core.observation import TILT_SHOWN_DEG, Support
from verefine_viz.core.problem import Target
from verefine_viz.diagnosis.plane_doubt import plane_doubt
from verefine_viz.methods.known_methods import method_of
from verefine_viz.page.frame_objects import labels_of

if TYPE_CHECKING:
    from verefine_viz.page.branch import Branch

RAISED_M = 0.02
"""By ground truth an object whose lowest point is higher above the support plane stands on something [m]."""
GRAVITY_FROM = {"plane": "its normal", "world": "the camera's pose", "given": "scene.gravity"}


def doubts_of(branch: Branch, support: Support | None) -> list[str]:
    """Return what makes physics doubtful here: the plane, gravity, heights, and objects that stand on others."""
    if support is None:
        return []
    doubts = [plane_doubt(support)]
    if support.tilt_deg > TILT_SHOWN_DEG:
        doubts.append(
            f"The support plane is tilted by {support.tilt_deg:.1f}° against gravity "
            f"({GRAVITY_FROM[support.gravity_source]}): the table leans, or one of the two is wrong."
        )
    heights = branch.measured_heights()
    if heights is not None:
        doubts.append(heights.describe())
    method = method_of(branch.settings.method.name)
    if not method.knows_others and method.simulates and branch.settings.physics.enabled and not branch.doubts():
        stacked = _stacked(branch)
        if stacked:
            doubts.append(
                f"{method.label} settles every object on the table alone: {'; '.join(stacked[:3])}, so "
                f"{'it sinks' if len(stacked) == 1 else 'they sink'} in the simulation. VF_b and VF_d place what "
                "supports others first."
            )
    return [doubt for doubt in doubts if doubt]


def _stacked(branch: Branch) -> list[str]:
    """Return objects that stand on others: by the dependency graph, else by ground truth."""
    problem = branch.run.problem
    labels, support, out = labels_of(problem), problem.observation.support, []
    below: dict[int, list[str]] = {}
    for edge in problem.dependencies.edges if problem.dependencies else ():
        if edge.kind == "support" and edge.state != "cut" and edge.first in labels and edge.second in labels:
            below.setdefault(edge.second, []).append(labels[edge.first])
    is_plane = support is None or support.surroundings is None
    for target in problem.targets:
        own, height_m = target.instance.instance_id, height_above_plane_m(target)
        if own in below:
            out.append(f"{labels[own]} stands on {' and '.join(below[own])}")
        elif is_plane and height_m is not None and height_m > RAISED_M:
            out.append(f"{labels[own]} stands {height_m * 1e3:.0f} mm above the table")
    return out


def height_above_plane_m(target: Target) -> float | None:
    """Return how high an object's lowest vertex is above the support plane by ground truth [m]; None without either."""
    T_cam_obj, support = target.instance.T_cam_obj_gt, target.observation.support
    if T_cam_obj is None or support is None:
        return None
    T_world_obj, up = support.T_world_cam @ T_cam_obj, support.normal_world
    return float((target.model.vertices @ (T_world_obj[:3, :3].T @ up)).min() + T_world_obj[:3, 3] @ up)
