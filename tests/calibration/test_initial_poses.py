"""Without ground truth, initial poses show that depth is not in the unit they were estimated for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tests.calibration.sizes import scene
from verefine_viz.calibration.camera_check import estimate_doubts
from verefine_viz.core.arrays import Float
from verefine_viz.core.problem import Hypothesis, Instance, Problem

CLUTTER = scene()


def moved(instance: Instance, by_mm: Float) -> Float:
    """The ground-truth pose, somewhere else."""
    T = np.array(instance.T_cam_obj_gt)
    T[:3, 3] += 1e-3 * by_mm
    return T


def estimated(off_mm: float, depth: float = 1.0) -> Problem:
    """Without ground truth, with initial poses as an estimator might give them, and depth multiplied."""
    rng = np.random.default_rng(0)
    instances = tuple(
        replace(i, T_cam_obj_gt=None, hypotheses=(Hypothesis(moved(i, rng.normal(0, off_mm, 3)), 1.0, "cosypose"),))
        for i in CLUTTER.instances
    )
    seen = replace(CLUTTER.observation, depth_m=CLUTTER.observation.depth_m * np.float32(depth))
    return replace(CLUTTER, instances=instances, observation=seen)


def test_depth_that_is_off_by_a_factor_is_reported_before_the_run() -> None:
    for depth, said in (
        (0.5, "50% smaller than the initial poses say: check depth_scale in scene_camera.json (about 2.0"),
        (0.9, "(about 1.1"),
        (1.1, "larger"),
        (2.0, "(about 0.50 times as much would fit)"),
    ):
        (note,) = estimate_doubts(estimated(5.0, depth))
        assert said in note.text, depth


def test_right_depth_poor_poses_and_known_ground_truth_leave_no_doubt() -> None:
    for off_mm in (0.0, 5.0, 30.0):
        assert not estimate_doubts(estimated(off_mm)), off_mm
    ids = [i.instance_id for i in CLUTTER.instances[:2]]
    assert not estimate_doubts(estimated(60.0).only(ids))
    assert not estimate_doubts(replace(estimated(3.0, 0.5), instances=CLUTTER.instances))


def test_objects_without_initial_pose_are_left_out() -> None:
    problem = estimated(3.0, 0.5)
    bare = tuple(replace(i, hypotheses=()) for i in problem.instances)
    assert estimate_doubts(replace(problem, instances=(bare[0], *problem.instances[1:])))
    assert not estimate_doubts(replace(problem, instances=bare))
