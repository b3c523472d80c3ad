"""Whether the score knows the true pose: where it prefers another one, more iterations need not help."""

from __future__ import annotations

from verefine_viz.core.scores import PoseScore
from verefine_viz.diagnosis.of_score import preferred
from verefine_viz.diagnosis.words import told_apart
from verefine_viz.viewer.correct import is_correct
from verefine_viz.viewer.view import Judged, View

LOOK_AT = "look at the depth there and at the score's settings"


def prefers(pose: Judged | None, truth: Judged | None) -> bool:
    """Whether a pose scores at least as much as the true one."""
    wrong, right = pose.score if pose else None, truth.score if truth else None
    return wrong is not None and right is not None and wrong.score >= right.score


def preferred_wrong(view: View, wrong: PoseScore, right: PoseScore) -> str:
    """That the answer, which is wrong, scores more than the truth, because of what, and what to do."""
    best = view.poses["best"]
    assert best.errors is not None
    how = f" ({best.errors.rotation_deg:.0f}° and {best.errors.translation_mm:.0f} mm off)"
    return preferred(view.name, best.errors.relative, wrong, right, how) + _what_to_do(best)


def truth_score(view: View) -> str:
    """How the best pose so far and the true pose score, for where errors are told; "" where that is not known.

    Of an answer that only a turn makes wrong, which the model should have declared, that is said instead.

    As in: The score prefers it to the true pose: 0.755 against 0.714. More iterations need not bring it nearer; if
    5.5 mm is too much, look at the depth there and at the score's settings.
    """
    best, truth = view.poses.get("best"), view.truth
    if best is None or truth is None or best.score is None or truth.score is None or best.errors is None:
        return ""
    if view.undeclared is not None:
        return view.undeclared.in_words(view.name)  # A score cannot tell such a pose from the true one.
    own, true = told_apart(best.score.score, truth.score.score, 3)
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


def truth_beside(a: Judged, b: Judged) -> str:
    """That the score prefers one of two compared poses to the true one, which is the other; else ""."""
    for pose, truth in ((a, b), (b, a)):
        if truth.name == "ground truth" and pose.name != truth.name and prefers(pose, truth):
            return f" The score prefers {pose.label} to the true pose."
    return ""


def _what_to_do(best: Judged) -> str:
    """Of a scene's best pose the score alone does not decide."""
    return "" if best.is_of_best_scene else f" More iterations need not help: {LOOK_AT}."
