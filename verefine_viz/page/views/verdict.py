"""What came of a finished run, object by object, and why: message ``verdict``."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from functools import partial
from typing import Any

from verefine_viz.core.arrays import Float
from verefine_viz.core.problem import ANSWER, Placed, Target
from verefine_viz.core.records import Best
from verefine_viz.diagnosis.causes import ADVICE, TITLES, Cause, Finding, cause_title
from verefine_viz.diagnosis.impossible import impossible
from verefine_viz.diagnosis.lost_poses import lost
from verefine_viz.diagnosis.signs import FinishedObject, RunnerUp, signs
from verefine_viz.evaluation.matched_estimates import CORRECT
from verefine_viz.evaluation.pose_errors import add_s_mm, add_where_add_s_is_below, turning_on
from verefine_viz.methods.registry import method_of
from verefine_viz.page.branch import Branch
from verefine_viz.page.evaluator import CachedEvaluator
from verefine_viz.page.moment import labels_of, runner_up
from verefine_viz.page.views.physics import doubts_of
from verefine_viz.page.views.rows import pose_list

Json = dict[str, Any]
BAD_FIT = 0.6
"""A right answer that scores less fits its image badly."""
UNANSWERED = "no answer was recorded: this is the last pose"
DATA_DOUBTED = "the data do not fit together: look at them first"
NEAR_TIE = 0.005
"""A pose elsewhere that scores less by no more explains the image equally well [score]."""


def verdict_message(branch: Branch, entry: Mapping[int, Any] | None = None) -> Json:
    """Return the verdict on a run that is over.

    Args:
        branch: the run.
        entry: what a batch reports of it by instance_id, which made re-runs.
    """
    objects = finished_objects(branch)
    shown = [_object(branch, o, (entry or {}).get(o.instance_id)) for o in objects]
    truths = {o.instance_id for o in objects if o.target.instance.T_cam_obj_gt is not None}
    return {
        "t": "verdict",
        "branch": branch.index,
        "over": branch.is_over,
        "missing": branch.missing,
        "objects": shown,
        "scene": _scene(shown, truths),
        "doubts": branch.doubts(),
        "notes": _notes(branch),
    }


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
    is_wrong = errors is not None and errors.relative >= CORRECT
    others = [other for other in placed if other.instance_id != instance_id]
    # Among others it is worked out bit by bit, while nothing else waits.
    ask = evaluator.known_plausibility if others else evaluator.plausibility
    physics = ask(target, best.T_cam_obj, others) if errors is None else None
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
            rival, best.score.score - rival.score.score, add_s_mm(target.model, rival.T_cam_obj, best.T_cam_obj)
        ),
        discarded=branch.discarded().get(instance_id) if is_wrong else None,
        lost=lost(iterations, best, partial(_error, evaluator, target)) if is_wrong and not method.has_tree else None,
        undeclared=evaluator.undeclared_turn(target, best.T_cam_obj) if is_wrong else None,
        impossible=None if physics is None else impossible(target, physics, labels),
        around=evaluator.known_landscape(target, best.T_cam_obj) if errors is None else None,
        other_pose=evaluator.known_other_pose(target, best.T_cam_obj, iterations)[1],
    )


def _error(evaluator: CachedEvaluator, target: Target, T_cam_obj: Float) -> float | None:
    errors = evaluator.errors(target, T_cam_obj)
    return None if errors is None else errors.relative


def _object(branch: Branch, o: FinishedObject, batch: Any | None) -> Json:
    best, limit = o.answer, 1e3 * CORRECT * o.target.model.diameter_m
    if best is None:
        title = TITLES[Cause.NO_HYPOTHESIS]
        nothing = dict.fromkeys(("score", "gt_score", "err", "deg", "mm", "way", "k", "arm", "stage", "T", "runner_up",
                                 "also_fits"))  # fmt: skip
        return {"obj": o.instance_id, "label": o.label, "tone": "none", "words": title, "limit": limit, "findings": [],
                **nothing}  # fmt: skip
    refiner = branch.run.method_of(branch.run.length).refiner
    named = list(signs(o, branch.settings, refiner))
    findings = [_finding(sign, branch) for sign in named]
    if batch is not None and batch.cause:
        same = [finding for finding in findings if finding["cause"] == batch.cause]
        for finding in same:  # The gallery opens that iteration.
            finding["k"] = batch.worst_iteration if batch.worst_iteration is not None else finding["k"]
        if not same:
            findings.insert(0, _doubt_of_batch(batch))
    also = _also_fits(o)
    tone, words = _words(branch, o, named, also is not None)
    # Before physics around the answer is known here, the batch's cause is all there is without ground truth.
    if batch is not None and batch.cause and not branch.doubts() and (o.is_wrong or tone == "unknown"):
        tone, words = "wrong" if o.is_wrong else "doubt", cause_title(batch.cause)
    return {
        "obj": o.instance_id,
        "label": o.label,
        "tone": tone,
        "words": words,
        "score": best.score.score,
        "gt_score": o.score_at_gt and o.score_at_gt.score,
        "err": None if o.errors is None else o.errors.add_s_mm,
        "deg": None if o.errors is None else o.errors.rotation_deg,
        "mm": None if o.errors is None else o.errors.translation_mm,
        "way": None if o.errors is None else _turning(o.target, best.T_cam_obj),
        "limit": limit,
        "k": best.iteration,
        "arm": best.arm,
        "stage": best.stage,
        "T": pose_list(best.T_cam_obj),
        "runner_up": o.runner_up
        and {
            "arm": o.runner_up.pose.arm,
            "lead": o.runner_up.lead,
            "apart_mm": o.runner_up.apart_mm,
            "T": pose_list(o.runner_up.pose.T_cam_obj),
        },
        "also_fits": also,
        "findings": findings,
    }


def _turning(target: Target, T_cam_obj: Float) -> str | None:
    """Describe an error of rotation: how much of it is tilt against the table, and how much turn on it."""
    way = turning_on(target, T_cam_obj)
    return None if way is None else way.describe()


def _words(branch: Branch, o: FinishedObject, named: Sequence[Finding], also_fits: bool) -> tuple[str, str]:
    """Return the tone and the words of an object's verdict."""
    tie = "another pose explains the depth equally well"
    reason = f"{named[0].title}{named[0].detail}" if named else ""
    if branch.doubts() and not (o.errors is not None and not o.is_wrong):
        reason = DATA_DOUBTED
    if o.is_wrong:
        steps = o.target.instance.recorded
        if method_of(branch.settings.method.name).repeats and steps and all(s.name != ANSWER for s in steps):
            reason = UNANSWERED  # As of a program that was killed.
        return "wrong", reason or (tie if also_fits else "no cause in sight")
    lead = o.runner_up.describe() if o.runner_up is not None else ""
    if o.errors is not None and o.answer is not None:
        add = add_where_add_s_is_below(o.target, o.answer.T_cam_obj, CORRECT)
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


def _also_fits(o: FinishedObject) -> list[float] | None:
    """Return a pose elsewhere that explains the image equally well."""
    if o.other_pose is not None:
        return pose_list(o.other_pose.T_cam_obj)
    rival, truth = o.runner_up, o.target.instance.T_cam_obj_gt
    limit_mm = 1e3 * CORRECT * o.target.model.diameter_m
    if o.is_wrong and o.score_at_gt is not None and truth is not None:
        if abs(o.score.score - o.score_at_gt.score) <= NEAR_TIE:
            return pose_list(truth)
    elif rival is not None and rival.lead <= NEAR_TIE and rival.apart_mm > limit_mm:
        return pose_list(rival.pose.T_cam_obj)
    return None


def _finding(finding: Finding, branch: Branch) -> Json:
    k = finding.iteration
    return {
        "cause": finding.cause,
        "title": finding.title,
        "text": finding.text,
        "k": k if k is not None and k <= branch.run.length else None,
        "advice": ADVICE.get(finding.cause, ""),
        "try": finding.try_ or None,
        "by_batch": False,
    }


def _doubt_of_batch(row: Any) -> Json:
    return {
        "cause": row.cause,
        "title": cause_title(row.cause),
        "text": row.evidence,
        "k": row.worst_iteration,
        "advice": ADVICE.get(row.cause, ""),
        "try": None,
        "by_batch": True,
    }


def _scene(objects: Sequence[Json], truths: Collection[int]) -> Json:
    """Return the verdict on all objects, of which those in ``truths`` have ground truth; the worst is named first."""
    if not objects:
        return {"tone": "unknown", "words": "", "worst": None, "right": 0, "known": 0}
    known = [o for o in objects if o["err"] is not None]
    impossible = [o for o in objects if any(f["cause"] == Cause.IMPOSSIBLE for f in o["findings"])]
    lowest = min(impossible or objects, key=lambda o: o["score"] or 0.0)
    n, some, asked = len(objects), len(impossible), len(truths)
    if asked:
        right = sum(o["err"] < o["limit"] for o in known)
        words = f"{right} of {asked} right" + (f", {n - asked} without ground truth" if asked < n else "")
        farthest = max(known, key=lambda o: o["err"] / o["limit"], default=lowest)
        worst = lowest if impossible and right == asked else farthest
        tone = "wrong" if right < asked else "doubt" if impossible else "right"
        return {"tone": tone, "words": words, "worst": worst["obj"], "right": right, "known": asked}
    words = f"{some} of {n} objects cannot stand so" if some else f"{n} objects, no ground truth"
    tone = "doubt" if some or any(o["tone"] == "doubt" for o in objects) else "unknown"
    return {"tone": tone, "words": words, "worst": lowest["obj"], "right": 0, "known": 0}


def _notes(branch: Branch) -> list[str]:
    """Return what of the frame makes physics doubtful."""
    observation, physics = branch.run.problem.observation, branch.settings.physics
    if observation.support is None:
        return [f"No physics: {observation.support_note or 'no support plane was found'}."]
    notes = doubts_of(branch, observation.support)
    if physics.enabled and physics.collider == "hull":
        notes.append("Physics takes every model for its convex hull (physics.collider = hull).")
    return notes
