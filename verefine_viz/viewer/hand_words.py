"""What a session moves by hand, in words."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from verefine_viz.core.settings import Edit
from verefine_viz.viewer.pose_words import shift_mm, turn
from verefine_viz.viewer.view import View

MOST = 3
"""Moved poses that are named."""


def moved_by_hand(view: View) -> str:
    """Which hypotheses the open run moves, when and how far, and which poses the session moves in other frames.

    As in: Hypothesis 4 was moved by hand before iteration 1, 12.0 mm and 20.0° from its first pose. "" where none is.
    """
    edits = view.edits
    said = [_one(view, edit) for edit in edits[:MOST]]
    if len(edits) > MOST:
        said.append(f"{len(edits) - MOST} more are moved by hand.")
    elsewhere = [edit for edit in view.session.edits if edit not in edits and edit.frame != view.frame]
    return " ".join((*said, *([_elsewhere(elsewhere)] if elsewhere else [])))


def _elsewhere(edits: Sequence[Edit]) -> str:
    """That this frame lacks what some edits move."""
    frames = sorted({edit.frame for edit in edits if edit.frame})
    if frames:
        where = f"frame{'s' if len(frames) > 1 else ''} {', '.join(frames)}"
        n = len(edits)
        return f"{n} pose{'s' * (n > 1)} moved by hand belong{'s' * (n == 1)} to {where}."
    what = f"hypothesis {edits[0].hypothesis + 1} of instance {edits[0].instance}"
    more = f" and {len(edits) - 1} more" if len(edits) > 1 else ""
    return f"The session moves {what}{more} by hand, which this frame does not have; the frame that has it does so."


def _one(view: View, edit: Edit) -> str:
    o = view.scene.object(edit.instance)
    who = f"Hypothesis {edit.hypothesis + 1}" + (f" of {o.label}" if len(view.scene.objects) > 1 else "")
    when = "was moved by hand before iteration 1"
    if edit.after_iteration:
        when = f"will be moved by hand after iteration {edit.after_iteration}"
    pool = o.target.instance.hypotheses
    if edit.hypothesis >= len(pool):
        return f"{who} {when}."
    first, put = pool[edit.hypothesis].T_cam_obj, np.reshape(edit.T_cam_obj, (4, 4))
    way_mm, angle_deg = shift_mm(first, put, o.target.model.points), turn(first, put)[0]
    return f"{who} {when}, {way_mm:.1f} mm and {angle_deg:.1f}° from its first pose."
