"""The sentence above the timeline: where the cursor is, what was worked on there, and where trouble is marked."""

from __future__ import annotations

from collections.abc import Sequence

from verefine_viz.viewer import commands as c
from verefine_viz.viewer.answer import the_answer, visit
from verefine_viz.viewer.marks import Mark
from verefine_viz.viewer.markup import link, text
from verefine_viz.viewer.scene_words import place_in_run
from verefine_viz.viewer.view import View


def timeline_words(view: View, marks: Sequence[Mark]) -> str:
    """As in: Iteration 17 of 25: mug, hypothesis 2 of 5. 3 red marks, the next at 21.

    Args:
        view: what is on the screen.
        marks: those that the timeline shows.
    """
    p = view.progress
    made = "" if p.done == view.cursor else f" ({link(f'{p.done} made', c.SeekEnd())})"
    return f"Iteration {view.cursor} of {p.total}: {text(_what(view))}{made}.{_red(view, marks)}"


def _what(view: View) -> str:
    if view.is_answer:
        return the_answer(view)
    if view.cursor == 0:
        return "the start" if view.progress.done else "nothing has run yet"
    if view.is_current and view.shown is not None:
        place, stage = place_in_run(view.scene, view.shown), view.look.stage
        said = f"{view.name}, hypothesis {view.shown.arm + 1} of {view.n_arms}"
        return ", ".join(filter(None, (place, said, f"up to the {stage} pose" if stage else "")))
    if view.cursor > len(view.iterations):
        return "told stage by stage"
    worked_on = view.at(view.cursor)
    return f"it worked on {view.scene.object(worked_on.instance_id).label}, hypothesis {worked_on.arm + 1}"


def _red(view: View, marks: Sequence[Mark]) -> str:
    """How many iterations are marked red, and the way to the nearest one."""
    red = sorted({mark.iteration for mark in marks if mark.is_red})
    if not view.progress.done:
        return ""
    if not red:
        return " No red marks."
    said = f" {len(red)} red mark{'s' if len(red) > 1 else ''}"
    after, before = [k for k in red if k > view.cursor], [k for k in red if k < view.cursor]
    if view.cursor in red:
        said += ", one here"
    if not after and not before:
        return f"{said}."
    which, k = ("next", after[0]) if after else ("one before", before[-1])
    which = f"the {which} at" if len(red) > 1 else "at"
    return f"{said}, {which} {link(str(k), visit(view, view.at(k)), 'go there')}."
