"""The verdict: whether the answer is right, how far off it is, and why, in one line; before, what is happening.

Pure text and commands, no markup: who shows it escapes it.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Literal

from verefine_viz.core.arrays import Float
from verefine_viz.core.problem import ANSWER, Target
from verefine_viz.core.scores import PoseScore
from verefine_viz.core.text_format import distinguishing_digits
from verefine_viz.diagnosis.ambiguity import in_short
from verefine_viz.diagnosis.causes import TITLES, Cause, cause_title
from verefine_viz.diagnosis.score_causes import blamed_pixels
from verefine_viz.diagnosis.signs import Lost, far_start, ground_truth_is_unfit, is_low, leaks, out_of_range, starved
from verefine_viz.evaluation.matched_estimates import CORRECT
from verefine_viz.evaluation.pose_errors import add_where_add_s_is_below
from verefine_viz.methods.registry import method_of
from verefine_viz.run.breakpoints import hits
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.snapshot.finished_objects import FinishedObject
from verefine_viz.viewer.snapshot.snapshot import Snapshot, visit
from verefine_viz.viewer.state.batch_gallery import Entry
from verefine_viz.viewer.text.display_names import counted, in_focus, is_correct
from verefine_viz.viewer.text.headline import NEAR_TIE, NO_LEAD
from verefine_viz.viewer.text.plausibility_verdict import plane_doubt, plausibility_verdict
from verefine_viz.viewer.text.pose_words import start_errors

Mark = Literal["✓", "✗", "?", "…"]
MOST_WORDS = 12
"""Of the cause."""
UNANSWERED = "no answer was recorded: this is the last pose"
DATA_DOUBTED = "the data do not fit together: look at them first"
APART = 0.1
"""Poses further apart than this share of the diameter are two answers."""


@dataclass(frozen=True)
class Reason:
    """Why, in at most :data:`MOST_WORDS` words, and the iteration to look at."""

    words: str
    iteration: int | None = None
    more: str = ""
    """Goes on where there is room: a number."""
    about: Cause | None = None
    """What of the evidence it rests on."""


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
        own = _finished_in_focus(snapshot)
        return _of_scene(snapshot) if own is None else _of_object(snapshot, own)
    entry = _batch_entry(snapshot)
    if entry is not None:
        return _of_batch(snapshot, entry)
    return _ready(snapshot) if snapshot.cursor == 0 else _paused(snapshot)


# A finished run.


def _finished_in_focus(snapshot: Snapshot) -> FinishedObject | None:
    """The object that the page is filtered to, or the only one; None = the verdict is about all."""
    if len(snapshot.finished) > 1 and snapshot.options.focus is None:
        return None
    own = snapshot.target.instance.instance_id
    return next((o for o in snapshot.finished if o.instance_id == own), None)


def _of_object(snapshot: Snapshot, o: FinishedObject) -> Verdict:
    if o.answer is None:
        return Verdict("✗", "no pose", TITLES[Cause.NO_HYPOTHESIS])
    pictured = o.target, o.answer.T_cam_obj
    if o.errors is None:
        reason = doubt_of(snapshot, o)
        return Verdict("?", f"score {o.answer.score.score:.2f}", reason.words, SCORE_MEANS, pictured=pictured)
    number = _millimetres(o.errors.add_s_mm)
    means = (
        f"ADD(-S) against ground truth: {o.errors.relative:.1%} of the diameter; {o.errors.rotation_deg:.1f}° and "
        f"{o.errors.translation_mm:.1f} mm of the model's origin"
    )
    if not o.course.is_wrong:
        words, way = _how_it_won(o), _way(snapshot, o.answer.iteration)
        add = add_where_add_s_is_below(o.target, o.answer.T_cam_obj, CORRECT)
        if add is not None:
            words = f"right by ADD-S only: ADD over its symmetries is {add:.0%}"
        return Verdict("✓", number, words, means, way, pictured=pictured)
    reason = cause_of(snapshot, o)
    look = _way(snapshot, reason.iteration)
    return Verdict("✗", number, reason.words + reason.more, means, look, pictured=pictured, about=reason.about)


SCORE_MEANS = "verification score of the answer; without ground truth nothing says whether it is right"


def _of_scene(snapshot: Snapshot) -> Verdict:
    """All objects: how many are right, and the one that is worst."""
    answered = [o for o in snapshot.finished if o.answer is not None]
    n, n_known = len(snapshot.finished), sum(o.errors is not None for o in answered)
    if not answered:
        return Verdict("✗", "no pose", TITLES[Cause.NO_HYPOTHESIS])
    if not n_known:
        least = min(answered, key=lambda o: _score_of(o).score)
        words = f"{counted(len(answered), 'pose')}; lowest: {least.label}, {_score_of(least).score:.2f}"
        score = snapshot.frame_score or _score_of(least)
        return Verdict("?", f"score {score.score:.2f}", words, SCORE_MEANS, pictured=_pictured(least))
    worst = max(answered, key=lambda o: o.errors.relative if o.errors is not None else -1.0)
    assert worst.errors is not None
    n_right = sum(is_correct(o.errors) for o in answered)
    # One without a pose is not right, where ground truth is known of the others.
    n_asked = n_known + n - len(answered)
    number, means = f"{n_right} of {n_asked} right", "within 10 % of their diameter, by ADD(-S)"
    off = f"{worst.label} {_millimetres(worst.errors.add_s_mm)}"
    if n_right == n_asked:
        return Verdict("✓", number, f"largest error: {off}", means, pictured=_pictured(worst))
    if n_right == n_known:
        missing = next(o.label for o in snapshot.finished if o.answer is None)
        return Verdict("✗", number, f"{missing}: {TITLES[Cause.NO_HYPOTHESIS]}", means)
    reason = cause_of(snapshot, worst)
    look = _way(snapshot, reason.iteration)
    return Verdict("✗", number, f"{off}, {reason.words}", means, look, pictured=_pictured(worst), about=reason.about)


def _pictured(o: FinishedObject) -> tuple[Target, Float] | None:
    return None if o.answer is None else (o.target, o.answer.T_cam_obj)


def _score_of(o: FinishedObject) -> PoseScore:
    assert o.answer is not None
    return o.answer.score


def _how_it_won(o: FinishedObject) -> str:
    """As in: score 0.95, hypothesis 4, 0.63 ahead of hypothesis 2; the link beside it names the iteration."""
    assert o.answer is not None
    best = o.answer
    words = f"score {best.score.score:.2f}, hypothesis {best.arm + 1}{'' if best.iteration else ' as it started'}"
    return f"{words}, {_lead(o)}" if o.runner_up is not None else words


def _lead(o: FinishedObject) -> str:
    """As in: 0.003 ahead of hypothesis 2."""
    assert o.runner_up is not None
    lead = o.runner_up.lead
    who = f"hypothesis {o.runner_up.pose.arm + 1}"
    return f"level with {who}" if lead < NO_LEAD else f"{lead:.{distinguishing_digits(lead)}f} ahead of {who}"


def _is_unanswered(snapshot: Snapshot, o: FinishedObject) -> bool:
    """Whether another program recorded steps and no answer, as one that was killed."""
    steps = o.target.instance.recorded
    return method_of(snapshot.session.method.name).repeats and bool(steps) and all(s.name != ANSWER for s in steps)


def cause_of(snapshot: Snapshot, o: FinishedObject) -> Reason:
    """Why a wrong answer is wrong: as the batch says, which made re-runs, or else by the signs that a run shows."""
    entry = _batch_entry(snapshot)
    if snapshot.data_doubts:
        return Reason(DATA_DOUBTED)
    if _is_unanswered(snapshot, o):
        return Reason(UNANSWERED)
    if entry is not None and entry.row.cause and _is_answer_of(entry, o):
        return Reason(cause_title(entry.row.cause), entry.row.worst_iteration)
    if ground_truth_is_unfit(o.course.score, o.course.score_at_gt):
        assert o.course.score_at_gt is not None
        more = f": scores {o.course.score_at_gt.score:.2f}, the answer {_score_of(o).score:.2f}"
        return Reason(TITLES[Cause.GROUND_TRUTH], more=more, about=Cause.GROUND_TRUTH)
    if o.undeclared is not None:
        return Reason(TITLES[Cause.SYMMETRIC], more=f": turned by {o.undeclared.turn_deg:.0f}°", about=Cause.SYMMETRIC)
    course, score = o.course, _score_of(o)
    # A wrong pose misses pixels of any mask; ground truth only those of a mask that leaks.
    if course.score_at_gt is not None and leaks(course.score_at_gt):
        more = f": {course.score_at_gt.shares['missed']:.0%} missed even at ground truth"
        return Reason(TITLES[Cause.MASK], more=more, about=Cause.MASK)
    # Ground truth may score a little less than the pose beside it that a refiner finds: then a tie was decided.
    is_tie = o.discarded is not None and abs(o.discarded.margin) < NEAR_TIE
    if course.is_misled and course.score_at_gt is not None and not is_tie:
        margin = score.score - course.score_at_gt.score
        more = f", by {margin:.{distinguishing_digits(margin)}f}"
        blamed = blamed_pixels(score, course.score_at_gt)
        if blamed is not None:
            more += f": {course.score_at_gt.shares[blamed]:.0%} of it {blamed}"
        return Reason(TITLES[Cause.SCORE], o.answer.iteration if o.answer is not None else None, more, Cause.SCORE)
    if o.discarded is not None:
        margin = o.discarded.margin
        more = f"{abs(margin):.{distinguishing_digits(abs(margin))}f} {'higher' if margin >= 0 else 'lower'}"
        where = f"at iteration {o.discarded.iteration}" if o.discarded.iteration else "at the start"
        return Reason(f"correct {where}, given up", o.discarded.given_up, f" for a score {more}", Cause.DISCARDED)
    far = far_start(course)
    few = starved(course)
    if far is None and few is not None:
        more = f": {course.n_tried[few[0]]} of {sum(course.n_tried)} iterations"
        return Reason(TITLES[Cause.ARM_STARVED], more=more, about=Cause.ARM_STARVED)
    if o.lost is not None:
        return _led_away(o, o.lost)
    first_only = method_of(snapshot.session.method.name).first_only
    beyond = out_of_range(snapshot.refiner, o.target, first_only) if far is not None else None
    if far is not None and beyond is not None:
        start = beyond.starts[far[0] if far[0] < len(beyond.starts) else 0]
        more = f": starts {start.rotation_deg:.0f}° off"
        return Reason(TITLES[Cause.OUT_OF_RANGE], 0, more, Cause.OUT_OF_RANGE)
    if far is not None:
        return Reason(TITLES[Cause.POOL], 0, f": nearest start {_millimetres(far[1].add_s_mm)}", Cause.POOL)
    if course.score_at_gt is None:
        return Reason("no cause in sight")
    margin = course.score_at_gt.score - score.score
    return Reason("search missed it", more=f": ground truth scores {margin:.{distinguishing_digits(margin)}f} more")


def _led_away(o: FinishedObject, lost: Lost) -> Reason:
    """What made a wrong answer of a pose near ground truth."""
    support = o.target.observation.support
    if lost.by_simulation and support is not None and plane_doubt(support):
        more = f": it explains only {support.inlier_share:.0%} of the background"
        return Reason(TITLES[Cause.PLANE], lost.lost_in, more, Cause.PLANE)
    if lost.by_simulation:
        more = ": it tips over" if lost.n_unstable else f": {_millimetres(o.in_mm(lost.error))} off before"
        return Reason(TITLES[Cause.SIMULATION], lost.lost_in, more, Cause.SIMULATION)
    if lost.score_rose:
        more = ": score rose while the error grew"
        return Reason("refiner led it away", lost.lost_in, more, Cause.REFINER)
    where = f"at iteration {lost.iteration}" if lost.iteration else "at the start"
    return Reason(f"nearer {where}, then lost in iteration {lost.lost_in}", lost.lost_in, about=Cause.REFINER)


def doubt_of(snapshot: Snapshot, o: FinishedObject) -> Reason:
    """What is uncertain about an answer without ground truth."""
    score = _score_of(o)
    if snapshot.data_doubts:
        return Reason(DATA_DOUBTED)
    if is_low(score):
        return Reason("so low a score is likely wrong")
    if leaks(score):
        return Reason(f"{score.shares['missed']:.0%} of its mask unexplained: does it leak?")
    in_sight = o.instance_id == snapshot.target.instance.instance_id
    physics = snapshot.plausible.get("best") if in_sight else None
    if physics is not None and plausibility_verdict(physics, in_focus(snapshot), snapshot.scene).light == "red":
        return Reason("physically impossible where it is")
    if in_sight and snapshot.other_pose is not None and snapshot.landscape is not None:
        return Reason(in_short(snapshot.landscape, snapshot.other_pose))
    rival = o.runner_up
    if rival is None:
        alone = len(o.course.starts) < 2
        return Reason("one hypothesis alone: nothing to compare it with" if alone else "no doubt in sight")
    if rival.lead < NEAR_TIE and rival.apart_mm > APART * o.target.model.diameter_m * 1e3:
        return Reason(f"{_lead(o)}, which lies {_millimetres(rival.apart_mm)} away")
    return Reason(f"{_lead(o)}, no doubt in sight")


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
        return Verdict("✓", _millimetres(row.add_s_mm), f"in the batch, {number}", means, look)
    cause = cause_title(row.cause) if row.cause else "no cause was looked for"
    if snapshot.data_doubts:
        cause = DATA_DOUBTED
    elif row.worst_iteration is not None:
        cause += f" (iteration {row.worst_iteration})"
    return Verdict("✗", _millimetres(row.add_s_mm), cause, means, look)


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
        words += f", nearest {_millimetres(min(known))} off"
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


def _way(snapshot: Snapshot, index: int | None) -> tuple[str, c.Command] | None:
    """The link to an iteration; None where the cursor is there, or there is nothing to see."""
    if index is None or index > len(snapshot.iterations) or (index == snapshot.cursor and not snapshot.is_answer):
        return None
    return f"iteration {index}", visit(snapshot, snapshot.at(index)) if index else c.Seek(0)


def _millimetres(mm: float) -> str:
    return f"{mm:.1f} mm" if mm < 99.95 else f"{mm:.0f} mm"
