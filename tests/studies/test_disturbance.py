"""Errors of initial poses and missing depth: exactly as much as was asked for, and nothing else."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.fakes import box_problem
from verefine_viz.core.errors import InputError
from verefine_viz.core.geometry import angle_between, apply, axis_angle, transform
from verefine_viz.core.problem import Problem
from verefine_viz.core.settings import HypothesesSettings, SceneSettings
from verefine_viz.scenes.demo import demo_problem
from verefine_viz.studies.disturbance import disturbed, occluded, on_true_plane, without_top
from verefine_viz.studies.paper_tables import tables

PROBLEM = box_problem(n_instances=3)


def _scene() -> Problem:
    return demo_problem("stack", SceneSettings(demo="stack", model_points=200), HypothesesSettings())


def _measured(problem: Problem, k: int) -> int:
    return int((problem.instances[k].mask & (problem.observation.depth_m > 0)).sum())


@given(st.integers(1, 6), st.floats(0, 90), st.floats(0, 100), st.integers(0, 1000))
@settings(max_examples=30, deadline=None)
def test_initial_poses_are_off_by_exactly_the_error(
    n: int, rotation_deg: float, translation_mm: float, seed: int
) -> None:
    for instance in disturbed(PROBLEM, n, rotation_deg, translation_mm, seed).instances:
        T_gt = instance.T_cam_obj_gt
        assert len(instance.hypotheses) == n
        for h in instance.hypotheses:
            moved_mm = 1e3 * np.linalg.norm(h.T_cam_obj[:3, 3] - T_gt[:3, 3])
            assert moved_mm == pytest.approx(translation_mm, abs=1e-6)
            turned = np.degrees(angle_between(h.T_cam_obj[:3, :3], T_gt[:3, :3]))
            assert turned == pytest.approx(rotation_deg, abs=1e-4)


@given(st.floats(0, 0.95), st.integers(0, 1000))
@settings(max_examples=30, deadline=None)
def test_rectangles_take_exactly_the_share_of_every_object_and_nothing_beside_them(share: float, seed: int) -> None:
    left = occluded(PROBLEM, share, seed)
    for k in range(3):
        n = _measured(PROBLEM, k)
        assert n - _measured(left, k) == round(share * n)
    before, after = PROBLEM.observation, left.observation
    outside = ~before.object_mask
    np.testing.assert_array_equal(after.depth_m[outside], before.depth_m[outside])
    assert set(np.unique(after.depth_m[before.object_mask & (after.depth_m != before.depth_m)])) <= {0.0}
    assert after.support is before.support
    again = occluded(PROBLEM, share, seed)
    np.testing.assert_array_equal(again.observation.depth_m, after.depth_m)


@pytest.mark.usefixtures("processes")
def test_what_is_taken_from_the_top_lies_above_what_stays() -> None:
    scene = _scene()
    left = without_top(scene, 0.4)
    support = scene.observation.support
    points = scene.observation.camera.back_project(scene.observation.depth_m).reshape(-1, 3)
    height_m = (apply(support.T_world_cam, points) @ support.normal_world).reshape(scene.observation.depth_m.shape)
    for k, instance in enumerate(scene.instances):
        measured = instance.mask & (scene.observation.depth_m > 0)
        gone = measured & (left.observation.depth_m == 0)
        n = int(measured.sum())
        assert abs(int(gone.sum()) - round(0.4 * n)) <= 0.02 * n  # masks of neighbours may overlap
        assert height_m[gone].min() >= height_m[measured & ~gone].max() - 1e-9
        assert len(left.instances[k].points_cam) <= n - int(gone.sum())


@pytest.mark.usefixtures("processes")
def test_the_true_plane_is_that_of_the_ground_truth_whatever_was_detected() -> None:
    scene = _scene()
    true = scene.observation.support
    tilted = transform(axis_angle(np.array([1.0, 0, 0]), np.radians(8)), np.array([0.0, 0.02, 0.05])) @ true.T_world_cam
    wrong = replace(scene, observation=replace(scene.observation, support=replace(true, T_world_cam=tilted)))
    for problem in (scene, wrong):
        support = on_true_plane(problem).observation.support
        to_world = true.T_world_cam @ np.linalg.inv(support.T_world_cam)
        assert np.degrees(np.arccos(to_world[2, 2])) < 0.2
        assert abs(to_world[2, 3]) < 0.001
    unseen = replace(scene, observation=replace(scene.observation, depth_m=np.zeros_like(scene.observation.depth_m)))
    with pytest.raises(InputError, match="no plane"):
        on_true_plane(unseen)


def test_frames_that_cannot_be_used_say_why() -> None:
    blind = replace(PROBLEM, instances=tuple(replace(i, T_cam_obj_gt=None) for i in PROBLEM.instances))
    with pytest.raises(InputError, match=r"scene_gt\.json"):
        disturbed(blind, 1, 5, 5, 0)
    with pytest.raises(InputError, match="ground truth"):
        tables(own_initial_poses=True).panels[0].prepare(blind, 0.0, 0)
    plane = replace(PROBLEM.observation, support=None, support_note="no plane was found")
    with pytest.raises(InputError, match="no plane"):
        without_top(replace(PROBLEM, observation=plane), 0.5)


def test_objects_without_ground_truth_are_left_out() -> None:
    first, *others = PROBLEM.instances
    mixed = replace(PROBLEM, instances=(replace(first, T_cam_obj_gt=None), *others))
    found = disturbed(mixed, 2, 5, 5, 0).instances
    assert [i.instance_id for i in found] == [1, 2]
    assert [i.hypotheses for i in found] != [i.hypotheses for i in others]
    for instance, of_all in zip(found, disturbed(PROBLEM, 2, 5, 5, 0).instances[1:], strict=True):
        for mine, same in zip(instance.hypotheses, of_all.hypotheses, strict=True):
            np.testing.assert_array_equal(mine.T_cam_obj, same.T_cam_obj)


@pytest.mark.usefixtures("processes")
def test_what_is_left_of_a_cloud_has_as_many_points_as_before() -> None:
    scene = _scene()
    few = replace(scene, instances=tuple(replace(i, points_cam=i.points_cam[:150]) for i in scene.instances))
    for instance in without_top(few, 0.1).instances:
        assert len(instance.points_cam) == 150
