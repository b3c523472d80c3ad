"""What an object starts from, before the first iteration: which hypothesis scores best, and which is nearest."""

from __future__ import annotations

from verefine_viz.evaluation.errors import PoseErrors, pose_errors
from verefine_viz.methods.arms import Arm, Entry
from verefine_viz.viewer.pose_words import errors_in_words
from verefine_viz.viewer.scene_words import method_name
from verefine_viz.viewer.view import View


def starts(view: View) -> str:
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
        said += f"{'the first pose of ' * left}{who} scores best with {score}"
    if nearest is None:
        return f"{said}."
    if nearest == best.arm and not left:
        return f"{said} and is nearest, {off}."
    return f"{said}, hypothesis {nearest + 1} is nearest, {off}."


def start_errors(view: View) -> list[PoseErrors | None]:
    """Of each hypothesis of the object in focus where it started: its first pose, or where a person put it instead."""
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
