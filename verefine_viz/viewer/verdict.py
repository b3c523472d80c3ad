"""What the page says of a pose's plausibility: physics names instances by number, people by name."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

from verefine_viz.viewer.scene_now import ObjectNow, SceneNow

Light = Literal["green", "amber", "red", "grey"]


@dataclass(frozen=True)
class Verdict:
    """Whether a pose could be, as far as that can be told now."""

    light: Light
    sentence: str


def verdict(found: Any, scene: SceneNow) -> Verdict:
    """The verdict of a plausibility check; grey where it hangs on an object that nobody has placed yet."""
    into = next((o for o in scene.objects if f"into instance {o.instance_id}." in found.sentence), None)
    if into is None:
        return Verdict(found.light, found.sentence)
    said = found.sentence.removesuffix(f"instance {into.instance_id}.") + into.label
    if is_placeholder(into):
        return Verdict("grey", f"{said}, which still waits at its first pose: nothing can be said yet.")
    return Verdict(found.light, f"{said}.")


def is_placeholder(o: ObjectNow) -> bool:
    """Whether an object stands at a first pose that no iteration has touched."""
    return o.phase == "waiting" and o.n_iterations == 0
