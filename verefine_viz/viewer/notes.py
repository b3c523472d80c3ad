"""Notes on the data of the open frame that still hold: first poses may have been found since it was read."""

from __future__ import annotations

from verefine_viz.core.problem import Problem, Target
from verefine_viz.scenes.instance_notes import without


def notes_that_hold(problem: Problem) -> tuple[str, ...]:
    """Those of the frame without what was said of first poses that an object no longer has, or now has."""
    return tuple(note for note in problem.notes if not any(_is_stale(note, t) for t in problem.targets))


def _is_stale(note: str, target: Target) -> bool:
    instance, model = target.instance, target.model
    if note.startswith(without(instance, model)):
        return bool(instance.hypotheses)
    of_poses = note.startswith(f"{model.name} (#{instance.instance_id}): ") and "from the depth inside its mask" in note
    return of_poses and not any(f"{h.source}'s " in note for h in instance.hypotheses)
