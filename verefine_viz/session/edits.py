"""Which of a session's poses moved by hand belong to a frame."""

from __future__ import annotations

from collections.abc import Sequence

from verefine_viz.core.problem import Problem
from verefine_viz.core.settings import Edit


def edits_of(edits: Sequence[Edit], problem: Problem, is_only_frame: bool = False) -> tuple[Edit, ...]:
    """Those that are made on ``problem``: of its frame, or of no frame by name where it has their hypothesis.

    Args:
        edits: of a session.
        problem: one of its frames.
        is_only_frame: whether the session has no other; then an edit of an object of it cannot be meant for another.
    """
    return tuple(edit for edit in edits if _is_of(edit, problem, is_only_frame))


def _is_of(edit: Edit, problem: Problem, is_only_frame: bool) -> bool:
    if edit.frame:
        return edit.frame == problem.frame
    n = next((len(i.hypotheses) for i in problem.instances if i.instance_id == edit.instance), None)
    return n is not None and (is_only_frame or edit.hypothesis < n)
