"""What a session file can say of what was done: poses moved in all frames, settings changed on the way."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from msgspec import structs

from verefine_viz.core.settings import Edit, Session
from verefine_viz.core.text_format import listed
from verefine_viz.run.edits import edits_of

if TYPE_CHECKING:
    from verefine_viz.page.branch import Branch

# What files hold of the open session.


@dataclass(frozen=True, eq=False)
class Saved:
    """The open session as a file has it."""

    session: Session
    branch: Branch | None = None
    """Which it was written of; None = the session was read from there."""

    @property
    def repeats(self) -> bool:
        """Whether a run of it moves poses or changes settings on the way."""
        return bool(self.session.edits or self.session.changes)


# What was done in all frames of a session, as one session file can say it.


def edits_of_all(shown: Branch, others: Sequence[Branch], is_only_frame: bool) -> tuple[Edit, ...]:
    """The poses moved in all frames: as the open runs of those that were opened have them, else as the session has.

    Those of the shown frame come first: a session opens at the first frame in which it moves a pose.

    Args:
        shown: the open branch.
        others: those of the other frames that were opened.
        is_only_frame: whether the session has no frame but the shown one.
    """
    made = [
        *_opening_edits(shown, is_only_frame),
        *(edit for other in others for edit in _opening_edits(other) if edit.frame),
    ]
    elsewhere = (edit for edit in shown.start.edits if edit not in made)
    there = (edit for other in others for edit in edits_made(other) if edit.frame)
    return (*edits_made(shown, is_only_frame), *elsewhere, *there)


def savable(session: Session, shown: Branch, others: Sequence[Branch], n_frames: int) -> tuple[Session, str]:
    """What is written to a file, and what it does not hold, in words; "" = it holds all.

    Settings changed on the way hold in every frame of a session, so those that were changed in one are saved with that
    frame alone.

    Args:
        session: what repeats the open branch, with the poses moved in all frames.
        shown: the open branch.
        others: those of the other frames that were opened.
        n_frames: how many the session has.
    """
    frame, apart = shown.run.problem.frame, [o.run.problem.frame for o in others if not _is_compatible(o, shown)]
    if n_frames > 1 and _is_compatible(shown, shown):
        first = tuple(edit for edit in shown.start.edits if edit.frame in apart)
        edits = (*(edit for edit in session.edits if edit.frame not in apart), *first)
        return structs.replace(session, edits=edits), _lacks(apart)
    here = edits_of(session.edits, shown.run.problem, is_only_frame=n_frames == 1)
    if n_frames == 1 and not here and not session.changes:
        return session, ""
    scene = structs.replace(session.scene, frames=(frame,))
    apart += [edit.frame for edit in session.edits if edit.frame not in ("", frame)]
    alone = structs.replace(session, scene=scene, edits=here)
    if n_frames == 1:
        return alone, ""
    belongs = _extra_work(alone) or "a pose that the session moves in every frame is not moved here, which"
    opens = f"it opens frame {frame} alone: {belongs} belong{'' if _extra_work(alone) else 's'} to it"
    return alone, "; ".join(filter(None, (opens, _lacks(apart))))


def _extra_work(session: Session) -> str:
    """What a run of a session does beside its method, in words."""
    moved, changed = bool(session.edits) * ["edited poses"], bool(session.changes) * ["settings changed later"]
    return " and ".join(moved + changed)


def _lacks(frames: Sequence[str]) -> str:
    names = sorted(set(frames))
    if not names:
        return ""
    return f"it does not hold what was done in frame{'s' if len(names) > 1 else ''} {listed(names)}: save that there"


def _is_compatible(branch: Branch, shown: Branch) -> bool:
    """Whether one session can say what was done in a branch and in the shown one: poses of named frames were moved."""
    start, other = (structs.replace(b.start, edits=(), tracked=()) for b in (branch, shown))
    dropped = any(not edit.frame and edit not in edits_made(branch) for edit in _opening_edits(branch))
    return start == other and branch.changes == branch.start.changes and not dropped


def edits_made(branch: Branch, is_only_frame: bool = False) -> tuple[Edit, ...]:
    """The poses that a branch moves; one that was read moves none again."""
    return _opening_edits(branch, is_only_frame) if branch.recording else branch.run.edits


def _opening_edits(branch: Branch, is_only_frame: bool = False) -> tuple[Edit, ...]:
    """Edits that the session moves in the branch's frame, as it was opened."""
    return edits_of(branch.start.edits, branch.run.problem, is_only_frame)
