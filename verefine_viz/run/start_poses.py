"""Poses that are the only hypothesis of an object: where "Refine this pose" of the page begins."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import InputError, unknown
from verefine_viz.core.problem import Hypothesis, Instance, Problem
from verefine_viz.core.settings import StartPose
from verefine_viz.run.engine import Run

SOURCE = "edited"
"""Where such a pose comes from, as shown to the user."""


def starts_after(run: Run, k: int, instance_id: int, T_cam_obj: Float) -> tuple[StartPose, ...]:
    """A pose (4, 4) of one object, and the answers of the others that were worked on up to iteration ``k``."""
    worked_on = {iteration.instance_id for iteration in run.iterations[:k]}
    poses = {own: best.T_cam_obj for own, best in run.best_at(k).items() if own in worked_on}
    poses[instance_id] = T_cam_obj
    return tuple(
        StartPose(frame=run.problem.frame, instance=own, T_cam_obj=tuple(T.ravel().tolist()))
        for own, T in sorted(poses.items())
    )


def with_starts(problem: Problem, starts: Sequence[StartPose], has_all_objects: bool = True) -> Problem:
    """The problem in which the poses of its frame are the only hypotheses of their objects.

    Args:
        problem: a frame.
        starts: of a session.
        has_all_objects: whether every object of the frame is to be solved.

    Raises:
        InputError: a pose is not rigid, or is of an instance that the frame does not have.
    """
    poses = {one.instance: np.reshape(one.T_cam_obj, (4, 4)) for one in starts if one.frame == problem.frame}
    if not poses:
        return problem
    there = {i.instance_id for i in problem.instances}
    absent = poses.keys() - there - {one.instance_id for one in problem.left_out}
    if absent and has_all_objects:
        raise InputError(f"starts: {unknown('instance', min(absent), sorted(there))} (frame {problem.frame})")
    instances = tuple(_begun_at(i, poses[i.instance_id]) if i.instance_id in poses else i for i in problem.instances)
    return replace(problem, instances=instances)


def _begun_at(instance: Instance, T_cam_obj: Float) -> Instance:
    """The instance with one hypothesis; steps that another program recorded belong to those it had."""
    return replace(instance, hypotheses=(Hypothesis(T_cam_obj, 1.0, SOURCE),), recorded=(), recorded_scores=())
