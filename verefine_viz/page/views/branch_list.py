"""The branches of a frame, with what each did beside its method: message ``branches``."""

from __future__ import annotations

from typing import Any

import numpy as np

from verefine_viz.core.refiner_steps import LearnedRefiner
from verefine_viz.core.settings import Change, Edit
from verefine_viz.page.branch import Branch, sorted_changes
from verefine_viz.page.saved_session import edits_made
from verefine_viz.page.words import moved_by_mm, turned_by
from verefine_viz.page.workspace import Workspace
from verefine_viz.run.variants import settings_between

Json = dict[str, Any]


def branches_message(space: Workspace) -> Json:
    """Return which branches there are, and which two are compared."""
    compared = space.work.compare
    return {
        "t": "branches",
        "compare": compared and dict(zip("ab", compared, strict=True)),
        "list": [_branch(space, branch) for branch in space.branches.values()],
    }


def _branch(space: Workspace, branch: Branch) -> Json:
    run, first = branch.run, space.work.first.settings
    edits = edits_made(branch, is_only_frame=len(space.frames) == 1)
    return {
        "index": branch.index,
        "name": branch.name,
        "parent": branch.parent,
        "from": branch.forked_at,
        "scored": [after for after, _ in branch.evaluators],
        "recording": str(branch.recording) if branch.recording else None,
        "missing": branch.missing,
        "done": run.length,
        "total": max(run.n_iterations, run.length),
        "over": run.is_done,
        "method": branch.settings.method.name,
        "explains": run.method.refiner is None or isinstance(run.method.refiner, LearnedRefiner),
        "settings": {name: value for name, _, value in settings_between(first, branch.settings)},
        "changes": [
            {"k": change.after_iteration, "settings": _dotted(change)} for change in sorted_changes(branch.changes)
        ],
        "edits": [_edit(branch, edit) for edit in edits],
        "elsewhere": _elsewhere(space, branch, edits),
    }


def _edit(branch: Branch, edit: Edit) -> Json:
    """Return which hypothesis was moved, after which iteration, and how far from its initial pose."""
    out: Json = {
        "k": edit.after_iteration,
        "obj": edit.instance,
        "arm": edit.hypothesis,
        "T": edit.T_cam_obj,
        "mm": None,
        "deg": None,
    }
    target = branch.run.problem.target(edit.instance)
    pool = target.instance.hypotheses
    if edit.hypothesis < len(pool):
        initial, moved = pool[edit.hypothesis].T_cam_obj, np.reshape(edit.T_cam_obj, (4, 4))
        out["mm"] = moved_by_mm(initial, moved, target.model.points)
        out["deg"] = turned_by(initial, moved)[0]
    return out


def _elsewhere(space: Workspace, branch: Branch, edits: tuple[Edit, ...]) -> list[str]:
    """Say which poses the session moves that this frame does not have."""
    words = []
    for edit in branch.start.edits:
        if edit not in edits and edit.frame != space.frame:
            who = f"hypothesis {edit.hypothesis + 1} of instance {edit.instance}"
            words.append(f"{who} in frame {edit.frame}" if edit.frame else f"{who}, which this frame does not have")
    return words


def _dotted(change: Change) -> Json:
    return {f"{section}.{name}": value for section, values in change.settings.items() for name, value in values.items()}
