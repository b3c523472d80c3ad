"""What came of a finished run, object by object, and why: message ``verdict``."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

from msgspec import structs

from verefine_viz.core.accuracy import CORRECT
from verefine_viz.core.arrays import Float
from verefine_viz.core.causes import CAUSES, Cause, advice_on, cause_title
from verefine_viz.core.finding import Finding
from verefine_viz.core.moment import Moment
from verefine_viz.core.problem import ANSWER, Placed, Target
from verefine_viz.core.records import Best
from verefine_viz.core.refiner_steps import TrainedRefiner
from verefine_viz.core.remedies import SettingValue
from verefine_viz.core.text_format import listed
from verefine_viz.diagnosis.impossible import impossible
from verefine_viz.diagnosis.lost_poses import lost
from verefine_viz.diagnosis.signs import FinishedObject, RunnerUp, signs
from verefine_viz.diagnosis.usable_remedies import is_read
from verefine_viz.evaluation.rotation_errors import turning_on
from verefine_viz.evaluation.trained_range import start_of
from verefine_viz.methods.known_methods import method_of
from verefine_viz.page.frame_objects import labels_of
from verefine_viz.page.protocol import pose_matrix
from verefine_viz.page.run_messages import (
    AllowedByImage,
    AnswerTone,
    FindingShown,
    JudgedObject,
    JudgedScene,
    RefinerRange,
    RunnerUpPose,
    VerdictMessage,
)
from verefine_viz.page.views.allowed_ghosts import allowed_ghosts
from verefine_viz.page.views.doubts import shown_doubts
from verefine_viz.page.views.film_moments import moments_of, shown_moment
from verefine_viz.page.views.physics_doubts import doubts_of
from verefine_viz.page.wire import Pose, pose_numbers
from verefine_viz.run.record import Answer
from verefine_viz.run.session_file import DURING_A_RUN

if TYPE_CHECKING:
    from verefine_viz.page.branch import Branch
    from verefine_viz.page.evaluator import CachedEvaluator

BAD_FIT = 0.6
"""A right answer that scores less fits its image badly."""
UNANSWERED = "no answer was recorded: this is the last pose"
ERROR_CAUSES = frozenset(
    {
        *(Cause.ARM_STARVED, Cause.BUDGET, Cause.OUT_OF_RANGE, Cause.REFINER, Cause.POOL, Cause.DISCARDED),
        *(Cause.UNDECIDED, Cause.SIMULATION),
    }
)
"""What became of the hypotheses, call by call, and what added to the error show these."""
NEAR_TIE = 0.005
"""A pose elsewhere that scores less by no more explains the image equally well [score]."""


def verdict_message(branch: Branch, entry: Mapping[int, Answer] | None = None) -> VerdictMessage:
    """Return the verdict on a run that is over.

    Args:
        branch: the run.
        entry: what a batch reports of it by instance_id, which made re-runs.
    """
    objects = finished_objects(branch)
    films = _films(branch, objects, entry or {})
    shown = [_object(branch, o, (entry or {}).get(o.instance_id), films.get(o.instance_id, ())) for o in objects]
    truths = {o.instance_id for o in objects if o.target.instance.T_cam_obj_gt is not None}
    return VerdictMessage(
        branch=branch.index,
        over=branch.is_over,
        missing=branch.missing,
        objects=shown,
        scene=_scene(shown, truths, bool(branch.doubts())),
        doubts=shown_doubts(branch),
        notes=_notes(branch),
    )


def films(branch: Branch, entry: Mapping[int, Answer] | None = None) -> dict[int, tuple[Moment, ...]]:
    """Return the key moments of every object of a run that is over, by instance; none of one without an answer.

    Args:
        branch: the run.
        entry: what a batch reports of it by instance_id.
    """
    return _films(branch, finished_objects(branch), entry or {})


def _films(
    branch: Branch, objects: Sequence[FinishedObject], entry: Mapping[int, Answer]
) -> dict[int, tuple[Moment, ...]]:
    record = branch.run.record(branch.settings, {}) if objects else None
    out: dict[int, tuple[Moment, ...]] = {}
    for o in objects:
        if record is not None and o.answer is not None:
            findings, other = merged(_named(branch, o), entry.get(o.instance_id)), _also_fits(o)
            moments = moments_of(branch, record, o, findings, None if other is None else pose_matrix(other))
            out[o.instance_id] = moments
    return {own: moments for own, moments in out.items() if moments}


def _named(branch: Branch, o: FinishedObject) -> list[Finding]:
    """Return the signs of a finished object."""
    return list(signs(o, branch.settings, branch.run.method_of(branch.run.length).refiner))


def finished_objects(branch: Branch) -> tuple[FinishedObject, ...]:
    """Gather what the run made of every object; none while it is not over, nor of a record that ended early."""
    run = branch.run
    if not branch.is_over:
        return ()
    state, labels = run.final_state, labels_of(run.problem)
    placed = [
        Placed(target.instance.instance_id, target.model, best.T_cam_obj)
        for target, best in zip(state.problem.targets, state.best, strict=True)
        if best is not None
    ]
    return tuple(
        _finished(branch, target, own, best, labels, placed)
        for target, own, best in zip(state.problem.targets, state.objects, state.best, strict=True)
    )


def _finished(
    branch: Branch, target: Target, own: Any, best: Best | None, labels: Mapping[int, str], placed: Sequence[Placed]
) -> FinishedObject:
    """Gather one object; ``own``: the method's state, None where it has no hypothesis; ``placed``: all answers."""
    instance_id, T_gt = target.instance.instance_id, target.instance.T_cam_obj_gt
    label, evaluator = labels[instance_id], branch.final_evaluator
    if best is None or own is None:
        return FinishedObject(target, label)
    method = method_of(branch.settings.method.name)
    iterations = branch.run.iterations_of(instance_id)
    starts = [
        next((e for e in reversed(arm.entries) if e.stage == "edited" and e.iteration == 0), arm.entries[0])
        for arm in own.arms
    ]
    errors = evaluator.errors(target, best.T_cam_obj)
    is_wrong = errors is not None and not errors.is_correct
    others = [other for other in placed if other.instance_id != instance_id]
    # Among others it is worked out bit by bit, while nothing else waits.
    ask = evaluator.known_plausibility if others else evaluator.plausibility
    physics = ask(target, best.T_cam_obj, others) if errors is None else None
    own_pose = Placed(instance_id, target.model, best.T_cam_obj)
    rival = runner_up(branch, own, best)
    return FinishedObject(
        target,
        label,
        best,
        errors,
        starts=tuple(evaluator.errors(target, start.T_cam_obj) for start in starts),
        n_tried=tuple(sum(i.arm == j for i in iterations) for j in range(len(own.arms))),
        score_at_gt=evaluator.score(target, T_gt) if T_gt is not None else None,
        runner_up=rival
        and RunnerUp(
            rival,
            best.score.score - rival.score.score,
            evaluator.add_s_mm(target.model, rival.T_cam_obj, best.T_cam_obj),
        ),
        discarded=branch.discarded().get(instance_id) if is_wrong else None,
        lost=lost(iterations, best, partial(_error, evaluator, target)) if is_wrong and not method.has_tree else None,
        undeclared=evaluator.undeclared_turn(target, best.T_cam_obj) if is_wrong else None,
        impossible=None
        if physics is None
        else impossible(target, own_pose, physics, labels, branch.measured_heights()),
        allowed=evaluator.known_allowed(target, best.T_cam_obj, branch.run.iterations),
        seen=evaluator.seen_error(target, best.T_cam_obj, branch.run.iterations) if is_wrong else None,
    )


def runner_up(branch: Branch, own: Any, best: Best) -> Best | None:
    """Return the best pose of another hypothesis; None where the method does not answer with the best of all."""
    if not method_of(branch.settings.method.name).answers_best_of_all:
        return None
    others = [entry.as_best(j) for j, arm in enumerate(own.arms) if j != best.arm for entry in arm.entries]
    return max(others, key=lambda pose: pose.score.score, default=None)


def _error(evaluator: CachedEvaluator, target: Target, T_cam_obj: Float) -> float | None:
    errors = evaluator.errors(target, T_cam_obj)
    return None if errors is None else errors.relative


def _object(branch: Branch, o: FinishedObject, batch: Answer | None, film: Sequence[Moment] = ()) -> JudgedObject:
    best, rival, limit = o.answer, o.runner_up, 1e3 * CORRECT * o.target.model.diameter_m
    if best is None:
        return JudgedObject(o.instance_id, o.label, "none", cause_title(Cause.NO_HYPOTHESIS), limit, findings=())
    named = _named(branch, o)
    findings, own_causes = merged(named, batch), {sign.cause for sign in named}
    also = _also_fits(o)
    tone, words = _words(branch, o, named, also is not None)
    # Before physics around the answer is known here, the batch's cause is all there is without ground truth.
    if batch is not None and batch.cause and not branch.doubts() and (o.is_wrong or tone == "unknown"):
        tone, words = "wrong" if o.is_wrong else "doubt", cause_title(batch.cause)
    return JudgedObject(
        obj=o.instance_id,
        label=o.label,
        tone=tone,
        words=words,
        limit=limit,
        findings=[_finding(finding, finding.cause not in own_causes, branch) for finding in findings],
        score=best.score.score,
        gt_score=o.score_at_gt and o.score_at_gt.score,
        err=None if o.errors is None else o.errors.add_s_mm,
        deg=None if o.errors is None else o.errors.rotation_deg,
        mm=None if o.errors is None else o.errors.translation_mm,
        way=None if o.errors is None else _turning(o.target, best.T_cam_obj),
        k=best.iteration,
        arm=best.arm,
        stage=best.stage,
        T=pose_numbers(best.T_cam_obj),
        runner_up=rival
        and RunnerUpPose(rival.pose.arm, rival.lead, rival.apart_mm, pose_numbers(rival.pose.T_cam_obj)),
        also_fits=also,
        allowed=_allowed(branch, o, [finding.cause for finding in findings]),
        film=[shown_moment(moment) for moment in film],
        trained=_trained(branch, o.target),
    )


def merged(signs: Sequence[Finding], batch: Answer | None) -> list[Finding]:
    """One finding for each cause: what a batch's re-runs confirmed, then what the run shows itself.

    Where both name a cause the sign stays, which is shorter, with the batch's iteration: of its main finding the one
    that its gallery opens.
    """
    of_batch = [] if batch is None else list(batch.findings)
    if batch is not None and of_batch and batch.worst_iteration is not None:
        of_batch[0] = structs.replace(of_batch[0], iteration=batch.worst_iteration)
    by_cause = {one.cause: one for k, one in enumerate(of_batch) if one.cause and (k == 0 or one.is_confirmed)}
    at = {cause: one.iteration for cause, one in by_cause.items() if one.iteration is not None}
    own = [structs.replace(sign, iteration=at.get(sign.cause, sign.iteration)) for sign in signs]
    return [*(one for cause, one in by_cause.items() if all(sign.cause != cause for sign in signs)), *own]


def _turning(target: Target, T_cam_obj: Float) -> str | None:
    """Describe an error of rotation: how much of it is tilt against the table, and how much turn on it."""
    way = turning_on(target, T_cam_obj)
    return None if way is None else way.describe()


def _words(branch: Branch, o: FinishedObject, named: Sequence[Finding], also_fits: bool) -> tuple[AnswerTone, str]:
    """Return the tone and the words of an object's verdict."""
    tie = "another pose explains the depth equally well"
    reason = f"{named[0].title}{named[0].detail}" if named else ""
    data = [doubt.title for doubt in branch.doubts() if doubt.concerns(o.instance_id)]
    if data and not (o.errors is not None and not o.is_wrong):
        reason = f"look at the data first: {listed(dict.fromkeys(data))}"
    if o.is_wrong:
        steps = o.target.instance.recorded
        if method_of(branch.settings.method.name).repeats and steps and all(s.name != ANSWER for s in steps):
            reason = UNANSWERED  # As of a program that was killed.
        return "wrong", reason or (tie if also_fits else "no cause in sight")
    lead = o.runner_up.describe(o.answer) if o.runner_up is not None and o.answer is not None else ""
    if o.errors is not None and o.answer is not None:
        add = branch.final_evaluator.add_over_symmetries(o.target, o.answer.T_cam_obj)
        if add is not None:
            return "right", f"by ADD-S only: ADD over its symmetries is {add:.0%}"
        if o.score.score < BAD_FIT:
            return "doubt", f"right, but it fits badly: score {o.score.score:.2f}"
        return "right", f"{tie}, and this one is right" if also_fits else lead
    if reason:
        return "doubt", reason
    if also_fits:
        return "doubt", tie
    alone = "one hypothesis alone: nothing to compare it with" if len(o.starts) < 2 else "no doubt in sight"
    return "unknown", f"{lead}, no doubt in sight" if lead else alone


def _also_fits(o: FinishedObject) -> Pose | None:
    """Return a pose elsewhere that explains the image equally well."""
    if o.allowed is not None and o.allowed.furthest is not None:
        return pose_numbers(o.allowed.furthest.T_cam_obj)
    rival, truth = o.runner_up, o.target.instance.T_cam_obj_gt
    limit_mm = 1e3 * CORRECT * o.target.model.diameter_m
    if o.is_wrong and o.score_at_gt is not None and truth is not None:
        if abs(o.score.score - o.score_at_gt.score) <= NEAR_TIE:
            return pose_numbers(truth)
    elif rival is not None and rival.lead <= NEAR_TIE and rival.apart_mm > limit_mm:
        return pose_numbers(rival.pose.T_cam_obj)
    return None


def _allowed(branch: Branch, o: FinishedObject, causes: Sequence[Any]) -> AllowedByImage | None:
    if o.allowed is None or o.answer is None:
        return None
    evaluator, model, T_answer = branch.final_evaluator, o.target.model, o.answer.T_cam_obj
    return allowed_ghosts(o.allowed, lambda T: evaluator.add_s_mm(model, T, T_answer), causes, BAD_FIT)


def _trained(branch: Branch, target: Target) -> RefinerRange | None:
    refiner, T_gt = branch.run.method_of(branch.run.length).refiner, target.instance.T_cam_obj_gt
    trained = refiner.trained_range if isinstance(refiner, TrainedRefiner) else None
    if trained is None or T_gt is None:
        return None
    starts = [start_of(target.model, one.T_cam_obj, T_gt) for one in target.instance.hypotheses]
    most_mm = 1e3 * trained.shift_radii * target.model.diameter_m / 2
    return RefinerRange(trained.rotation_deg, most_mm, [(one.rotation_deg, one.shift_mm) for one in starts])


def _finding(finding: Finding, by_batch: bool, branch: Branch) -> FindingShown:
    k = finding.iteration
    return FindingShown(
        cause=finding.cause,
        title=finding.title,
        text=finding.text,
        k=k if k is not None and k <= branch.run.length else None,
        advice=advice_on(finding.cause),
        try_=finding.try_ or (_remedy(finding, branch) if by_batch else None),
        by_batch=by_batch,
        numbers={name: number for name, number in finding.numbers.items() if math.isfinite(number)},
        tab="errors" if finding.cause in ERROR_CAUSES else "",
        tab_there="physics" if finding.cause == Cause.SIMULATION else "errors" if finding.cause in ERROR_CAUSES else "",
    )


def _remedy(finding: Finding, branch: Branch) -> dict[str, SettingValue] | None:
    """Return the first remedy of a cause that a branch can have; None where there is none."""
    known = CAUSES[Cause(finding.cause)].remedies if finding.cause in CAUSES else ()
    for remedy in (one.for_finding(finding.numbers) for one in known):
        if remedy.setting.partition(".")[0] in DURING_A_RUN and is_read(remedy, branch.settings):
            changes = remedy.changes(branch.settings)
            if changes:
                return changes
    return None


def _scene(objects: Sequence[JudgedObject], truths: Collection[int], in_doubt: bool) -> JudgedScene:
    """Return the verdict on all objects, of which those in ``truths`` have ground truth; the worst is named first.

    ``in_doubt``: whether data do not fit together, on which physics rests as well.
    """
    if not objects:
        return JudgedScene("unknown", "", worst=None, right=0, known=0)
    known = [(o.err, o) for o in objects if o.err is not None]
    impossible = [o for o in objects if any(f.cause == Cause.IMPOSSIBLE for f in o.findings)]
    lowest = min(impossible or objects, key=lambda o: o.score or 0.0)
    n, some, asked = len(objects), len(impossible), len(truths)
    if asked:
        right = sum(err < o.limit for err, o in known)
        words = f"{right} of {asked} right" + (f", {n - asked} without ground truth" if asked < n else "")
        _, farthest = max(known, key=lambda one: one[0] / one[1].limit, default=(0.0, lowest))
        worst = lowest if impossible and right == asked else farthest
        tone = "wrong" if right < asked else "doubt" if impossible else "right"
        return JudgedScene(tone, words, worst.obj, right, asked)
    words = f"{some} of {n} objects cannot stand so" if some else f"{n} objects, no ground truth"
    words = f"{n} objects, no ground truth, data in doubt" if in_doubt else words
    tone = "doubt" if some or any(o.tone == "doubt" for o in objects) else "unknown"
    return JudgedScene(tone, words, lowest.obj, right=0, known=0)


def _notes(branch: Branch) -> list[str]:
    """Return what of the frame makes physics doubtful."""
    observation, physics = branch.run.problem.observation, branch.settings.physics
    if observation.support is None:
        return [f"No physics: {observation.support_note or 'no support plane was found'}."]
    notes = doubts_of(branch, observation.support)
    if physics.enabled and physics.collider == "hull":
        notes.append("Physics takes every model for its convex hull (physics.collider = hull).")
    return notes
