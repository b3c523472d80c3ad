"""Where the score's settings changed on the way: scores before and after are not to be compared."""

from __future__ import annotations

from collections.abc import Sequence

from verefine_viz.viewer.markup import text
from verefine_viz.viewer.view import BranchSummary, View

NOT_COMPARABLE = "not comparable"


def last_of_old_scale(view: View) -> int | None:
    """The last iteration up to the cursor that was scored by other settings than those at the cursor."""
    return max((k for k in _ends(view) if k < view.cursor), default=None)


def other_scale_note(view: View) -> str:
    """A line above numbers of both scales; empty where there is one."""
    said = _said(view)
    return f'<p class="legend dim">{text(said)}</p>' if said else ""


def other_scale_sign(view: View) -> str:
    """The same where there is room for a sign only."""
    said = _said(view)
    return f'<span title="{text(said)}" style="cursor:help">⚠</span>' if said else ""


def one_scale_note(view: View) -> str:
    """A line above numbers that are all of one scale, where the iterations up to the cursor, or the next, have two."""
    k = max((k for k in _ends(view) if k <= view.cursor), default=None)
    if k is None:
        return ""
    # At the end of a finished run its answer is judged, by the last settings.
    is_later = view.cursor > k or view.at_end
    said = f"{_changed(k)} All here are by the {'later' if is_later else 'earlier'} settings."
    return f'<p class="legend dim">{text(said)}</p>'


def other_branch_sign(branch: BranchSummary) -> str:
    """A sign behind a branch's score; empty where it is by the settings of the shown branch."""
    said = f"by other score settings than the shown branch's: {NOT_COMPARABLE}"
    return f' <span title="{said}" style="cursor:help">⚠</span>' if branch.has_other_scale else ""


def other_branches_note(branches: Sequence[BranchSummary]) -> str:
    """What that sign says, as a line; empty where no branch has it."""
    said = f"⚠ scored by other settings than the shown branch: scores are {NOT_COMPARABLE}."
    return f'<p class="legend dim">{said}</p>' if any(b.has_other_scale for b in branches) else ""


def _ends(view: View) -> list[int]:
    """The iterations after which settings of the score changed."""
    ends = (c.after_iteration for c in view.session.changes if "score" in c.settings)
    return [k for k in ends if k > 0]


def _said(view: View) -> str:
    k = last_of_old_scale(view)
    return "" if k is None else _changed(k)


def _changed(k: int) -> str:
    return f"The score's settings changed after iteration {k}: scores up to there are {NOT_COMPARABLE} with later ones."
