"""Whether a pose, or the support plane, is plausible, in plain words; and what stands on other objects unsupported."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Literal

from verefine_viz.core.observation import TILT_SHOWN_DEG, Support
from verefine_viz.core.problem import Problem, Target
from verefine_viz.core.surroundings import SUPPORT_ID
from verefine_viz.core.text_format import first_of
from verefine_viz.diagnosis.data_doubts import PLANE_SHARE
from verefine_viz.methods.registry import method_of
from verefine_viz.physics.stability import IMPOSSIBLE_M
from verefine_viz.viewer.snapshot.scene_state import ObjectState, SceneState, labels_of
from verefine_viz.viewer.snapshot.snapshot import Snapshot
from verefine_viz.viewer.text.display_names import method_name

# What stands on other objects, where the method settles every object on the support plane alone: there it sinks.

RAISED_M = 0.02
"""By ground truth an object whose lowest point is higher above the support plane stands on something [m]."""
MOST_NAMED = 3
"""Objects that a warning names."""


def unsupported_stacking(snapshot: Snapshot) -> dict[int, str]:
    """By instance, where the method does not know of it: "stands on cereal", "stands 70 mm above the table".

    By the dependency graph, or else by ground truth. Nothing while the data are in doubt: how high objects stand above
    the table is measured in them.
    """
    session, method = snapshot.session, method_of(snapshot.session.method.name)
    if method.knows_others or not method.simulates or not session.physics.enabled or snapshot.data_doubts:
        return {}
    return _unsupported_stacking(snapshot.problem)


@lru_cache(maxsize=4)
def _unsupported_stacking(problem: Problem) -> dict[int, str]:
    labels = labels_of(problem)
    on: dict[int, list[str]] = {}
    for edge in problem.dependencies.edges if problem.dependencies else ():
        if edge.kind == "support" and edge.state != "cut" and edge.first in labels and edge.second in labels:
            on.setdefault(edge.second, []).append(labels[edge.first])
    support, stacked = problem.observation.support, {}
    is_plane = support is None or support.surroundings is None  # Surroundings support what stands on no model.
    for target in problem.targets:
        own, height_m = target.instance.instance_id, height_above_plane_m(target)
        if own in on:
            stacked[own] = f"stands on {' and '.join(on[own])}"
        elif is_plane and height_m is not None and height_m > RAISED_M:
            stacked[own] = f"stands {height_m * 1e3:.0f} mm above the table"
    return stacked


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
    stacked, labels = unsupported_stacking(snapshot), labels_of(snapshot.problem)
    if not stacked:
        return ""
    which = first_of([f"{labels[own]} {where}" for own, where in stacked.items()], MOST_NAMED, "; ")
    they = "it sinks" if len(stacked) == 1 else "they sink"
    method = method_name(snapshot.session.method.name)
    return (
        f"{method} settles every object on the table alone, as if the others were not there: {which}, so {they} in the "
        "simulation. VF_b and VF_d place what supports others first."
    )


# Whether a pose could lie still.

Light = Literal["green", "amber", "red", "grey"]


@dataclass(frozen=True)
class PlausibilityVerdict:
    """Whether a pose could be, as far as that is known now."""

    light: Light
    sentence: str


def plausibility_verdict(plausibility: Any, o: ObjectState, scene: SceneState) -> PlausibilityVerdict:
    """The verdict of a plausibility check of a pose of ``o``.

    Grey where it hangs on an object that is not placed yet. Where ground truth is known, sinking into the support
    plane counts from where ground truth is: what is measured of a table lies millimetres beside it in places, far more
    than the scatter of its points says.
    """
    light, sentence = plausibility.light, plausibility.sentence
    into = next((p for p in scene.objects if f"into instance {p.instance_id}." in sentence), None)
    if into is not None:
        named = sentence.removesuffix(f"instance {into.instance_id}.") + into.label
        if into.phase == "waiting" and into.n_iterations == 0:
            return PlausibilityVerdict("grey", f"{named}, which still waits at its initial pose: unknown yet.")
        return PlausibilityVerdict(light, f"{named}.")
    if light == "red" and plausibility.penetrates == SUPPORT_ID and plausibility.penetration_mm > 1e3 * IMPOSSIBLE_M:
        true_mm = -1e3 * (height_above_plane_m(o.target) or 0.0)
        if true_mm > 0 and plausibility.penetration_mm - true_mm <= 1e3 * IMPOSSIBLE_M:
            reason = f"so does ground truth, by {true_mm:.1f} mm: it is the measured plane that is off here"
            return PlausibilityVerdict("amber", f"{sentence.removesuffix('.')}; {reason}.")
    return PlausibilityVerdict(light, sentence)


# Whether the support plane can be trusted.

GRAVITY_FROM = {"plane": "its normal", "world": "the camera's pose", "given": "scene.gravity"}
"""Where gravity comes from, in words."""
SHARE_HINT = (
    "The rest is what else is in view: walls, things without a model. A doubtful plane holds less than "
    f"{PLANE_SHARE:.0%}; look in 3D whether it lies on the table."
)
"""What the share of the background on the plane means."""


def gravity_doubt(support: Support) -> str:
    """That gravity and the support plane disagree; empty where they do not."""
    if support.tilt_deg <= TILT_SHOWN_DEG:
        return ""
    return (
        f"The support plane is tilted by {support.tilt_deg:.1f}° against gravity "
        f"({GRAVITY_FROM[support.gravity_source]}): the table leans, or one of the two is wrong. 3D shows both: yellow "
        "gravity, blue the plane's normal."
    )
