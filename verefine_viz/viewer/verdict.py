"""What the page says of a pose's plausibility: physics names instances by number, people by name."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

from verefine_viz.core.problem import Target
from verefine_viz.physics.standing import IMPOSSIBLE_M, PLANE_ID
from verefine_viz.viewer.scene_now import ObjectNow, SceneNow

Light = Literal["green", "amber", "red", "grey"]


@dataclass(frozen=True)
class Verdict:
    """Whether a pose could be, as far as that can be told now."""

    light: Light
    sentence: str


def verdict(found: Any, o: ObjectNow, scene: SceneNow) -> Verdict:
    """The verdict of a plausibility check of a pose of ``o``.

    Grey where it hangs on an object that nobody has placed yet. Where ground truth is known, sinking into the support
    plane counts from where the true pose is: what is measured of a table lies millimetres beside it in places, far more
    than the scatter of its points tells.
    """
    into = next((p for p in scene.objects if f"into instance {p.instance_id}." in found.sentence), None)
    if into is not None:
        said = found.sentence.removesuffix(f"instance {into.instance_id}.") + into.label
        if is_placeholder(into):
            return Verdict("grey", f"{said}, which still waits at its first pose: nothing can be said yet.")
        return Verdict(found.light, f"{said}.")
    if found.light == "red" and found.penetrates == PLANE_ID and found.penetration_mm > 1e3 * IMPOSSIBLE_M:
        true_mm = _true_depth_mm(o.target)
        if true_mm > 0 and found.penetration_mm - true_mm <= 1e3 * IMPOSSIBLE_M:
            so = f"so does the true pose, by {true_mm:.1f} mm: it is the plane found that is off here"
            return Verdict("amber", f"{found.sentence.removesuffix('.')}; {so}.")
    return Verdict(found.light, found.sentence)


def _true_depth_mm(target: Target) -> float:
    """How deep the true pose sinks into the support plane; 0 where it does not, or is not known [mm]."""
    T_cam_obj, support = target.instance.T_cam_obj_gt, target.observation.support
    if T_cam_obj is None or support is None:
        return 0.0
    T_world_obj, up = support.T_world_cam @ T_cam_obj, support.normal_world
    # Turning the normal, not the vertices: this is asked several times whenever the page is drawn.
    lowest_m = float((target.model.vertices @ (T_world_obj[:3, :3].T @ up)).min() + T_world_obj[:3, 3] @ up)
    return max(-1e3 * lowest_m, 0.0)


def is_placeholder(o: ObjectNow) -> bool:
    """Whether an object stands at a first pose that no iteration has touched."""
    return o.phase == "waiting" and o.n_iterations == 0
