"""Laws of refining, settling and verifying one pose, on real frames and on a made-up one."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from verefine_viz.core.accuracy import CORRECT, PoseErrors
from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import ShapeError
from verefine_viz.core.geometry import axis_angle, inverse, random_unit_vector, transform
from verefine_viz.core.problem import Placed, Problem, Target
from verefine_viz.evaluation.pose_errors import pose_errors
from verefine_viz.physics.plausibility import plausibility
from verefine_viz.run.refined_pose import RefinedPose, refined_pose
from verefine_viz.run.session_file import resolve
from verefine_viz.run.toolbox import Toolbox

pytestmark = pytest.mark.usefixtures("long_run")
HULLS = {"collider": "hull"}


def as_placed_by_a_person(target: Target, rng: np.random.Generator) -> Float:
    """Ground truth off by up to 15 px, 20 mm in depth, 25° about the vertical and 10° else."""
    truth, camera, support = target.instance.T_cam_obj_gt, target.observation.camera, target.observation.support
    assert truth is not None
    assert support is not None
    up = inverse(support.T_world_cam)[:3, 2]
    about, else_ = axis_angle(up, np.radians(rng.uniform(-25, 25))), np.radians(rng.uniform(0, 10))
    R = axis_angle(random_unit_vector(rng), else_) @ about @ truth[:3, :3]
    u, v = rng.uniform(-15, 15, 2)
    z = truth[2, 3]
    t = truth[:3, 3] + [u * z / camera.fx, v * z / camera.fy, 0.0]
    return transform(R, t * (z + rng.uniform(-0.02, 0.02)) / z)


def others_at_truth(problem: Problem, target: Target) -> tuple[Placed, ...]:
    return tuple(
        Placed(one.instance.instance_id, one.model, one.instance.T_cam_obj_gt)
        for one in problem.targets
        if one is not target and one.instance.T_cam_obj_gt is not None
    )


def without_truth(target: Target) -> Target:
    return replace(target, instance=replace(target.instance, T_cam_obj_gt=None, hypotheses=()))


def beyond_tolerance_mm(tools: Toolbox, target: Target, T: Float, placed: tuple[Placed, ...]) -> float:
    moving, support = Placed(target.instance.instance_id, target.model, T), target.observation.support
    assert support is not None
    found = plausibility(moving, placed, support, tools.session.physics)
    return max(found.penetration_mm - found.tolerance_mm, 0.0)


def same(one: RefinedPose, other: RefinedPose) -> bool:
    return np.array_equal(one.T_cam_obj, other.T_cam_obj) and one.score.score == other.score.score


def errors_of(target: Target, refined: RefinedPose) -> PoseErrors:
    assert target.instance.T_cam_obj_gt is not None
    return pose_errors(target.model, refined.T_cam_obj, target.instance.T_cam_obj_gt)


def real_frames(shared_data: Path) -> Iterator[tuple[Toolbox, Problem]]:
    scene = {"source": "bop", "dataset": str(shared_data / "ycbv"), "frames": []}
    tools = Toolbox(resolve({"scene": scene, "physics": HULLS}))
    return ((tools, tools.problem(frame)) for frame in tools.frames)


def test_poses_as_a_person_places_them_come_out_right_on_real_frames(shared_data: Path) -> None:
    rng, errors_mm, right, stayed = np.random.default_rng(0), [], [], []
    for tools, problem in real_frames(shared_data):
        for target in problem.targets:
            start, placed = as_placed_by_a_person(target, rng), others_at_truth(problem, target)
            blind = without_truth(target)
            refined = refined_pose(tools, blind, start, placed)
            name = f"{target.model.name} in {problem.frame}"
            assert refined.score.score >= refined.score_before.score, name
            deeper_mm = beyond_tolerance_mm(tools, blind, refined.T_cam_obj, placed)
            assert deeper_mm <= beyond_tolerance_mm(tools, blind, start, placed) + 1e-9, name
            assert same(refined, refined_pose(tools, target, start, placed)), (
                f"{name}: what went before, or truth, counts"
            )
            errors = errors_of(target, refined)
            errors_mm.append(errors.add_s_mm)
            right.append(errors.relative < CORRECT)
            stayed.append(np.array_equal(refined.T_cam_obj, start))
    assert len(right) == 28
    assert sum(right) >= 26
    assert np.median(errors_mm) < 3.0
    assert not any(stayed)


def made_up(**physics: object) -> tuple[Toolbox, Problem]:
    scene = {"source": "demo", "demo": "clutter"}
    tools = Toolbox(resolve({"scene": scene, "physics": {**HULLS, **physics}, "method": {"refiner": "icp"}}))
    return tools, tools.problem(tools.frames[0])


def test_without_support_or_physics_a_pose_is_refined_and_scored() -> None:
    tools, problem = made_up()
    still, _ = made_up(enabled=False)
    target = problem.targets[0]
    floating = replace(target, observation=replace(target.observation, support=None))
    start = as_placed_by_a_person(target, np.random.default_rng(1))
    for box, one in ((tools, floating), (still, target)):
        refined = refined_pose(box, one, start)
        assert refined.physics is None
        assert refined.score.score > refined.score_before.score
        errors = errors_of(target, refined)
        assert errors.is_correct
    assert refined_pose(tools, target, start).physics is not None


def test_what_the_image_allows_is_worked_out_for_the_answer_where_it_is_asked() -> None:
    tools, problem = made_up()
    target = problem.targets[0]
    start = as_placed_by_a_person(target, np.random.default_rng(2))
    plain, verified = (refined_pose(tools, target, start, with_allowed=asked) for asked in (False, True))
    assert same(plain, verified)
    assert plain.allowed is None
    assert verified.allowed is not None
    assert np.array_equal(verified.allowed.T_cam_obj, verified.T_cam_obj)


def test_a_pose_that_is_not_rigid_is_refused() -> None:
    tools, problem = made_up()
    with pytest.raises(ShapeError, match="proposed pose"):
        refined_pose(tools, problem.targets[0], 2.0 * np.eye(4))
