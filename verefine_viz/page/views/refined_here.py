"""Where refining a pose from here ends, beside the score of the pose itself: answer to the want ``refined``."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from verefine_viz.core.arrays import Float
from verefine_viz.core.problem import Placed, Target
from verefine_viz.page import protocol as p
from verefine_viz.page.answers_to_wants import RefinedAnswer
from verefine_viz.page.blobs import Blobs
from verefine_viz.page.views.pixel_maps import score_numbers
from verefine_viz.page.wire import pose_numbers

if TYPE_CHECKING:
    from verefine_viz.page.workspace import Workspace
    from verefine_viz.run.refined_pose import RefinedPose

RefinedOf = Callable[[Any, Target, Float, Sequence[Placed]], "RefinedPose"]
"""Refines, settles and verifies a pose (4, 4) of an object among others, with the tools of a branch."""


def refined_here(space: Workspace, want: p.RefinedWanted, blobs: Blobs, refined_of: RefinedOf) -> RefinedAnswer:
    """Return what comes of a pose.

    Raises:
        InputError: there is no such branch or object.
    """
    branch = space.branch(want.branch)
    target = branch.run.problem.target(want.obj)
    placed = [
        Placed(one.obj, branch.run.problem.target(one.obj).model, p.pose_matrix(one.T))
        for one in want.stands
        if one.obj != want.obj and not one.waits
    ]
    T_cam_obj = p.pose_matrix(want.T)
    refined = refined_of(branch.final_tools, target, T_cam_obj, placed)
    errors = branch.final_evaluator.errors
    physics = refined.physics
    return RefinedAnswer(
        T=pose_numbers(refined.T_cam_obj),
        score=score_numbers(refined.score, errors(target, refined.T_cam_obj)),
        before=score_numbers(refined.score_before, errors(target, T_cam_obj)),
        tone="grey" if physics is None else physics.light,
        words="no support plane is known" if physics is None else physics.sentence,
    )
