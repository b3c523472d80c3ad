"""What files hold of the open session."""

from __future__ import annotations

from dataclasses import dataclass

from verefine_viz.core.settings import Session
from verefine_viz.viewer.branch import Branch


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
