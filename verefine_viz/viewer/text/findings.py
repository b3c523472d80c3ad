"""What is probably wrong. Each finding names its evidence and what to do."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from verefine_viz.batch.summary import MUCH, MUCH_SCORE
from verefine_viz.diagnosis.causes import Cause, Finding, cause_title
from verefine_viz.diagnosis.data_doubts import plane_doubt
from verefine_viz.run.record import DATA_FIRST
from verefine_viz.scenes.instance_notes import without
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.snapshot.snapshot import Snapshot
from verefine_viz.viewer.state.batch_gallery import Entry
from verefine_viz.viewer.text.display_names import is_correct
from verefine_viz.viewer.text.plausibility_verdict import (
    gravity_doubt,
    unsupported_stacking,
    unsupported_stacking_warning,
)
from verefine_viz.viewer.text.verdict import signs_of, subject, way_to

BESIDE_GROUND_TRUTH = (Cause.GROUND_TRUTH, Cause.SYMMETRIC, Cause.SCORE, Cause.BUDGET)
"""Causes that a comparison of the answer with ground truth shows."""


@dataclass(frozen=True)
class Note:
    """One thing worth knowing."""

    text: str
    red: bool = False
    calm: bool = False
    """Good to know, but nothing is wrong yet."""
    command: c.Command | None = None
    """What to try."""
    label: str = ""
    """Words for the command's link."""
    cause: str | None = None
    """What it is evidence of."""
    is_of_batch: bool = False
    """Whether a batch says so, which made re-runs."""


def findings(snapshot: Snapshot) -> tuple[Note, ...]:
    """All that is worth knowing, the most telling first."""
    checks = (_of_data, _of_batch, _support, _no_hypothesis, _stacking)
    notes = [note for check in checks for note in check(snapshot)]
    return (*notes, *_signs(snapshot, notes))


def _of_data(snapshot: Snapshot) -> list[Note]:
    """A wrong camera or wrong models are behind all that follows."""
    return [Note(f"{DATA_FIRST} {doubt}.", red=True) for doubt in snapshot.data_doubts]


def _of_batch(snapshot: Snapshot) -> list[Note]:
    """Why the batch says that this object failed, and the way to the iteration."""
    entry, words = snapshot.entry, batch_words(snapshot)
    if entry is None or not words:
        return []
    command = None
    if snapshot.cursor != entry.iteration:
        command = c.OpenAt(snapshot.frame, entry.iteration, instance=entry.row.instance_id)
    label = f"go to iteration {entry.iteration}"
    return [Note(words, entry.is_wrong, not entry.is_wrong, command, label, entry.row.cause or None, True)]


def _support(snapshot: Snapshot) -> list[Note]:
    observation = snapshot.target.observation
    support = observation.support
    if support is None:
        note = observation.support_note or "no support plane was found"
        given = snapshot.session.scene.gravity != "plane"
        remedy = "Check scene.gravity" if given else "Give scene.gravity"
        return [Note(f"No physics: {note}. {remedy}, or choose a frame that shows the table.", red=True)]
    doubts = [doubt for doubt in (plane_doubt(support), gravity_doubt(support)) if doubt]
    return [*(Note(doubt, cause=Cause.PLANE) for doubt in doubts), *_hulls(snapshot)]


def _hulls(snapshot: Snapshot) -> list[Note]:
    physics = snapshot.session.physics
    if not physics.enabled or physics.collider != "hull":
        return []
    command = c.Restart((("physics.collider", "decomposition"),))
    text = "Physics takes every model for its convex hull (physics.collider = hull)."
    return [Note(text, calm=True, command=command, label="restart with convex parts")]


def _no_hypothesis(snapshot: Snapshot) -> list[Note]:
    if snapshot.state is not None:
        return []
    known = without(snapshot.target.instance, snapshot.target.model)
    why = next((note for note in snapshot.problem.notes if note.startswith(known)), None)
    return [Note(f"{why or f'{known}add a results file that holds object {snapshot.target.model.obj_id}'}.")]


def _signs(snapshot: Snapshot, known_notes: Sequence[Note]) -> list[Note]:
    """What the finished run shows about the object that the verdict is about, but for what is said already."""
    o = subject(snapshot)
    known = {note.text for note in known_notes} | {note.cause for note in known_notes if note.is_of_batch}
    if o is None or snapshot.progress.running:
        return []
    return [
        _of_sign(snapshot, sign, is_red=o.is_wrong or sign.cause in (Cause.MASK, Cause.IMPOSSIBLE))
        for sign in signs_of(snapshot, o)
        if sign.text not in known and sign.cause not in known
    ]


def _of_sign(snapshot: Snapshot, sign: Finding, is_red: bool) -> Note:
    """A sign with what to do about it: settings to try, an iteration or a comparison to look at."""
    command, label = None, ""
    if sign.try_ is not None:
        command = c.Fork(tuple(sign.try_.items()), 0, run=True)
        label = f"what if {', '.join(f'{name} = {value:g}' for name, value in sign.try_.items())}?"
    elif sign.cause in BESIDE_GROUND_TRUTH:
        command, label = c.ScoreGroundTruth(), "put them side by side"
    elif sign.cause == Cause.MASK:
        command, label = c.ColorCloud("class"), "colour the cloud by class"
    elif (way := way_to(snapshot, sign.iteration)) is not None:
        label, command = way
    return Note(sign.text, is_red, False, command, label, sign.cause)


def _stacking(snapshot: Snapshot) -> list[Note]:
    """Objects rest on each other, and the method does not know."""
    warning = unsupported_stacking_warning(snapshot)
    if not warning:
        return []
    command = c.Restart((("method.name", "vf_breadth"),))
    answers = [snapshot.scene.object(own).errors for own in unsupported_stacking(snapshot)]
    is_solved = snapshot.is_answer and all(is_correct(e) for e in answers)
    return [Note(warning, calm=is_solved, command=command, label="restart with VF_b")]


# What a batch says about the object in focus: why it failed, and why this iteration is the one to look at.


def batch_words(snapshot: Snapshot) -> str:
    """What happened at the iteration where it went wrong, and the cause with its evidence; "" = nothing."""
    entry = snapshot.entry
    if entry is None:
        return ""
    # What is in doubt about the data stands above it by itself.
    verdict = _verdict(entry).partition(f" {DATA_FIRST}")[0]
    return " ".join(filter(None, (_why_here(snapshot, entry), verdict)))


def _verdict(entry: Entry) -> str:
    row = entry.row
    if row.status != "ok":
        return f"In the batch: no answer, {row.message}."
    if not entry.is_wrong or row.relative_error is None:
        return ""
    if row.evidence:
        return f"Why it failed in the batch: {row.evidence}"
    cause = cause_title(row.cause) if row.cause else "no cause was looked for"
    return f"In the batch it was wrong by {row.relative_error:.0%} of the diameter: {cause}."


def _why_here(snapshot: Snapshot, entry: Entry) -> str:
    """Why the frame was opened at this iteration of all."""
    at = entry.iteration
    if snapshot.cursor != at or snapshot.progress.running or entry.row.status != "ok":
        return ""
    if at == 0:
        return "No iteration made it much worse, and its answer is an initial pose: look before iteration 1."
    if entry.row.worst_iteration is None:
        return f"No iteration made it much worse; iteration {at} made the answer."
    if entry.row.cause == Cause.DISCARDED:
        return f"Iteration {at}: here a correct pose was given up."
    before, after = snapshot.poses.get("current"), snapshot.poses.get("accepted")
    if not snapshot.is_current or before is None or after is None:
        return ""
    if before.errors is not None and after.errors is not None:
        was, now = before.errors.add_s_mm, after.errors.add_s_mm
        much = MUCH * (entry.row.diameter_mm or 0.0)
        lost, change = now - was > much, f"here its error grew most ({was:.1f} → {now:.1f} mm)"
    elif before.score is not None and after.score is not None:
        was, now = before.score.score, after.score.score
        lost, change = was - now > MUCH_SCORE, f"here its score fell most ({was:.2f} → {now:.2f})"
    else:
        return ""
    return f"Iteration {at}: {change}." if lost else ""
