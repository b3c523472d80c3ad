"""Where the score's settings changed on the way: scores before and after are not to be compared."""

from __future__ import annotations

from verefine_viz.viewer.markup import text
from verefine_viz.viewer.view import View


def last_of_old_scale(view: View) -> int | None:
    """The last iteration up to the cursor that was scored by other settings than those at the cursor."""
    ends = [c.after_iteration for c in view.session.changes if "score" in c.settings]
    return max((k for k in ends if 0 < k < view.cursor), default=None)


def other_scale_note(view: View) -> str:
    """A line above numbers of both scales; empty where there is one."""
    said = _said(view)
    return f'<p class="legend dim">{text(said)}</p>' if said else ""


def other_scale_sign(view: View) -> str:
    """The same where there is room for a sign only."""
    said = _said(view)
    return f'<span title="{text(said)}" style="cursor:help">⚠</span>' if said else ""


def _said(view: View) -> str:
    k = last_of_old_scale(view)
    if k is None:
        return ""
    return f"The score's settings changed after iteration {k}: scores up to there are not comparable with later ones."
