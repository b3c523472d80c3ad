"""The verdict: whether the answer is right, how far off it is, and why, in one line; before, what is happening.

Pure text and commands, no markup: who shows it escapes it.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Literal, NamedTuple

from verefine_viz.core.arrays import Float
from verefine_viz.core.problem import ANSWER, Target
from verefine_viz.core.records import Best
from verefine_viz.diagnosis.causes import TITLES, Cause, Finding, cause_title, millimetres
from verefine_viz.diagnosis.signs import FinishedObject, signs
from verefine_viz.evaluation.matched_estimates import CORRECT
from verefine_viz.evaluation.pose_errors import add_where_add_s_is_below
from verefine_viz.methods.registry import method_of
from verefine_viz.run.breakpoints import hits
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.snapshot.snapshot import Snapshot, visit
from verefine_viz.viewer.state.batch_gallery import Entry
from verefine_viz.viewer.text.display_names import counted, in_focus, is_correct
from verefine_viz.viewer.text.pose_words import start_errors

Mark = Literal["✓", "✗", "?", "…"]
MOST_WORDS = 12
"""Of the cause."""
UNANSWERED = "no answer was recorded: this is the last pose"
DATA_DOUBTED = "the data do not fit together: look at them first"


class Reason(NamedTuple):
    """Why, in at most :data:`MOST_WORDS` words, and where to look."""

    words: str
    detail: str = ""
    """Goes on where there is room: a number."""
    iteration: int | None = None
    cause: Cause | None = None


@dataclass(frozen=True, eq=False)
class Verdict:
    """One line about the run."""

    mark: Mark
    """✓ right, ✗ wrong, ? unknown without ground truth, … not over yet."""
    number: str
    """The error, the score, or how far the run is."""
    cause: str
    """At most :data:`MOST_WORDS` words; names of objects count as one."""
    number_means: str = ""
    look_at: tuple[str, c.Command] | None = None
    """Words and command of the link, as to the iteration to look at."""
    share: float | None = None
    """How much of the run is done [0 to 1], while it is on."""
    pictured: tuple[Target, Float] | None = None
    """The object that the verdict is about and T_cam_obj (4, 4) of its answer."""
    about: Cause | None = None
    """The evidence of this cause comes first."""

    @property
    def line(self) -> str:
        """As in: ✗ 15.7 mm: correct at iteration 43, given up for a score 0.003 higher."""
        return f"{self.mark} {self.number}: {self.cause}"


def verdict(snapshot: Snapshot) -> Verdict:
    """The verdict on the run, wherever the cursor is; while it is not over, what is happening."""
    if snapshot.progress.running:
        return _running(snapshot)
    if snapshot.finished:
        own = subject(snapshot)
        return _of_object(snapshot, own) if _is_about_one(snapshot) and own is not None else _of_scene(snapshot, own)
    entry = _batch_entry(snapshot)
    if entry is not None:
        return _of_batch(snapshot, entry)
    if snapshot.missing:
        return Verdict("…", "not over", snapshot.missing, "fork at its last iteration to go on")
    return _ready(snapshot) if snapshot.cursor == 0 else _paused(snapshot)


# A finished run.


def _is_about_one(snapshot: Snapshot) -> bool:
    """Whether the page is filtered to one object, or there is only one."""
    return len(snapshot.finished) == 1 or snapshot.options.focus is not None


def subject(snapshot: Snapshot) -> FinishedObject | None:
    """The object that the verdict on a finished run is about: the one in focus, or the worst of several.

    Where ground truth is known, that with the largest error; else one that is physically impossible, then that with the
    lowest score. None where no object has an answer.
    """
    if _is_about_one(snapshot):
        return snapshot.finished_in_focus
    answered = [o for o in snapshot.finished if o.answer is not None]
    known = [(o.errors.relative, k) for k, o in enumerate(answered) if o.errors is not None]
    if known:
        return answered[max(known, key=lambda pair: pair[0])[1]]
    return min(answered, key=lambda o: (o.impossible is None, o.score.score), default=None)


def signs_of(snapshot: Snapshot, o: FinishedObject) -> tuple[Finding, ...]:
    """What the run itself shows about an object."""
    return signs(o, snapshot.session, snapshot.refiner)


def _of_object(snapshot: Snapshot, o: FinishedObject) -> Verdict:
    if o.answer is None:
        return Verdict("✗", "no pose", TITLES[Cause.NO_HYPOTHESIS])
    pictured = o.target, o.answer.T_cam_obj
    if o.errors is None:
        because = _because(snapshot, o)
        number, words = f"score {o.score.score:.2f}", because.words + because.detail
        return Verdict("?", number, words, SCORE_MEANS, pictured=pictured, about=because.cause)
    number = millimetres(o.errors.add_s_mm)
    means = (
        f"ADD(-S) against ground truth: {o.errors.relative:.1%} of the diameter; {o.errors.rotation_deg:.1f}° and "
        f"{o.errors.translation_mm:.1f} mm of the model's origin"
    )
    if not o.is_wrong:
        words, way = _how_it_won(o, o.answer), way_to(snapshot, o.answer.iteration)
        add = add_where_add_s_is_below(o.target, o.answer.T_cam_obj, CORRECT)
        if add is not None:
            words = f"right by ADD-S only: ADD over its symmetries is {add:.0%}"
        return Verdict("✓", number, words, means, way, pictured=pictured)
    because = _because(snapshot, o)
    look, words = way_to(snapshot, because.iteration), because.words + because.detail
    return Verdict("✗", number, words, means, look, pictured=pictured, about=because.cause)


SCORE_MEANS = "verification score of the answer; without ground truth nothing says whether it is right"


def _of_scene(snapshot: Snapshot, worst: FinishedObject | None) -> Verdict:
    """All objects: how many are right, and the one that is worst."""
    if worst is None or worst.answer is None:
        return Verdict("✗", "no pose", TITLES[Cause.NO_HYPOTHESIS])
    answered = [o for o in snapshot.finished if o.answer is not None]
    n, n_known = len(snapshot.finished), sum(o.errors is not None for o in answered)
    pictured = worst.target, worst.answer.T_cam_obj
    if worst.errors is None:
        which = f"lowest: {worst.label}, {worst.score.score:.2f}"
        if worst.impossible is not None:
            which = f"{worst.label}: {TITLES[Cause.IMPOSSIBLE]}"
        words, score = f"{counted(len(answered), 'pose')}; {which}", snapshot.frame_score or worst.score
        about = worst.impossible.cause if worst.impossible is not None else None
        return Verdict("?", f"score {score.score:.2f}", words, SCORE_MEANS, pictured=pictured, about=about)
    n_right = sum(is_correct(o.errors) for o in answered)
    # One without a pose is not right, where ground truth is known of the others.
    n_asked = n_known + n - len(answered)
    number, means = f"{n_right} of {n_asked} right", "within 10 % of their diameter, by ADD(-S)"
    off = f"{worst.label} {millimetres(worst.errors.add_s_mm)}"
    if n_right == n_asked:
        return Verdict("✓", number, f"largest error: {off}", means, pictured=pictured)
    if n_right == n_known:
        missing = next(o.label for o in snapshot.finished if o.answer is None)
        return Verdict("✗", number, f"{missing}: {TITLES[Cause.NO_HYPOTHESIS]}", means)
    because = _because(snapshot, worst)
    look, words = way_to(snapshot, because.iteration), f"{off}, {because.words}"
    return Verdict("✗", number, words, means, look, pictured=pictured, about=because.cause)


def _how_it_won(o: FinishedObject, best: Best) -> str:
    """As in: score 0.95, hypothesis 4, 0.63 ahead of hypothesis 2; the link beside it names the iteration."""
    words = f"score {best.score.score:.2f}, hypothesis {best.arm + 1}{'' if best.iteration else ' as it started'}"
    return f"{words}, {o.runner_up.in_words()}" if o.runner_up is not None else words


def _because(snapshot: Snapshot, o: FinishedObject) -> Reason:
    """Why an answer is wrong, or what is in doubt: as a batch says, which made re-runs, or else the first sign."""
    entry, steps = _batch_entry(snapshot), o.target.instance.recorded
    repeats, findings = method_of(snapshot.session.method.name).repeats, signs_of(snapshot, o)
    if snapshot.data_doubts:
        return Reason(DATA_DOUBTED)
    if o.is_wrong and repeats and steps and all(s.name != ANSWER for s in steps):  # As of a program that was killed.
        return Reason(UNANSWERED)
    if entry is not None and entry.row.cause and _is_answer_of(entry, o):
        return Reason(cause_title(entry.row.cause), iteration=entry.row.worst_iteration)
    if findings:
        return Reason(findings[0].title, findings[0].detail, findings[0].iteration, findings[0].cause)
    if o.is_wrong:
        return Reason("no cause in sight")
    if o.runner_up is not None:
        return Reason(f"{o.runner_up.in_words()}, no doubt in sight")
    alone = len(o.starts) < 2
    return Reason("one hypothesis alone: nothing to compare it with" if alone else "no doubt in sight")


# A failure of a batch, opened where it went wrong.


def _batch_entry(snapshot: Snapshot) -> Entry | None:
    """What the batch says of the object in focus; None where its run is not the one that is open."""
    entry = snapshot.entry
    if entry is None or snapshot.branch != 0 or entry.row.method != snapshot.session.method.name:
        return None
    return entry


def _is_answer_of(entry: Entry, o: FinishedObject) -> bool:
    """Whether the batch has the same answer."""
    if entry.row.instance_id != o.instance_id or entry.row.add_s_mm is None or o.errors is None:
        return False
    return abs(entry.row.add_s_mm - o.errors.add_s_mm) < 0.05


def _of_batch(snapshot: Snapshot, entry: Entry) -> Verdict:
    row = entry.row
    if row.status != "ok":
        return Verdict("✗", "no pose", cause_title(row.cause) if row.cause else "the batch has no answer for it")
    number = f"score {row.score:.2f}" if row.score is not None else "in the batch"
    if row.add_s_mm is None:
        return Verdict("?", number, "of the batch's answer; no ground truth", SCORE_MEANS)
    means, look = "ADD(-S) of the batch's answer against ground truth", None
    if snapshot.cursor != entry.iteration:
        look = (f"iteration {entry.iteration}", c.OpenAt(snapshot.frame, entry.iteration, instance=row.instance_id))
    if row.is_correct:
        return Verdict("✓", millimetres(row.add_s_mm), f"in the batch, {number}", means, look)
    cause = cause_title(row.cause) if row.cause else "no cause was looked for"
    if snapshot.data_doubts:
        cause = DATA_DOUBTED
    elif row.worst_iteration is not None:
        cause += f" (iteration {row.worst_iteration})"
    return Verdict("✗", millimetres(row.add_s_mm), cause, means, look)


# While it is not over.


def _running(snapshot: Snapshot) -> Verdict:
    p, at = snapshot.progress, snapshot.shown
    who = _who(snapshot, at.arm) if at is not None else snapshot.name
    words = f"{who}, {_scored(snapshot)}" + _remaining(p.remaining_s)
    return Verdict("…", f"{p.done} of {p.total}", words, "iterations", share=p.done / max(p.total, 1))


def _paused(snapshot: Snapshot) -> Verdict:
    p, at = snapshot.progress, snapshot.shown
    end = None if p.done == snapshot.cursor else ("latest", c.SeekEnd())
    number, words = f"{snapshot.cursor} of {p.total}", f"{snapshot.name} has had no iteration yet"
    if at is not None:
        words = f"{_who(snapshot, at.arm)}, {_scored(snapshot)}"
        stops = hits(snapshot.session.breakpoints, snapshot.problem, at) if snapshot.is_current and end is None else ()
        if stops:
            means = f"at a breakpoint after {number} iterations; Run goes on: {'; '.join(stops)}"
            return Verdict("…", "paused", f"breakpoint: {_short(stops[0])}", means, ("run on", c.RunUntil("end")))
    return Verdict("…", number, words, "iterations, not over yet", end)


def _short(reason: str) -> str:
    """The first clause of a sentence, cut to what fits."""
    words = re.split(r"[,;:(]", reason)[0].strip(" .").split()
    words[0] = words[0].lower()
    return " ".join(words[: MOST_WORDS - 1]) + ("…" if len(words) >= MOST_WORDS else "")


def _ready(snapshot: Snapshot) -> Verdict:
    if snapshot.state is None:
        return Verdict("✗", "no pose", TITLES[Cause.NO_HYPOTHESIS])
    if snapshot.data_doubts:
        return Verdict("…", "ready", DATA_DOUBTED)
    if snapshot.target.observation.support is None:
        return Verdict("…", "ready", "no support plane, so no physics")
    n = snapshot.n_arms
    words = f"{n} hypothes{'e' if n != 1 else 'i'}s, {_scored(snapshot)}"
    if len(snapshot.scene.objects) > 1:
        words = f"{len(snapshot.scene.objects)} objects; {in_focus(snapshot).label}: {words}"
    known = [e.add_s_mm for e in start_errors(snapshot) if e is not None]
    if known:
        words += f", nearest {millimetres(min(known))} off"
    return Verdict("…", "ready", words, f"{snapshot.progress.total} iterations to come")


def _who(snapshot: Snapshot, arm: int) -> str:
    return f"{in_focus(snapshot).label}, hypothesis {arm + 1} of {snapshot.n_arms}"


def _scored(snapshot: Snapshot) -> str:
    """As in: best score 0.95. What answers with its last pose has no best one."""
    of = "best score" if method_of(snapshot.session.method.name).verifies else "score"
    return f"{of} {snapshot.state.best.score.score:.2f}" if snapshot.state is not None else f"{of} unknown"


def _remaining(seconds: float | None) -> str:
    if seconds is None or seconds < 2:
        return ""
    return f", {seconds:.0f} s left" if seconds < 90 else f", {seconds / 60:.0f} min left"


def way_to(snapshot: Snapshot, index: int | None) -> tuple[str, c.Command] | None:
    """The link to an iteration; None where the cursor is there, or there is nothing to see."""
    if index is None or index > len(snapshot.iterations) or (index == snapshot.cursor and not snapshot.is_answer):
        return None
    return f"iteration {index}", visit(snapshot, snapshot.at(index)) if index else c.Seek(0)
