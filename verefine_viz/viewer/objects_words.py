"""The sentence above the list of objects: how far each of them is."""

from __future__ import annotations

from verefine_viz.viewer.correct import is_correct
from verefine_viz.viewer.view import View


def objects_words(view: View) -> str:
    """As in: cereal is worked on, 2 are done, 3 wait."""
    objects = view.scene.objects
    if view.is_answer:
        known = [is_correct(o.errors) for o in objects if o.errors is not None]
        if known:
            return f"{sum(known)} of {len(objects)} answers are within 10 % of the diameter."
        return f"{sum(o.answer is not None for o in objects)} of {len(objects)} have an answer."
    working = [o.label for o in objects if o.phase == "working"]
    n = {
        phase: sum(o.phase == phase for o in objects)
        for phase in ("done", "placed", "rolled out", "waiting", "no pose")
    }
    said = [f"{label} is worked on" for label in working]
    for count, one, many in (
        (n["done"], "is done", "are done"),
        (n["placed"], "is placed", "are placed"),
        (n["rolled out"], "is a guess of the search", "are guesses of the search"),
        (n["waiting"], "waits", "wait"),
        (n["no pose"], "has no first pose", "have no first pose"),
    ):
        if count:
            said.append(f"{count} {one if count == 1 else many}")
    return f"{', '.join(said)}."
