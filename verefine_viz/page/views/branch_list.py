"""The branches of a frame, with what each did beside its method: message ``branches``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from verefine_viz.core.refiner_steps import LearnedRefiner
from verefine_viz.core.settings import Change, Edit
from verefine_viz.page.frame_messages import BranchesMessage, BranchListed, ComparedBranches, MovedPose, SettingsChange
from verefine_viz.page.saved_session import edits_made
from verefine_viz.run.iteration_words import moved_by_mm, turned_by
from verefine_viz.run.variants import settings_between, sorted_changes

if TYPE_CHECKING:
    from verefine_viz.page.branch import Branch
    from verefine_viz.page.workspace import Workspace


def branches_message(space: Workspace) -> BranchesMessage:
    """Return the branches, and which two are compared."""
    compared = space.work.compare
    return BranchesMessage(
        list=[_branch(space, branch) for branch in space.branches.values()],
        compare=compared and ComparedBranches(*compared),
    )


def _branch(space: Workspace, branch: Branch) -> BranchListed:
    run, first = branch.run, space.work.first.settings
    edits = edits_made(branch, is_only_frame=len(space.frames) == 1)
    return BranchListed(
        index=branch.index,
        name=branch.name,
        parent=branch.parent,
        from_=branch.forked_at,
        scored=[after for after, _ in branch.evaluators],
        recording=str(branch.recording) if branch.recording else None,
        missing=branch.missing,
        done=run.length,
        total=max(run.n_iterations, run.length),
        over=run.is_done,
        method=branch.settings.method.name,
        explains=run.method.refiner is None or isinstance(run.method.refiner, LearnedRefiner),
        settings={name: value for name, _, value in settings_between(first, branch.settings)},
        changes=[SettingsChange(change.after_iteration, _dotted(change)) for change in sorted_changes(branch.changes)],
        edits=[_edit(branch, edit) for edit in edits],
        elsewhere=_elsewhere(space, branch, edits),
    )


def _edit(branch: Branch, edit: Edit) -> MovedPose:
    """Return which hypothesis was moved, after which iteration, and how far from its initial pose."""
    mm = deg = None
    target = branch.run.problem.target(edit.instance)
    pool = target.instance.hypotheses
    if edit.hypothesis < len(pool):
        initial, moved = pool[edit.hypothesis].T_cam_obj, np.reshape(edit.T_cam_obj, (4, 4))
        mm, deg = moved_by_mm(initial, moved, target.model.points), turned_by(initial, moved)[0]
    return MovedPose(edit.after_iteration, edit.instance, edit.hypothesis, edit.T_cam_obj, mm, deg)


def _elsewhere(space: Workspace, branch: Branch, edits: tuple[Edit, ...]) -> list[str]:
    """Name the poses that the session edits but this frame lacks."""
    words = []
    for edit in branch.start.edits:
        if edit not in edits and edit.frame != space.frame:
            who = f"hypothesis {edit.hypothesis + 1} of instance {edit.instance}"
            words.append(f"{who} in frame {edit.frame}" if edit.frame else f"{who}, which this frame does not have")
    return words


def _dotted(change: Change) -> dict[str, Any]:
    return {f"{section}.{name}": value for section, values in change.settings.items() for name, value in values.items()}
