"""Tests whether the verification score prefers the wrong answer to ground truth, or cannot tell the two apart."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.causes import Cause
from verefine_viz.core.finding import Finding
from verefine_viz.core.problem import Placed
from verefine_viz.core.scores import PIXEL_CLASSES, PoseScore
from verefine_viz.diagnosis import lost_poses
from verefine_viz.diagnosis.case import Case
from verefine_viz.diagnosis.number_words import distinct_texts
from verefine_viz.diagnosis.other_pose import unseen_error
from verefine_viz.diagnosis.preferred_poses import preferred
from verefine_viz.evaluation.allowed_search import alike_pose
from verefine_viz.evaluation.rotation_errors import rotation_error_deg, turning_on
from verefine_viz.evaluation.seen_error import nearest_allowed
from verefine_viz.rendering.explained import ExplainedPixels

POLISHING = 12
"""Most refiner calls from ground truth, so that it does not lose by being a millimetre off. While a pose is correct it
is in the basin of ground truth: the 28 objects of eight YCB-V frames come to rest 0.3 to 6.3 % of the diameter away."""
AT_REST = 1e-6
"""Largest change of a pose that the refiner has finished moving."""
WORTH_A_WAY_DEG = 5.0
"""Rotation below which its direction does not matter [deg]."""


def score(case: Case) -> Finding | None:
    """Finds that the answer scores no lower than ground truth, as it is or refined."""
    if case.answer is None or not case.lab.traits.verifies:
        return None
    if case.lab.traits.has_tree:
        return _cost(case, case.answer.T_cam_obj)
    wrong = scored(case, case.answer.T_cam_obj[None])[0]
    right = max(scored(case, _poses_at_gt(case)), key=lambda s: s.score)
    if wrong.score < right.score:
        return None
    of = "scene_" if case.lab.traits.takes_turns else ""
    evidence = {"error": case.error}
    for whose, one in (("", wrong), ("_of_ground_truth", right)):
        evidence[f"{of}score{whose}"] = one.score
        if not one.has_parts:
            continue
        evidence |= {f"{of}{name}_share{whose}": one.shares[name] for name in PIXEL_CLASSES}
        evidence |= {f"{of}depth_fit{whose}": one.depth_fit, f"{of}normal_fit{whose}": one.normal_fit}
    whose = "The scene's score" if case.lab.traits.takes_turns else "The score"
    return Finding(Cause.SCORE, preferred(case.name, case.error, wrong, right, _way(case), whose), evidence, True)


def discarded(case: Case) -> Finding | None:
    """Finds that a correct pose was reached and another preferred, by its own score or by that of its scene."""
    if case.answer is None or not case.lab.traits.verifies:
        return None
    seen = lost_poses.discarded(case.own, case.answer, lambda T: case.error_of(T) < case.threshold)
    if seen is None:
        return None
    T, error = seen.stage.T_cam_obj, case.error_of(seen.stage.T_cam_obj)
    evidence = {
        "hypothesis": float(seen.arm),
        "iteration": float(seen.iteration),
        "given_up_in_iteration": float(seen.given_up),
        "error_of_correct": error,
        "error": case.error,
        "hypothesis_of_answer": float(case.answer.arm),
        "iteration_of_answer": float(case.answer.iteration),
    }
    if case.lab.traits.has_tree:
        correct_px, answer_px = _unexplained_px(case, [T, case.answer.T_cam_obj])
        by = f"with it {correct_px} pixels of the scene are unexplained, with the answer {answer_px}"
        evidence |= {"unexplained_px_of_correct": float(correct_px), "unexplained_px": float(answer_px)}
    else:
        if case.lab.traits.takes_turns:
            correct, answer = (one.score for one in scored(case, np.array([T, case.answer.T_cam_obj])))
            which, of = "the scene scores", "scene_"
        else:
            correct, answer = seen.score.score, case.answer.score.score
            which, of = "it scores", ""
        texts = distinct_texts(correct, answer, 3)
        by = f"{which} {texts[0]}" + (" with it" if case.lab.traits.takes_turns else "") + f", the answer {texts[1]}"
        refined_on = max(one.score for one in scored(case, polished(case, T)))
        evidence |= {f"{of}score_of_correct": correct, f"{of}score_refined_on": refined_on, f"{of}score": answer}
        evidence[f"{of}margin"] = answer - correct
        if refined_on > answer:
            by += f"; refined on, it would score {distinct_texts(refined_on, answer, 3)[0]}"
    mm = 1e3 * case.target.model.diameter_m
    made = (
        f"made by iteration {seen.iteration} ({seen.stage.name}, hypothesis {seen.arm + 1})"
        if seen.iteration
        else f"the start of hypothesis {seen.arm + 1}"
    )
    at = case.answer
    of_answer = f"iteration {at.iteration}, {at.stage}, hypothesis {at.arm + 1}"
    if not at.iteration:
        of_answer = f"the start of hypothesis {at.arm + 1}"
    return Finding(
        Cause.DISCARDED,
        f"A correct pose of the {case.name}, {error * mm:.1f} mm off, {made}, was given up in iteration "
        f"{seen.given_up} for one that is {case.error * mm:.1f} mm off ({of_answer}): {by}.",
        evidence,
        True,
    )


def _cost(case: Case, T_wrong: Float) -> Finding | None:
    """Finds that the answer leaves no more pixels of the scene unexplained, the search's cost, than ground truth."""
    wrong_px, *at_gt_px = _unexplained_px(case, [T_wrong, *_poses_at_gt(case)])
    right_px = min(at_gt_px)
    if wrong_px > right_px:
        return None
    pose = f"a pose of the {case.name} that is wrong by {case.error:.0%} of the diameter"
    if wrong_px < right_px:
        text = (
            f"The search's cost prefers {pose}: it leaves {wrong_px} pixels unexplained, the ground truth {right_px}."
        )
    else:
        text = f"The search's cost is the same for {pose} and for the ground truth: {wrong_px} pixels unexplained."
    return Finding(
        Cause.SCORE,
        text,
        {"unexplained_px": float(wrong_px), "unexplained_px_of_ground_truth": float(right_px), "error": case.error},
        True,
    )


def _unexplained_px(case: Case, poses: Sequence[Float]) -> list[int]:
    """Pixels that the scene leaves unexplained with each of the object's poses, the others at their answers."""
    s = case.lab.toolbox.session
    pixels = ExplainedPixels(s.mcts.explained_m, s.score)
    problem, answers = case.trace.problem, case.trace.best_at(case.trace.length)
    others = [
        Placed(i, problem.target(i).model, answers[i].T_cam_obj)
        for i in case.group
        if i != case.instance_id and i in answers
    ]
    return [
        pixels.unexplained_px(problem.observation, [*others, Placed(case.instance_id, case.target.model, T)])
        for T in poses
    ]


def _poses_at_gt(case: Case) -> Float:
    """(n, 4, 4) ground truth, and what the refiner makes of it as long as that is right."""
    return polished(case, case.T_gt)


def polished(case: Case, T_cam_obj: Float) -> Float:
    """(n, 4, 4) a correct pose, and what the refiner makes of it as long as that is right."""
    poses = [T_cam_obj]
    for _ in range(POLISHING):
        T = case.lab.refiner.refine(case.target, poses[-1], case.placed)
        if case.error_of(T) >= case.threshold or np.abs(T - poses[-1]).max() < AT_REST:
            break
        poses.append(T)
    return np.array(poses)


def scored(case: Case, poses: Float) -> list[PoseScore]:
    """The score that decided: of the object, or of the whole scene with the others at their answers."""
    if not case.lab.traits.takes_turns:
        fixed = case.placed if case.lab.method(None).placed_may_hide else ()
        scores = case.lab.verifier.score(case.target, poses, fixed)
        return [scores[k] for k in range(len(poses))]
    problem, answers = case.trace.problem, case.trace.best_at(case.trace.length)
    cluster = next(c for c in problem.clusters if case.instance_id in c)
    targets = [t for t in problem.targets if t.instance.instance_id in cluster and t.instance.instance_id in answers]
    own = next(k for k, t in enumerate(targets) if t.instance.instance_id == case.instance_id)
    Ts = np.array([[answers[t.instance.instance_id].T_cam_obj for t in targets]] * len(poses))
    Ts[:, own] = poses
    scores = case.lab.verifier.score_scene(targets, Ts)
    return [scores[k] for k in range(len(poses))]


def _way(case: Case) -> str:
    """Which way the answer is turned; empty where it is turned little, or that is unknown."""
    assert case.answer is not None
    way = turning_on(case.target, case.answer.T_cam_obj)
    if way is None or max(way.tilt_deg, way.turn_deg) < WORTH_A_WAY_DEG:
        return ""
    return f" ({rotation_error_deg(case.target.model, case.answer.T_cam_obj, case.T_gt):.0f}°: {way.describe(0)})"


def ambiguous(case: Case) -> Finding | None:
    """The answer is next to a pose that the observation cannot tell from ground truth, by the object's own score.

    What ground truth leaves unexplained says how much a score may err: a wrong answer leaves more.
    """
    if case.answer is None or not case.lab.traits.verifies:
        return None
    allowed, model, T_answer = case.allowed, case.target.model, case.answer.T_cam_obj
    seen, apart_mm = nearest_allowed(allowed, model, T_answer)
    if apart_mm >= case.threshold * 1e3 * model.diameter_m:
        return None
    placed = case.placed if case.lab.method(None).placed_may_hide else ()
    of_answer = alike_pose(case.lab.verifier, case.target, allowed, seen, placed)
    if of_answer.is_better:
        return None  # The score prefers it.
    evidence = {
        "score": of_answer.score,
        "score_of_other": of_answer.score_of_answer,
        "score_noise": of_answer.noise,
        "apart_mm": of_answer.apart_mm,
        "undetermined_mm": allowed.undetermined_mm,
        "undetermined_deg": allowed.undetermined_deg,
        "error_seen": 1e-3 * apart_mm / model.diameter_m,
        "error": case.error,
    }
    return Finding(Cause.AMBIGUOUS, unseen_error(case.name, allowed, of_answer), evidence, True)
