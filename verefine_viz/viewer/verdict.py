"""What the page says of a pose's plausibility: physics names instances by number, people by name."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

from verefine_viz.physics.standing import IMPOSSIBLE_M, PLANE_ID
from verefine_viz.viewer.carrying import height_above_plane_m
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
        height_m = height_above_plane_m(o.target)
        true_mm = 0.0 if height_m is None else -1e3 * height_m
        if true_mm > 0 and found.penetration_mm - true_mm <= 1e3 * IMPOSSIBLE_M:
            so = f"so does the true pose, by {true_mm:.1f} mm: it is the plane found that is off here"
            return Verdict("amber", f"{found.sentence.removesuffix('.')}; {so}.")
    return Verdict(found.light, found.sentence)


def is_placeholder(o: ObjectNow) -> bool:
    """Whether an object stands at a first pose that no iteration has touched."""
    return o.phase == "waiting" and o.n_iterations == 0
