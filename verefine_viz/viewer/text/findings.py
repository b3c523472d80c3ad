"""What is probably wrong. Each finding names its evidence and what to do."""

from __future__ import annotations

from dataclasses import dataclass

from verefine_viz.batch.summary import MUCH, MUCH_SCORE
from verefine_viz.diagnosis.causes import DECLARE, Cause, cause_title, distinct_texts
from verefine_viz.diagnosis.signs import Course, far_start, ground_truth_is_unfit, is_low, leaks, out_of_range, starved
from verefine_viz.methods.registry import method_of
from verefine_viz.run.record import DATA_FIRST
from verefine_viz.scenes.instance_notes import without
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.snapshot.finished_objects import FinishedObject
from verefine_viz.viewer.snapshot.snapshot import Snapshot, visit
from verefine_viz.viewer.state.batch_gallery import Entry
from verefine_viz.viewer.text.display_names import counted, in_focus, is_correct
from verefine_viz.viewer.text.plausibility_verdict import (
    gravity_doubt,
    plane_doubt,
    unsupported_stacking,
    unsupported_stacking_warning,
)
from verefine_viz.viewer.text.pose_words import preferred_wrong, start_errors

SIDE_BY_SIDE = "put them side by side"


@dataclass(frozen=True)
class Finding:
    """One thing worth knowing."""

    text: str
    red: bool = False
    calm: bool = False
    """Good to know, but nothing is wrong yet."""
    command: c.Command | None = None
    """What to try."""
    label: str = ""
    """Words for the command's link."""
    cause: Cause | None = None
    """What it is evidence of."""


def findings(snapshot: Snapshot) -> tuple[Finding, ...]:
    """All findings, the most telling first."""
    checks = (_of_data, _of_batch, _support, _no_hypothesis, _stacking, _why_wrong, _leak, _low)
    known = [finding for check in checks for finding in check(snapshot)]
    return (*known, *_missed(snapshot, is_explained=any(one.red or one.cause is not None for one in known)))


def _of_data(snapshot: Snapshot) -> list[Finding]:
    """A wrong camera or wrong models are behind all that follows."""
    return [Finding(f"{DATA_FIRST} {doubt}.", red=True) for doubt in snapshot.data_doubts]


def _of_batch(snapshot: Snapshot) -> list[Finding]:
    """Why the batch says that this object failed, and the way to the iteration."""
    entry, words = snapshot.entry, batch_words(snapshot)
    if entry is None or not words:
        return []
    command = None
    if snapshot.cursor != entry.iteration:
        command = c.OpenAt(snapshot.frame, entry.iteration, instance=entry.row.instance_id)
    label = f"go to iteration {entry.iteration}"
    return [Finding(words, entry.is_wrong, not entry.is_wrong, command, label)]


def _support(snapshot: Snapshot) -> list[Finding]:
    observation = snapshot.target.observation
    support = observation.support
    if support is None:
        note = observation.support_note or "no support plane was found"
        given = snapshot.session.scene.gravity != "plane"
        remedy = "Check scene.gravity" if given else "Give scene.gravity"
        return [Finding(f"No physics: {note}. {remedy}, or choose a frame that shows the table.", red=True)]
    doubts = [doubt for doubt in (plane_doubt(support), gravity_doubt(support)) if doubt]
    return [*(Finding(doubt, cause=Cause.PLANE) for doubt in doubts), *_hulls(snapshot)]


def _hulls(snapshot: Snapshot) -> list[Finding]:
    physics = snapshot.session.physics
    if not physics.enabled or physics.collider != "hull":
        return []
    command = c.Restart((("physics.collider", "decomposition"),))
    text = "Physics takes every model for its convex hull (physics.collider = hull)."
    return [Finding(text, calm=True, command=command, label="restart with convex parts")]


def _no_hypothesis(snapshot: Snapshot) -> list[Finding]:
    if snapshot.state is not None:
        return []
    known = without(snapshot.target.instance, snapshot.target.model)
    why = next((note for note in snapshot.problem.notes if note.startswith(known)), None)
    return [Finding(f"{why or f'{known}add a results file that holds object {snapshot.target.model.obj_id}'}.")]


def _why_wrong(snapshot: Snapshot) -> list[Finding]:
    """What made the answer wrong. As in a batch, a turn that the model should have declared explains all of it."""
    if snapshot.undeclared is None or not _is_over(snapshot):
        given_up = _discarded(snapshot)
        if given_up:
            return [*given_up, *_wrong_score(snapshot)]
        return [*(_lost(snapshot) or _far_start(snapshot)), *_starved(snapshot), *_wrong_score(snapshot)]
    turn = snapshot.undeclared.in_words(snapshot.name)
    if snapshot.entry is not None and turn in snapshot.entry.row.evidence:
        return []
    advice = f"{DECLARE[0].upper()}{DECLARE[1:]}."
    command, label = c.ScoreGroundTruth(), SIDE_BY_SIDE
    if snapshot.undeclared.texture_tells and snapshot.session.score.colour_weight == 0:
        command, label = c.Fork((("score.colour_weight", 0.1),), 0, run=True), "what if score.colour_weight = 0.1?"
    return [Finding(f"{turn} {advice}", True, False, command, label, Cause.SYMMETRIC)]


def _discarded(snapshot: Snapshot) -> list[Finding]:
    """A correct pose was there, and another was preferred."""
    own = _finished(snapshot)
    given_up = own.discarded if own is not None else None
    if own is None or given_up is None or own.errors is None:
        return []
    made = f"in iteration {given_up.iteration}" if given_up.iteration else "at the start"
    pose, answer = distinct_texts(given_up.score.score, given_up.answer.score.score, 3)
    since = f"from iteration {given_up.given_up} on" if given_up.given_up > given_up.iteration else "at once"
    text = (
        f"Hypothesis {given_up.arm + 1}{_whose(snapshot)} had a correct pose {made}, which scores {pose}. A wrong pose "
        f"was preferred to it {since}: the answer scores {answer} and is {own.errors.add_s_mm:.1f} mm off."
    )
    command = visit(snapshot, snapshot.at(max(given_up.iteration, 1)))
    return [Finding(text, True, False, command, "show it", Cause.DISCARDED)]


def _finished(snapshot: Snapshot) -> FinishedObject | None:
    """The object in focus, after the run."""
    return next((o for o in snapshot.finished if o.instance_id == snapshot.target.instance.instance_id), None)


def _lost(snapshot: Snapshot) -> list[Finding]:
    """A pose near ground truth was there, and the answer, which came from it, is wrong."""
    own = _finished(snapshot)
    lost = own.lost if own is not None else None
    if own is None or own.answer is None or own.errors is None or lost is None:
        return []
    when = f"in iteration {lost.iteration}" if lost.iteration else "at its start"
    scored = f" and scored {lost.score.score:.2f}" if lost.score is not None else ""
    text = (
        f"Hypothesis {own.answer.arm + 1}{_whose(snapshot)} was {own.in_mm(lost.error):.1f} mm off {when}{scored}; the "
        f"answer, which came from it, is {own.errors.add_s_mm:.1f} mm off and scores {own.answer.score.score:.2f}. The "
        f"{'simulation' if lost.by_simulation else 'refiner'} led it away, most in iteration {lost.lost_in}."
    )
    if lost.by_simulation and lost.n_unstable:
        text += f" In {counted(lost.n_unstable, 'iteration')} its centre of mass is outside its support: it tips over."
    command = visit(snapshot, snapshot.at(lost.lost_in))
    cause = Cause.SIMULATION if lost.by_simulation else Cause.REFINER
    return [Finding(text, True, False, command, "show it", cause)]


def _course(snapshot: Snapshot) -> Course:
    """How the object in focus has fared up to the cursor."""
    best, ground_truth = snapshot.poses.get("best"), snapshot.ground_truth
    n_arms = len(snapshot.state.arms) if snapshot.state is not None else 0
    return Course(
        tuple(start_errors(snapshot)),
        tuple(sum(i.arm == j for i in snapshot.own_iterations) for j in range(n_arms)),
        best.errors if best is not None else None,
        best.score if best is not None else None,
        ground_truth.score if ground_truth is not None else None,
    )


def _far_start(snapshot: Snapshot) -> list[Finding]:
    course = _course(snapshot)
    start = far_start(course)
    reached = (course.answer, *(errors for _, _, errors in snapshot.error_series[-1:]))
    if start is None or any(is_correct(errors) for errors in reached):
        return []
    if ground_truth_is_unfit(course.score, course.score_at_gt):  # Errors against it say nothing about the starts.
        return []
    j, errors = start
    off = (
        f"{errors.rotation_deg:.0f}° and {errors.translation_mm:.0f} mm (hypothesis {j + 1}), ADD(-S) "
        f"{errors.relative:.0%} of the diameter."
    )
    if not _is_over(snapshot):
        text = f"The nearest start{_whose(snapshot)} is off by {off} Refinement may get there or not: run it and see."
        return [Finding(text, calm=True, command=c.SelectArm(j), label="show it")]
    first_only = method_of(snapshot.session.method.name).first_only
    beyond = out_of_range(snapshot.refiner, snapshot.target, first_only)
    if beyond is not None:
        text = (
            f"No hypothesis{_whose(snapshot)} is within the training range of {snapshot.session.method.refiner}, "
            f"{beyond.trained.rotation_deg:.0f}° and {beyond.starts[0].largest_shift_mm(beyond.trained):.0f} mm: best "
            f"initial error {off}"
        )
        return [Finding(text, True, False, c.SelectArm(j), "show it", Cause.OUT_OF_RANGE)]
    text = (
        f"No hypothesis{_whose(snapshot)} starts near: best initial error {off} Refinement did not help: look at the "
        "estimator first."
    )
    return [Finding(text, True, False, c.SelectArm(j), "show it", Cause.POOL)]


def _stacking(snapshot: Snapshot) -> list[Finding]:
    """Objects rest on each other, and the method does not know."""
    warning = unsupported_stacking_warning(snapshot)
    if not warning:
        return []
    command = c.Restart((("method.name", "vf_breadth"),))
    answers = [snapshot.scene.object(own).errors for own in unsupported_stacking(snapshot)]
    is_solved = snapshot.is_answer and all(is_correct(e) for e in answers)
    return [Finding(warning, calm=is_solved, command=command, label="restart with VF_b")]


def _whose(snapshot: Snapshot) -> str:
    """As in: of mug. Nothing where there is one object."""
    return f" of {in_focus(snapshot).label}" if len(snapshot.scene.objects) > 1 else ""


def _is_over(snapshot: Snapshot) -> bool:
    """Whether the object in focus has had all its iterations at the cursor: then its best pose is the answer."""
    own = snapshot.own_iterations
    if snapshot.is_partial or not own or own[-1].index > snapshot.cursor:
        return False
    takes_turns = own[-1].scene_pass is not None or own[-1].tree is not None
    moved_on = not takes_turns and snapshot.iterations[-1].instance_id != own[-1].instance_id
    return moved_on or snapshot.progress.done == snapshot.progress.total


def _starved(snapshot: Snapshot) -> list[Finding]:
    """A hypothesis that was the best start, by ground truth or by score, and got next to no iterations."""
    course, shown = _course(snapshot), snapshot.shown
    start = starved(course) if _is_over(snapshot) else None
    if start is None or shown is None or shown.choice is None or not shown.choice.exploration.any():
        return []
    j, errors = start
    wider = max(2 * snapshot.session.method.exploration, 0.05)
    text = (
        f"Hypothesis {j + 1}{_whose(snapshot)} started nearest to ground truth ({errors.add_s_mm:.0f} mm) but was "
        f"tried {course.n_tried[j]} of {sum(course.n_tried)} times: its exploration bonus never won."
    )
    command = c.Fork((("method.exploration", wider),), 0, run=True)
    return [Finding(text, True, False, command, f"what if c = {wider:g}?", Cause.ARM_STARVED)]


def _wrong_score(snapshot: Snapshot) -> list[Finding]:
    course = _course(snapshot)
    if not _is_over(snapshot) or not course.is_wrong or not course.is_misled:
        return []
    assert course.score is not None
    assert course.score_at_gt is not None
    if ground_truth_is_unfit(course.score, course.score_at_gt):
        text = (
            f"The ground truth{_whose(snapshot)} does not fit this image: it scores {course.score_at_gt.score:.2f}, "
            f"the answer {course.score.score:.2f}. The mesh may have other axes than the poses are about, or the poses "
            "another frame."
        )
        return [Finding(text, True, False, c.ScoreGroundTruth(), SIDE_BY_SIDE, Cause.GROUND_TRUTH)]
    text = preferred_wrong(snapshot, course.score, course.score_at_gt)
    return [Finding(text, True, False, c.ScoreGroundTruth(), SIDE_BY_SIDE, Cause.SCORE)]


def _missed(snapshot: Snapshot, is_explained: bool) -> list[Finding]:
    """Ground truth scores more than the answer; what can help then is said only where nothing else explains it."""
    course = _course(snapshot)
    wrong, at_gt = course.score, course.score_at_gt
    if course.is_misled or snapshot.undeclared is not None or not _is_over(snapshot) or not course.is_wrong:
        return []
    if course.answer is None or wrong is None or at_gt is None:
        return []
    how = f"{course.answer.rotation_deg:.0f}° and {course.answer.translation_mm:.0f} mm off"
    scores = f"the ground truth would score {at_gt.score:.2f}, the answer scores {wrong.score:.2f} ({how})."
    if is_explained:
        return [Finding(f"T{scores[1:]}", calm=True, command=c.ScoreGroundTruth(), label=SIDE_BY_SIDE)]
    text = f"The search missed it: {scores} More iterations or better hypotheses can help; another score cannot."
    return [Finding(text, command=c.ScoreGroundTruth(), label=SIDE_BY_SIDE)]


def _leak(snapshot: Snapshot) -> list[Finding]:
    best = snapshot.poses.get("best")
    if not _is_over(snapshot) or best is None or best.score is None or not leaks(best.score):
        return []
    missed, at_gt = best.score.shares["missed"], snapshot.ground_truth.score if snapshot.ground_truth else None
    too = f", {at_gt.shares['missed']:.0%} even at ground truth" if at_gt is not None and leaks(at_gt) else ""
    text = (
        f"{missed:.0%} of the pixels are missed (red){too}: the mask holds surface that the pose does not explain. "
        "If the red pixels form another object, the mask leaks onto it."
    )
    return [Finding(text, True, False, c.ColorCloud("class"), "colour the cloud by class", Cause.MASK)]


def _low(snapshot: Snapshot) -> list[Finding]:
    if not _is_over(snapshot) or snapshot.state is None or not is_low(snapshot.state.best.score):
        return []
    score = snapshot.state.best.score.score
    if not method_of(snapshot.session.method.name).verifies:
        return [Finding(f"The answer{_whose(snapshot)} scores only {score:.2f}. Expect it to be wrong.")]
    text = f"All hypotheses{_whose(snapshot)} stay low: the best score is {score:.2f}. Expect the answer to be wrong."
    return [Finding(text)]


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
