"""Poses in numbers and plain words: between two poses, against ground truth, edited, compared, at the start."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import apply, rotation_vector
from verefine_viz.core.scores import PoseScore
from verefine_viz.core.text_format import telling_digits
from verefine_viz.diagnosis.causes import distinct_texts
from verefine_viz.diagnosis.score_causes import preferred
from verefine_viz.evaluation.pose_errors import PoseErrors, Turning, pose_errors, turning_on
from verefine_viz.methods.arms import Arm, Entry
from verefine_viz.viewer.snapshot.snapshot import EvaluatedPose, Snapshot
from verefine_viz.viewer.text.names import is_correct, method_name

_AXES = ("x", "y", "z")
_NO_TURN_DEG = 0.05
_NO_MOVE_MM = 0.05
_WORTH_A_WAY_DEG = 1.0
"""The direction of a smaller rotation is not said."""


def turn(T_from: Float, T_to: Float) -> tuple[float, str]:
    """The angle [deg] between two poses and the object axis it is about: "x", or "0.7, 0.0, −0.7"."""
    vector = rotation_vector(T_from[:3, :3].T @ T_to[:3, :3])
    angle = float(np.linalg.norm(vector))
    if angle < 1e-9:
        return 0.0, ""
    axis = vector / angle
    k = int(np.argmax(np.abs(axis)))
    components = (f"{x:.1f}".replace("-0.0", "0.0").replace("-", "−") for x in axis)
    name = _AXES[k] if abs(axis[k]) > 0.9 else ", ".join(components)
    return float(np.rad2deg(angle)), name


def shift_mm(T_from: Float, T_to: Float, points: Float) -> float:
    """How far the middle of the object's ``points`` (N, 3) moved between two poses [mm]."""
    centre = points.mean(axis=0)[None]
    return float(np.linalg.norm(apply(T_to, centre) - apply(T_from, centre))) * 1e3


def movement(T_from: Float, T_to: Float, points: Float) -> str:
    """What happened between two poses: "turned it 6.8° about x and moved it 4.1 mm"."""
    angle, axis = turn(T_from, T_to)
    distance = shift_mm(T_from, T_to, points)
    parts = []
    if angle >= _NO_TURN_DEG:
        parts.append(f"turned it {angle:.1f}° about {axis}" if axis in _AXES else f"turned it {angle:.1f}°")
    if distance >= _NO_MOVE_MM:
        parts.append(f"moved it {distance:.1f} mm")
    return " and ".join(parts) or "left it where it was"


def errors_in_words(errors: PoseErrors | None, way: Turning | None = None) -> str:
    """As in: 12.3° and 4.5 mm from ground truth; nothing without ground truth.

    With ``way``, also as in: 9.5° (3.6° of tilt against the table, 8.8° of turn on it) and 4.5 mm from ground truth.
    """
    if errors is None:
        return ""
    direction = f" ({way.in_words()})" if way is not None and errors.rotation_deg >= _WORTH_A_WAY_DEG else ""
    return f"{errors.rotation_deg:.1f}°{direction} and {errors.translation_mm:.1f} mm from ground truth"


# The pose that a person moves by hand, in words: each panel says of it what it judges.


def edited_score(view: Snapshot) -> str:
    """What the edited pose scores, and the pose that it is compared with; "" where none is edited.

    As in: Hypothesis 1 by hand scores 0.753 and is 2.2° and 4.1 mm from ground truth; the accepted pose (of
    hypothesis 2) has 0.755.
    """
    edited, kept = view.poses.get("edited"), view.poses.get("accepted") or view.poses.get("current")
    if edited is None or edited.score is None:
        return ""
    said = f"Hypothesis {view.arm + 1} by hand scores {edited.score.score:.3f}"
    if edited.errors is not None:
        said += f" and is {errors_in_words(edited.errors, turning_on(view.target, edited.T_cam_obj))}"
    if kept is None or kept.score is None:
        return f"{said}."
    of = f" (of hypothesis {view.shown.arm + 1})" if view.shown is not None and view.shown.arm != view.arm else ""
    return f"{said}; the {kept.name} pose{of} has {kept.score.score:.3f}."


def edited_error(view: Snapshot) -> str:
    """How far off the edited pose is; "" where none is edited, or that is unknown."""
    edited = view.poses.get("edited")
    if edited is None or edited.errors is None:
        return ""
    found, said = edited.errors, "correct" if is_correct(edited.errors) else "wrong"
    way = turning_on(view.target, edited.T_cam_obj)
    return (
        f"The edited pose (hypothesis {view.arm + 1}) is {errors_in_words(found, way)}; ADD(-S) "
        f"{found.add_s_mm:.1f} mm is {found.relative:.0%} of the diameter: {said} by the usual 10 %."
    )


def edited_beside(view: Snapshot) -> str:
    """That neither stage that is compared is the edited pose; "" where one of them is, or none is edited."""
    edited = view.poses.get("edited")
    if edited is None or edited.score is None or "edited" in (view.options.a, view.options.b):
        return ""
    return f" The pose that you edit scores {edited.score.score:.3f}; choose “edited” as A or B to compare it."


# Whether the score knows the true pose: where it prefers another one, more iterations need not help.

LOOK_AT = "look at the depth there and at the score's settings"


def prefers(pose: EvaluatedPose | None, truth: EvaluatedPose | None) -> bool:
    """Whether a pose scores at least as much as the true one."""
    wrong, right = pose.score if pose else None, truth.score if truth else None
    return wrong is not None and right is not None and wrong.score >= right.score


def preferred_wrong(view: Snapshot, wrong: PoseScore, right: PoseScore) -> str:
    """That the answer, which is wrong, scores more than the truth, because of what, and what to do."""
    best = view.poses["best"]
    assert best.errors is not None
    how = f" ({best.errors.rotation_deg:.0f}° and {best.errors.translation_mm:.0f} mm off)"
    return preferred(view.name, best.errors.relative, wrong, right, how) + _what_to_do(best)


def truth_score(view: Snapshot) -> str:
    """How the best pose so far and the true pose score, for where errors are shown; "" where that is not known.

    Of an answer that only a turn makes wrong, which the model should have declared, that is said instead.

    As in: The score prefers it to the true pose: 0.755 against 0.714. More iterations need not bring it nearer; if
    5.5 mm is too much, look at the depth there and at the score's settings.
    """
    best, truth = view.poses.get("best"), view.truth
    if best is None or truth is None or best.score is None or truth.score is None or best.errors is None:
        return ""
    if view.undeclared is not None:
        return view.undeclared.in_words(view.name)  # A score cannot tell such a pose from the true one.
    own, true = distinct_texts(best.score.score, truth.score.score, 3)
    if not prefers(best, truth):
        return f"The true pose scores more: {true} against {own}."
    if own == true:
        return f"The true pose scores as much: {true}."
    if not is_correct(best.errors):
        return f"The score prefers this wrong pose to the true pose: {own} against {true}.{_what_to_do(best)}"
    said = f"The score prefers it to the true pose: {own} against {true}."
    if best.is_of_best_scene:
        return said
    return f"{said} More iterations need not bring it nearer; if {best.errors.add_s_mm:.1f} mm is too much, {LOOK_AT}."


def truth_beside(a: EvaluatedPose, b: EvaluatedPose) -> str:
    """That the score prefers one of two compared poses to the true one, which is the other; else ""."""
    for pose, truth in ((a, b), (b, a)):
        if truth.name == "ground truth" and pose.name != truth.name and prefers(pose, truth):
            return f" The score prefers {pose.label} to the true pose."
    return ""


def _what_to_do(best: EvaluatedPose) -> str:
    """Of a scene's best pose the score alone does not decide."""
    return "" if best.is_of_best_scene else f" More iterations need not help: {LOOK_AT}."


# Why the two stages that are compared differ in score, in plain words. Pure text: who shows it escapes it.

_SAME = 1e-6


def compared(view: Snapshot) -> str:
    """Why the two stages that are compared differ in score; of which object, where there are several."""
    a, b = view.a, view.b
    label = view.scene.object(view.target.instance.instance_id).label
    if a is None or b is None:
        return f"{label} has no pose to judge; give it a hypothesis."
    pairs = [
        (wanted, side.pose) for wanted, side in ((view.options.a, a), (view.options.b, b)) if side.pose.name != wanted
    ]
    missing = [name for name, _ in pairs]
    instead = " and ".join(dict.fromkeys(pose.label for _, pose in pairs))
    lead = f"{label}: " if len(view.scene.objects) > 1 else ""
    # An iteration that is shown to its end will not make it any more.
    yet = "" if view.shown is not None and not view.is_partial else " yet"
    lead += f"No {' and no '.join(missing)} pose here{yet}; shown instead: {instead}. " if missing else ""
    return lead + _difference(a.pose, b.pose) + truth_beside(a.pose, b.pose) + edited_beside(view)


def score_digits(scores: Sequence[PoseScore | None]) -> int:
    """Decimals that tell some scores apart; three at least."""
    known = [s.score for s in scores if s is not None]
    return max(3, telling_digits(max(known) - min(known))) if known else 3


def _difference(a: EvaluatedPose, b: EvaluatedPose) -> str:
    """How much more the second one scores, and from what."""
    one, other = a.score, b.score
    if one is None or other is None:
        return f"{a.label} or {b.label} was not scored."
    digits = score_digits([one, other])
    if a.name != b.name and one == other:
        return f"{a.label.capitalize()} and {b.label} score the same: {other.score:.{digits}f}."
    if a.name == b.name:
        return f"{b.label.capitalize()} scores {other.score:.{digits}f}."
    said = f"{b.label.capitalize()} {other.score:.{digits}f} against {a.label} {one.score:.{digits}f}"
    lead = other.score - one.score
    depth, normal = (other.depth_fit - one.depth_fit) / 2, (other.normal_fit - one.normal_fit) / 2
    larger = max(abs(depth), abs(normal))
    if abs(lead) < _SAME and larger < _SAME:
        return f"{said}: the same."
    parts = f"(depth {depth:+.{digits}f}, normals {normal:+.{digits}f})".replace("-", "−")
    more = "the same" if abs(lead) < _SAME else f"{abs(lead):.{digits}f} {'more' if lead > 0 else 'less'}"
    if abs(lead) < larger / 2:
        said += f": {more}, since what depth and normals change nearly cancels out {parts}."
    else:
        said += f": {more}, mostly from {'depth' if abs(depth) >= abs(normal) else 'normals'} {parts}."
    return said + _pixels(one, other)


def _pixels(one: PoseScore, other: PoseScore) -> str:
    """The class of pixels that changed most; empty where none did by 1 %."""
    name = max(one.shares, key=lambda k: abs(other.shares[k] - one.shares[k]))
    change = other.shares[name] - one.shares[name]
    if abs(change) < 0.01:
        return ""
    points = f"{100 * abs(change):.0f} percentage points"
    return f" The share of {name} pixels went {'up' if change > 0 else 'down'} by {points}."


# What an object starts from, before the first iteration: which hypothesis scores best, and which is nearest.


def starts(view: Snapshot) -> str:
    """The hypotheses of the object in focus, which has some, at the cursor before iteration 1.

    As in: mug has 5 hypotheses; hypothesis 3 scores best with 0.15, hypothesis 4 is nearest, 12.0° and 3.1 mm from the
    truth.
    """
    best, arms, n = view.state.best, view.state.arms, view.n_arms
    errors = start_errors(view)
    known = [(e.add_s_mm, j) for j, e in enumerate(errors) if e is not None]
    nearest = min(known)[1] if known else None
    off = errors_in_words(errors[nearest]) if nearest is not None else ""
    who, score = f"hypothesis {best.arm + 1}", f"{best.score.score:.2f}"
    if n == 1:
        return f"{view.name} has 1 hypothesis, which scores {score}{f'; it is {off}' if off else ''}."
    said = f"{view.name} has {n} hypotheses; "
    # The pose that a hypothesis was moved away from may still be the best one.
    left = _moved_first(arms[best.arm]) is not None and best.stage != "edited"
    if len(arms) < n:
        said += f"{method_name(view.session.method.name)} works on {who} alone, which scores {score}"
    else:
        said += f"{'the initial pose of ' * left}{who} scores best with {score}"
    if nearest is None:
        return f"{said}."
    if nearest == best.arm and not left:
        return f"{said} and is nearest, {off}."
    return f"{said}, hypothesis {nearest + 1} is nearest, {off}."


def start_errors(view: Snapshot) -> list[PoseErrors | None]:
    """Of each hypothesis of the object in focus where it started: its initial pose, or where it was edited to."""
    T_gt, errors = view.target.instance.T_cam_obj_gt, list(view.initial_errors)
    if T_gt is not None and view.state is not None:
        for j, arm in enumerate(view.state.arms):
            moved = _moved_first(arm)
            if moved is not None:
                errors[j] = pose_errors(view.target.model, moved.T_cam_obj, T_gt)
    return errors


def _moved_first(arm: Arm) -> Entry | None:
    """The pose that a hypothesis was moved to by hand before iteration 1; None where it was not."""
    return next((e for e in reversed(arm.entries) if e.stage == "edited" and e.iteration == 0), None)
