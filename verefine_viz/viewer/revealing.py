"""Stage by stage: what the later stages of an iteration come to is not told before they are reached."""

from __future__ import annotations

from typing import TYPE_CHECKING

from verefine_viz.core.records import Iteration
from verefine_viz.session.engine import Run
from verefine_viz.viewer.look import Look

if TYPE_CHECKING:
    from verefine_viz.viewer.view import View


def is_partial(run: Run, look: Look) -> bool:
    """Whether the iteration at the cursor is shown up to a stage before its last one."""
    return run.iteration is not None and look.stage in [stage.name for stage in run.iteration.stages[:-1]]


def revealed(iteration: Iteration, stage: str | None) -> tuple[str, ...]:
    """The stages of an iteration up to ``stage``; all of them for None or where it has no such stage."""
    names = tuple(s.name for s in iteration.stages)
    return names[: names.index(stage) + 1] if stage in names else names


def is_revealed(view: View, stage: str) -> bool:
    """Whether the iteration that is shown is told up to this stage."""
    if view.shown is None:
        return False
    return stage in revealed(view.shown, view.look.stage if view.is_current else None)
