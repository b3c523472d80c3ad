"""Poses in numbers and plain words: between two poses, against ground truth, edited, compared, at the start."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import apply, rotation_vector
from verefine_viz.core.scores import PoseScore
from verefine_viz.core.text_format import distinguishing_digits
from verefine_viz.diagnosis.signs import ground_truth_is_unfit
from verefine_viz.evaluation.pose_errors import PoseErrors, Turning, pose_errors, turning_on
from verefine_viz.methods.arms import Arm, Entry
from verefine_viz.viewer.snapshot.snapshot import EvaluatedPose, Snapshot
from verefine_viz.viewer.state.view_options import stage_label
from verefine_viz.viewer.text.display_names import in_focus, is_correct, method_name

_AXES = ("x", "y", "z")
_NO_TURN_DEG = 0.05
_NO_MOVE_MM = 0.05
_WORTH_A_WAY_DEG = 1.0
"""The direction of a smaller rotation is not named."""


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


# The answer, and the edited pose.


def beside_answer(snapshot: Snapshot) -> str:
    """Where the answer is shown: of which iteration the numbers are that belong to one; empty elsewhere."""
    answer, shown = in_focus(snapshot).answer, snapshot.shown
    if not snapshot.is_answer or shown is None or answer is None:
        return ""
    if answer.iteration == shown.index:
        return f"Answer: iteration {shown.index}, the last on this object. "
    own = f"iteration {answer.iteration}" if answer.iteration else "an initial pose"
    return f"Answer: {own}. Below: iteration {shown.index}, the last on this object. "


def edited_score(snapshot: Snapshot) -> str:
    """What the edited pose scores, and the pose that it is compared with; "" where none is edited.

    As in: The edited pose (hypothesis 1) scores 0.753 and is 2.2° and 4.1 mm from ground truth; the accepted pose (of
    hypothesis 2) has 0.755.
    """
    edited, other = snapshot.poses.get("edited"), snapshot.poses.get("accepted") or snapshot.poses.get("current")
    if edited is None or edited.score is None:
        return ""
    words = f"The edited pose (hypothesis {snapshot.arm + 1}) scores {edited.score.score:.3f}"
    if edited.errors is not None:
        words += f" and is {errors_in_words(edited.errors, turning_on(snapshot.target, edited.T_cam_obj))}"
    if other is None or other.score is None:
        return f"{words}."
    shown = snapshot.shown
    of = f" (of hypothesis {shown.arm + 1})" if shown is not None and shown.arm != snapshot.arm else ""
    return f"{words}; the {other.name} pose{of} has {other.score.score:.3f}."


# Whether the score prefers another pose to ground truth: then more iterations need not help.


def preference(pose: EvaluatedPose | None, truth: EvaluatedPose | None) -> str:
    """That the score prefers a pose to ground truth, which matters where that pose is wrong; "" where it does not.

    Ground truth that does not fit its image says nothing about the score.
    """
    if pose is None or truth is None or pose.score is None or truth.score is None:
        return ""
    if pose.score.score < truth.score.score:
        return ""
    who = "the answer" if pose.name == "best" else f"the {pose.label} pose"
    if is_correct(pose.errors):
        return f"{who.capitalize()} is correct, and scores as much as ground truth or more."
    if ground_truth_is_unfit(pose.score, truth.score):
        return f"Ground truth does not fit this image: {who} explains most of it, ground truth next to nothing."
    return f"The score prefers {who} to ground truth."


# The two stages that are compared; how much they differ, and in what, the table beside it shows.


def compared(snapshot: Snapshot) -> str:
    """Which of the two stages do not exist here, and whether the score prefers one to ground truth, the other."""
    a, b = snapshot.a, snapshot.b
    if a is None or b is None:
        return f"{in_focus(snapshot).label} has no pose to score; give it a hypothesis."
    if a.pose.side is not None:
        return ""
    pairs = [
        (wanted, side.pose)
        for wanted, side in ((snapshot.options.a, a), (snapshot.options.b, b))
        if side.pose.name != wanted
    ]
    missing = [stage_label(name) for name, _ in pairs]
    instead = " and ".join(dict.fromkeys(pose.label for _, pose in pairs))
    # An iteration that is shown to its end will not make it any more.
    yet = "" if snapshot.shown is not None and not snapshot.is_partial else " yet"
    words = f"No {' and no '.join(missing)} pose{yet}: {instead} instead." if missing else ""
    for pose, truth in ((a.pose, b.pose), (b.pose, a.pose)):
        if truth.name == "ground truth" != pose.name:
            words = f"{words} {preference(pose, truth)}".strip()
    return words


def score_digits(scores: Sequence[PoseScore | None]) -> int:
    """Decimals that tell some scores apart; three at least."""
    known = [s.score for s in scores if s is not None]
    return max(3, distinguishing_digits(max(known) - min(known))) if known else 3


# What an object starts from, before the first iteration: which hypothesis scores best, and which is nearest.


def starts(snapshot: Snapshot) -> str:
    """The hypotheses of the object in focus, which has some, at the cursor before iteration 1.

    As in: mug has 5 hypotheses; hypothesis 3 scores best with 0.15, hypothesis 4 is nearest, 12.0° and 3.1 mm from
    ground truth.
    """
    best, arms, n = snapshot.state.best, snapshot.state.arms, snapshot.n_arms
    errors = start_errors(snapshot)
    known = [(e.add_s_mm, j) for j, e in enumerate(errors) if e is not None]
    nearest = min(known)[1] if known else None
    off = errors_in_words(errors[nearest]) if nearest is not None else ""
    who, score = f"hypothesis {best.arm + 1}", f"{best.score.score:.2f}"
    if n == 1:
        return f"{snapshot.name} has 1 hypothesis, which scores {score}{f'; it is {off}' if off else ''}."
    words = f"{snapshot.name} has {n} hypotheses; "
    # The pose that a hypothesis was edited away from may still be the best one.
    left = _edited_at_start(arms[best.arm]) is not None and best.stage != "edited"
    if len(arms) < n:
        words += f"{method_name(snapshot.session.method.name)} works on {who} alone, which scores {score}"
    else:
        words += f"{'the initial pose of ' * left}{who} scores best with {score}"
    if nearest is None:
        return f"{words}."
    if nearest == best.arm and not left:
        return f"{words} and is nearest, {off}."
    return f"{words}, hypothesis {nearest + 1} is nearest, {off}."


def start_errors(snapshot: Snapshot) -> list[PoseErrors | None]:
    """Of each hypothesis of the object in focus where it started: its initial pose, or where it was edited to."""
    T_gt, errors = snapshot.target.instance.T_cam_obj_gt, list(snapshot.initial_errors)
    if T_gt is not None and snapshot.state is not None:
        for j, arm in enumerate(snapshot.state.arms):
            edited = _edited_at_start(arm)
            if edited is not None:
                errors[j] = pose_errors(snapshot.target.model, edited.T_cam_obj, T_gt)
    return errors


def _edited_at_start(arm: Arm) -> Entry | None:
    """The pose that a hypothesis was edited to before iteration 1; None where it was not."""
    return next((e for e in reversed(arm.entries) if e.stage == "edited" and e.iteration == 0), None)
