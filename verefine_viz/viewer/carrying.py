"""What stands on other objects, where the method settles every object on the support plane alone: there it sinks."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

from verefine_viz.core.listing import first_of
from verefine_viz.core.problem import Problem, Target
from verefine_viz.viewer.scene_now import labels_of
from verefine_viz.viewer.scene_words import ALONE, method_name

if TYPE_CHECKING:
    from verefine_viz.viewer.view import View

RAISED_M = 0.02
"""By ground truth an object whose lowest point is higher above the support plane stands on something [m]."""
MOST_NAMED = 3
"""Objects that a warning names."""


@dataclass(frozen=True)
class Carried:
    """An object that does not stand on the support plane."""

    instance_id: int
    where: str
    """As in: "stands on cereal", "stands 70 mm above the table"."""


def carried(view: View) -> tuple[Carried, ...]:
    """What stands on what, by the dependency graph or else by ground truth, where the method does not know of it.

    Nothing while the data are in doubt: how high objects stand above the table is measured in them.
    """
    method = view.session.method.name
    if method not in ALONE or method == "refine" or not view.session.physics.enabled or view.data_doubts:
        return ()
    return _carried(view.problem)


@lru_cache(maxsize=4)
def _carried(problem: Problem) -> tuple[Carried, ...]:
    labels = labels_of(problem)
    on: dict[int, list[str]] = {}
    for edge in problem.dependencies.edges if problem.dependencies else ():
        if edge.kind == "support" and edge.state != "cut" and edge.first in labels and edge.second in labels:
            on.setdefault(edge.second, []).append(labels[edge.first])
    found = []
    for target in problem.targets:
        own = target.instance.instance_id
        height_m = height_above_plane_m(target)
        if own in on:
            found.append(Carried(own, f"stands on {' and '.join(on[own])}"))
        elif height_m is not None and height_m > RAISED_M:
            found.append(Carried(own, f"stands {height_m * 1e3:.0f} mm above the table"))
    return tuple(found)


def height_above_plane_m(target: Target) -> float | None:
    """How high the lowest vertex of an object is above the support plane, by ground truth [m]; None without either."""
    T_cam_obj, support = target.instance.T_cam_obj_gt, target.observation.support
    if T_cam_obj is None or support is None:
        return None
    T_world_obj, up = support.T_world_cam @ T_cam_obj, support.normal_world
    # Turning the normal, not the vertices: the page asks this several times whenever it is drawn.
    return float((target.model.vertices @ (T_world_obj[:3, :3].T @ up)).min() + T_world_obj[:3, 3] @ up)


def alone_warning(view: View) -> str:
    """That what stands on other objects will sink through them; empty where nothing does."""
    found, labels = carried(view), labels_of(view.problem)
    if not found:
        return ""
    said = first_of([f"{labels[one.instance_id]} {one.where}" for one in found], MOST_NAMED, "; ")
    they = "it sinks" if len(found) == 1 else "they sink"
    return (
        f"{method_name(view.session.method.name)} settles every object on the table alone, as if the others were not "
        f"there: {said}, so {they} in the simulation. VF_b and VF_d place what carries first."
    )


def alone_hint(view: View, instance_id: int) -> str:
    """The same about one object; empty where it stands on the plane."""
    one = next((one for one in carried(view) if one.instance_id == instance_id), None)
    if one is None:
        return ""
    return f"{one.where}; {method_name(view.session.method.name)} settles it on the table alone, so it sinks"
