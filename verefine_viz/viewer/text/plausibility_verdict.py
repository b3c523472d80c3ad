"""Whether a pose is plausible, in plain words: verdicts, unsupported stacking, the support plane."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Literal

from verefine_viz.core.listing import first_of
from verefine_viz.core.observation import Support
from verefine_viz.core.problem import Problem, Target
from verefine_viz.methods.registry import method_of
from verefine_viz.physics.standing import IMPOSSIBLE_M, PLANE_ID
from verefine_viz.viewer.snapshot.scene_state import ObjectState, SceneState, labels_of
from verefine_viz.viewer.text.display_names import method_name

if TYPE_CHECKING:
    from verefine_viz.viewer.snapshot.snapshot import Snapshot


# What stands on other objects, where the method settles every object on the support plane alone: there it sinks.

RAISED_M = 0.02
"""By ground truth an object whose lowest point is higher above the support plane stands on something [m]."""
MOST_NAMED = 3
"""Objects that a warning names."""


@dataclass(frozen=True)
class UnsupportedStacking:
    """An object that does not stand on the support plane."""

    instance_id: int
    where: str
    """As in: "stands on cereal", "stands 70 mm above the table"."""


def unsupported_stacking(snapshot: Snapshot) -> tuple[UnsupportedStacking, ...]:
    """What stands on what, by the dependency graph or else by ground truth, where the method does not know of it.

    Nothing while the data are in doubt: how high objects stand above the table is measured in them.
    """
    method = method_of(snapshot.session.method.name)
    if method.knows_others or not method.simulates or not snapshot.session.physics.enabled or snapshot.data_doubts:
        return ()
    return _unsupported_stacking(snapshot.problem)


@lru_cache(maxsize=4)
def _unsupported_stacking(problem: Problem) -> tuple[UnsupportedStacking, ...]:
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
            found.append(UnsupportedStacking(own, f"stands on {' and '.join(on[own])}"))
        elif height_m is not None and height_m > RAISED_M:
            found.append(UnsupportedStacking(own, f"stands {height_m * 1e3:.0f} mm above the table"))
    return tuple(found)


def height_above_plane_m(target: Target) -> float | None:
    """How high the lowest vertex of an object is above the support plane, by ground truth [m]; None without either."""
    T_cam_obj, support = target.instance.T_cam_obj_gt, target.observation.support
    if T_cam_obj is None or support is None:
        return None
    T_world_obj, up = support.T_world_cam @ T_cam_obj, support.normal_world
    # Turning the normal, not the vertices: the page asks this several times whenever it is drawn.
    return float((target.model.vertices @ (T_world_obj[:3, :3].T @ up)).min() + T_world_obj[:3, 3] @ up)


def unsupported_stacking_warning(snapshot: Snapshot) -> str:
    """That what stands on other objects will sink through them; empty where nothing does."""
    found, labels = unsupported_stacking(snapshot), labels_of(snapshot.problem)
    if not found:
        return ""
    said = first_of([f"{labels[one.instance_id]} {one.where}" for one in found], MOST_NAMED, "; ")
    they = "it sinks" if len(found) == 1 else "they sink"
    return (
        f"{method_name(snapshot.session.method.name)} settles every object on the table alone, as if the others were not "
        f"there: {said}, so {they} in the simulation. VF_b and VF_d place what carries first."
    )


def unsupported_stacking_hint(snapshot: Snapshot, instance_id: int) -> str:
    """The same about one object; empty where it stands on the plane."""
    one = next((one for one in unsupported_stacking(snapshot) if one.instance_id == instance_id), None)
    if one is None:
        return ""
    return f"{one.where}; {method_name(snapshot.session.method.name)} settles it on the table alone, so it sinks"


Light = Literal["green", "amber", "red", "grey"]


@dataclass(frozen=True)
class PlausibilityVerdict:
    """Whether a pose could be, as far as that is known now."""

    light: Light
    sentence: str


def plausibility_verdict(found: Any, o: ObjectState, scene: SceneState) -> PlausibilityVerdict:
    """The verdict of a plausibility check of a pose of ``o``.

    Grey where it hangs on an object that is not placed yet. Where ground truth is known, sinking into the support
    plane counts from where the true pose is: what is measured of a table lies millimetres beside it in places, far more
    than the scatter of its points says.
    """
    into = next((p for p in scene.objects if f"into instance {p.instance_id}." in found.sentence), None)
    if into is not None:
        said = found.sentence.removesuffix(f"instance {into.instance_id}.") + into.label
        if is_placeholder(into):
            return PlausibilityVerdict(
                "grey", f"{said}, which still waits at its initial pose: nothing can be said yet."
            )
        return PlausibilityVerdict(found.light, f"{said}.")
    if found.light == "red" and found.penetrates == PLANE_ID and found.penetration_mm > 1e3 * IMPOSSIBLE_M:
        height_m = height_above_plane_m(o.target)
        true_mm = 0.0 if height_m is None else -1e3 * height_m
        if true_mm > 0 and found.penetration_mm - true_mm <= 1e3 * IMPOSSIBLE_M:
            so = f"so does the true pose, by {true_mm:.1f} mm: it is the plane found that is off here"
            return PlausibilityVerdict("amber", f"{found.sentence.removesuffix('.')}; {so}.")
    return PlausibilityVerdict(found.light, found.sentence)


def is_placeholder(o: ObjectState) -> bool:
    """Whether an object stands at a initial pose that no iteration has touched."""
    return o.phase == "waiting" and o.n_iterations == 0


# Whether the support plane can be trusted, in words.

PLANE_SHARE = 0.4
"""A plane that holds less of the background is doubted. Right ones of the eight YCB-Video frames at hand hold 43-74 %,
walls in them 24-37 %, the board beside the box of the built-in failure 23 %."""


def plane_doubt(support: Support) -> str:
    """Why physics may rest on a wrong plane, and what to do about it; empty where nothing says so."""
    if support.inlier_share >= PLANE_SHARE:
        return ""
    remedy = "give scene.gravity as a vector, or as world where the data set has camera poses"
    if support.gravity_source != "plane":
        remedy = "choose a frame that shows more of the table"
    return (
        f"The support plane explains only {support.inlier_share:.0%} of the background: physics may rest on a wrong "
        f"plane. If it cuts through objects in 3D, {remedy}."
    )


def share_hint() -> str:
    """What the share of the background on the plane means."""
    return (
        "The rest is what else is in snapshot: walls, things without a model. A doubtful plane holds less than "
        f"{PLANE_SHARE:.0%}; look in 3D whether it lies on the table."
    )
