"""Which of a session's edited poses belong to a frame, and notes on those that cannot be applied there."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence

import numpy as np

from verefine_viz.core.errors import InputError, ShapeError, unknown
from verefine_viz.core.geometry import FARTHEST_M, as_rigid
from verefine_viz.core.problem import Instance, Problem
from verefine_viz.core.settings import Change, Edit
from verefine_viz.core.text_format import listed


def edits_of(edits: Sequence[Edit], problem: Problem, is_only_frame: bool = False) -> tuple[Edit, ...]:
    """Edits that are applied to ``problem``: of its frame, or of no frame by name where it has their hypothesis.

    Args:
        edits: of a session.
        problem: one of its frames.
        is_only_frame: whether the session has no other; then an edit of an object of it cannot be meant for another.
    """
    return tuple(edit for edit in edits if _is_of(edit, problem, is_only_frame))


def _is_of(edit: Edit, problem: Problem, is_only_frame: bool) -> bool:
    instance = _instance(edit, problem)
    if instance is None:
        return False
    if edit.frame:
        return edit.frame == problem.frame
    return is_only_frame or edit.hypothesis < len(instance.hypotheses)


def _instance(edit: Edit, problem: Problem) -> Instance | None:
    return next((i for i in problem.instances if i.instance_id == edit.instance), None)


def check_edits(
    edits: Sequence[Edit], problem: Problem, is_only_frame: bool, has_all_objects: bool = True
) -> tuple[str, ...]:
    """Notes on the edits that are not applied to ``problem`` although they may be meant for it.

    Args:
        edits: of a session.
        problem: one of its frames.
        is_only_frame: whether the session has no other.
        has_all_objects: whether every object of the frame is to be solved.

    Raises:
        InputError: an edit that is meant for this frame names an instance or a hypothesis that it does not have, or
            its pose is not rigid.
    """
    notes: dict[str, None] = {}  # Each once, in order.
    for edit in edits:
        if edit.frame not in ("", problem.frame):
            continue
        is_meant = bool(edit.frame) or is_only_frame
        if is_meant and _instance(edit, problem) is not None:
            _check_possible(edit, problem)
        elif is_meant:
            notes[_skip_reason(edit, problem, has_all_objects)] = None
        elif not _is_of(edit, problem, is_only_frame):
            who = f"hypothesis {edit.hypothesis + 1} of instance {edit.instance}"
            notes[f"the session edits the pose of {who}, which this frame does not have"] = None
    return tuple(notes)


def _check_possible(edit: Edit, problem: Problem) -> None:
    instance = _instance(edit, problem)
    n = len(instance.hypotheses) if instance else 0
    if edit.hypothesis >= n:
        raise InputError(
            f"edits: there is no hypothesis {edit.hypothesis} of instance {edit.instance}; it has {n}, counted from 0 "
            f"(frame {problem.frame})"
        )
    who = f"edits: the pose of instance {edit.instance}"
    try:
        T_cam_obj = as_rigid(np.reshape(edit.T_cam_obj, (4, 4)), who)
    except ShapeError as error:
        raise InputError(f"{error} (frame {problem.frame})") from None
    if np.abs(T_cam_obj[:3, 3]).max() > FARTHEST_M:
        raise InputError(f"{who} is farther away than {FARTHEST_M:g} m, expected metres (frame {problem.frame})")


def _skip_reason(edit: Edit, problem: Problem, has_all_objects: bool) -> str:
    """Why the edit is not applied though it is meant for this frame.

    Raises:
        InputError: the frame has no such instance.
    """
    if edit.instance in (one.instance_id for one in problem.left_out):
        return f"the edited pose of instance {edit.instance} is not used: it is left out"
    if not has_all_objects:
        return f"the edited pose of instance {edit.instance} is not used: it is none of the objects to solve"
    there = [i.instance_id for i in problem.instances]
    raise InputError(f"edits: {unknown('instance', edit.instance, there)} (frame {problem.frame})")


def edits_elsewhere(edits: Sequence[Edit], frames: Collection[str]) -> tuple[str, ...]:
    """A note where a session edits poses in frames that it does not have."""
    absent = sorted({edit.frame for edit in edits if edit.frame and edit.frame not in frames})
    if not absent:
        return ()
    which = f"frame{'s' if len(absent) > 1 else ''} {listed(absent)}"
    return (f"poses are edited in {which}, which {'are' if len(absent) > 1 else 'is'} not among those to solve",)


def never_reached(edits: Sequence[Edit], changes: Sequence[Change], n_iterations: int) -> tuple[str, ...]:
    """Notes on edits and changes that lie behind the end of a run of ``n_iterations``."""

    def late(what: Sequence[Edit] | Sequence[Change], is_not: str) -> Iterator[str]:
        for k in sorted({one.after_iteration for one in what if one.after_iteration > n_iterations}):
            yield f"the run has {n_iterations} iterations: {is_not.format(k)}"

    return (
        *late(edits, "no pose is edited after iteration {}"),
        *late(changes, "no setting changes after iteration {}"),
    )
