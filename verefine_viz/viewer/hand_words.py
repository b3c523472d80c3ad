"""What a session moves by hand, in words."""

from __future__ import annotations

import numpy as np

from verefine_viz.core.settings import Edit
from verefine_viz.viewer.pose_words import shift_mm, turn
from verefine_viz.viewer.view import View

MOST = 3
"""Moved poses that are named."""


def moved_by_hand(view: View) -> str:
    """Which hypotheses the open run moves, when and how far; "" where it moves none of this frame.

    As in: Hypothesis 4 was moved by hand before iteration 1, 12.0 mm and 20.0° from its first pose.
    """
    ids = [o.instance_id for o in view.scene.objects]
    edits = [edit for edit in view.session.edits if edit.instance in ids]
    said = " ".join(_one(view, edit) for edit in edits[:MOST])
    return f"{said} {len(edits) - MOST} more are moved by hand." if len(edits) > MOST else said


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
