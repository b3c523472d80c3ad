"""Carries out a window's verbs about labels: place, find, snap, decide, undo, carry, export."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from verefine_viz.core.errors import InputError
from verefine_viz.core.writing import expand_home
from verefine_viz.page import protocol as p
from verefine_viz.page.messages import ViewMessage, ViewPatch
from verefine_viz.page.page_state import PageState


def _place(d: PageState, verb: p.Place, window: int | None) -> None:
    label = d.space.desk.place(d.space.frame, verb.obj_id, *verb.pixel)
    _show(d, window, label.instance)


def _find(d: PageState, verb: p.Find, window: int | None) -> None:
    if verb.box is None and not verb.scribble:
        raise InputError("where? Draw a box around the object, or a line on it")
    label = d.space.desk.find(d.space.frame, verb.obj_id, verb.box, verb.scribble)
    _show(d, window, label.instance)


def _snap(d: PageState, verb: p.Snap, window: int | None) -> None:
    d.space.desk.snap(d.space.frame, verb.obj, p.pose_matrix(verb.T))
    _show(d, window, verb.obj)


def _decide(d: PageState, verb: p.Decide, window: int | None) -> None:
    desk, frame = d.space.desk, d.space.frame
    if verb.state == "removed":
        desk.remove(frame, verb.obj)
        _show(d, window, None)
    else:
        desk.decide(frame, verb.obj, verb.state, verb.note)
        d.send_labels()  # No pose moved.


def _undo(d: PageState, verb: p.UndoLabel, window: int | None) -> None:
    d.space.desk.undo(d.space.frame, verb.redo)
    _show(d, window, None)


def _carry(d: PageState, verb: p.Carry, window: int | None) -> None:
    last, stopped = d.space.frame, False
    try:
        for step in d.space.desk.carry(d.space.frame, verb.most):
            last, stopped = step.frame, step.stops
            for note in step.notes:
                d.say(f"{step.frame}: {note}", window)
    finally:
        d.space.show_labelled(last)
        d.send_frame()
    if not stopped:
        d.say(f"carried to frame {last}", window)


def _export(d: PageState, verb: p.Export, window: int | None) -> None:
    out = expand_home(verb.out) if verb.out else None
    written = d.space.desk.export(out, verb.uncertain, verb.symmetries, verb.overwrite)
    for note in written.notes:
        d.say(note, window)
    d.say(f"{written.n_objects} labels of {written.n_frames} frames written to {written.folder}", window)


def _show(d: PageState, window: int | None, obj: int | None) -> None:
    """Show the frame with its labels as they are now, one of them in focus."""
    d.space.show_labelled(d.space.frame)
    d.send_frame()
    instances = [one.instance_id for one in d.space.problem.instances]
    focus = obj if obj in instances else instances[-1] if instances else None
    d.post(ViewMessage(ViewPatch(branch=d.space.work.first.index, k=0, obj=focus, edited=None)), window)


HANDLERS: dict[type, Callable[[PageState, Any, int | None], None]] = {
    p.Place: _place,
    p.Find: _find,
    p.Snap: _snap,
    p.Decide: _decide,
    p.UndoLabel: _undo,
    p.Carry: _carry,
    p.Export: _export,
}
