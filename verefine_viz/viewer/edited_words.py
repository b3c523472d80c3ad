"""The pose that a person moves by hand, in words: each panel says of it what it judges."""

from __future__ import annotations

from verefine_viz.evaluation.turning import turning_on
from verefine_viz.viewer.correct import is_correct
from verefine_viz.viewer.pose_words import errors_in_words
from verefine_viz.viewer.view import View


def edited_score(view: View) -> str:
    """What the pose under the hand scores, and the pose that it is compared with; "" where none is edited.

    As in: Hypothesis 1 by hand scores 0.753 and is 2.2° and 4.1 mm from the truth; the accepted pose (of hypothesis 2)
    has 0.755.
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


def edited_error(view: View) -> str:
    """How far off the pose under the hand is; "" where none is edited, or nobody knows."""
    edited = view.poses.get("edited")
    if edited is None or edited.errors is None:
        return ""
    found, said = edited.errors, "correct" if is_correct(edited.errors) else "wrong"
    way = turning_on(view.target, edited.T_cam_obj)
    return (
        f"The edited pose (hypothesis {view.arm + 1}) is {errors_in_words(found, way)}; ADD(-S) "
        f"{found.add_s_mm:.1f} mm is {found.relative:.0%} of the diameter: {said} by the usual 10 %."
    )


def edited_beside(view: View) -> str:
    """That neither stage that is compared is the pose under the hand; "" where one of them is, or none is edited."""
    edited = view.poses.get("edited")
    if edited is None or edited.score is None or "edited" in (view.look.a, view.look.b):
        return ""
    return f" The pose that you edit scores {edited.score.score:.3f}; choose “edited” as A or B to compare it."
