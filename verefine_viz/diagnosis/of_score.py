"""Does the verification score prefer the wrong answer to the truth, and because of which pixels?"""

from __future__ import annotations

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.problem import Placed
from verefine_viz.core.scores import PIXEL_CLASSES, PoseScore
from verefine_viz.diagnosis.case import LAST_POSE, WHOLE_SCENE, Case
from verefine_viz.diagnosis.causes import Cause, Finding
from verefine_viz.methods.registry import SEARCH
from verefine_viz.rendering.explained import ExplainedPixels

POLISHING = 3
"""Refiner calls from ground truth: a true pose that is a millimetre off must not lose by that."""
BLAMED = ("missed", "protruding")
"""Classes that cost a pose its score."""


def score(case: Case) -> Finding | None:
    """The answer scores no lower than the truth (or than what the refiner makes of the truth)."""
    if case.answer is None or case.lab.name in LAST_POSE:
        return None
    if case.lab.name == SEARCH:
        return _cost(case, case.answer.T_cam_obj)
    true_poses = true_poses_of(case)
    wrong = _judged(case, case.answer.T_cam_obj[None])[0]
    scores = _judged(case, true_poses)
    right = max(scores, key=lambda s: s.score)
    if wrong.score < right.score:
        return None
    blame = {name: right.shares[name] - wrong.shares[name] for name in BLAMED}
    evidence = {
        "score": wrong.score,
        "score_of_truth": right.score,
        "error": case.error,
        **{f"{name}_share": wrong.shares[name] for name in PIXEL_CLASSES},
        **{f"{name}_share_of_truth": right.shares[name] for name in PIXEL_CLASSES},
        "depth_fit": wrong.depth_fit,
        "depth_fit_of_truth": right.depth_fit,
        "normal_fit": wrong.normal_fit,
        "normal_fit_of_truth": right.normal_fit,
    }
    text = (
        f"The score prefers a pose of the {case.name} that is wrong by {case.error:.0%} of the diameter: "
        f"{wrong.score:.3f} against {right.score:.3f} for the truth, {_why(blame, wrong, right)}."
    )
    return Finding(Cause.SCORE, text, evidence, True)


def _cost(case: Case, T_wrong: Float) -> Finding | None:
    """The search looks at how many pixels a scene leaves unexplained: no more with the answer than with the truth."""
    s = case.lab.toolbox.session
    pixels = ExplainedPixels(s.mcts.explained_m, s.score)
    problem, answers = case.trace.problem, case.trace.answers[-1]
    others = [
        Placed(i, problem.target(i).model, answers[i].T_cam_obj)
        for i in case.company
        if i != case.instance_id and i in answers
    ]

    def unexplained_px(T_cam_obj: Float) -> int:
        scene = [*others, Placed(case.instance_id, case.target.model, T_cam_obj)]
        return pixels.unexplained_px(problem.observation, scene)

    wrong_px = unexplained_px(T_wrong)
    right_px = min(unexplained_px(T) for T in true_poses_of(case))
    if wrong_px > right_px:
        return None
    return Finding(
        Cause.SCORE,
        f"The search's cost prefers a pose of the {case.name} that is wrong by {case.error:.0%} of the diameter: it "
        f"leaves {wrong_px} pixels unexplained, the truth {right_px}.",
        {"unexplained_px": float(wrong_px), "unexplained_px_of_truth": float(right_px), "error": case.error},
        True,
    )


def true_poses_of(case: Case) -> Float:
    """(n, 4, 4) ground truth, and what the refiner makes of it as long as that is right."""
    poses = [case.T_true]
    for _ in range(POLISHING):
        T = case.lab.refiner.refine(case.target, poses[-1], case.placed)
        if case.error_of(T) > case.threshold / 2:
            break
        poses.append(T)
    return np.array(poses)


def _judged(case: Case, poses: Float) -> list[PoseScore]:
    """The score that decided: of the object, or of the whole scene with the others at their answers."""
    if case.lab.name not in WHOLE_SCENE:
        fixed = case.placed if case.lab.method(None).placed_may_hide else ()
        found = case.lab.verifier.score(case.target, poses, fixed)
        return [found[k] for k in range(len(poses))]
    problem, answers = case.trace.problem, case.trace.answers[-1]
    cluster = next(c for c in problem.clusters if case.instance_id in c)
    targets = [t for t in problem.targets if t.instance.instance_id in cluster and t.instance.instance_id in answers]
    own = next(k for k, t in enumerate(targets) if t.instance.instance_id == case.instance_id)
    Ts = np.array([[answers[t.instance.instance_id].T_cam_obj for t in targets]] * len(poses))
    Ts[:, own] = poses
    found = case.lab.verifier.score_scene(targets, Ts)
    return [found[k] for k in range(len(poses))]


def _why(blame: dict[str, float], wrong: PoseScore, right: PoseScore) -> str:
    """The pixels that did it."""
    name = max(blame, key=lambda n: blame[n])
    if blame[name] > 0.01:
        what = {"missed": "missed (measured, and no model there)", "protruding": "protruding into free space"}[name]
        shares = f"{right.shares[name]:.0%} of the pixels count as {what}"
        return f"in which {shares}, against {wrong.shares[name]:.0%} in the answer"
    if wrong.depth_fit - right.depth_fit > wrong.normal_fit - right.normal_fit:
        return f"whose depth fits less well ({right.depth_fit:.2f} against {wrong.depth_fit:.2f})"
    return f"whose normals fit less well ({right.normal_fit:.2f} against {wrong.normal_fit:.2f})"
