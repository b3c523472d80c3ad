"""Which grasp of a frame is carried out, and what is said where there is none."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from verefine_viz.core.algorithm_settings import GraspSettings
from verefine_viz.core.errors import InputError
from verefine_viz.core.problem import Problem
from verefine_viz.core.settings import HypothesesSettings, SceneSettings
from verefine_viz.grasping.grasp_answer import GraspScene
from verefine_viz.physics.colliders import build
from verefine_viz.scenes.demo import demo_problem

pytestmark = pytest.mark.usefixtures("long_run")


@pytest.fixture(scope="module")
def duck() -> Problem:
    return demo_problem("duck", SceneSettings(demo="duck"), HypothesesSettings())


def _scene(problem: Problem, settings: GraspSettings) -> GraspScene:
    return GraspScene(problem, settings, lambda model: build(model, "hull"))


def test_of_the_free_grasps_the_one_nearest_to_the_middle_lifts_the_object(duck: Problem) -> None:
    scene = _scene(duck, GraspSettings())
    T_gt = duck.instances[0].T_cam_obj_gt
    attempt = scene.attempt(0, T_gt)
    assert attempt.chosen is not None
    assert attempt.is_free[attempt.chosen]
    assert attempt.verdict == "success"


def test_without_a_free_grasp_nothing_is_carried_out(duck: Problem) -> None:
    """Below the table every approach meets it."""
    scene = _scene(duck, GraspSettings())
    T_gt = duck.instances[0].T_cam_obj_gt
    T_sunk = np.array(T_gt)
    T_sunk[:3, 3] -= 0.3 * scene.around.support.T_world_cam[:3, :3].T @ scene.around.support.normal_world
    attempt = scene.attempt(0, T_sunk)
    assert (attempt.verdict, attempt.chosen, attempt.path) == ("no collision-free grasp", None, None)
    assert not attempt.is_free.any()


def test_objects_without_ground_truth_or_wider_than_the_gripper_are_named(duck: Problem) -> None:
    with pytest.raises(InputError, match=r"frame 0/0: no object can be gripped.*grasp.opening_m = 0.02"):
        _scene(duck, GraspSettings(opening_m=0.02)).check_any_grasp()
    unknown = replace(duck, instances=tuple(replace(i, T_cam_obj_gt=None) for i in duck.instances))
    with pytest.raises(InputError, match=r"frame 0/0: object 2 has no ground truth"):
        _scene(unknown, GraspSettings())


def test_grasps_of_another_object_are_refused(duck: Problem, tmp_path: Path) -> None:
    far = np.eye(4)
    far[2, 3] = 0.5
    np.save(tmp_path / "duck.npy", far[None])
    with pytest.raises(InputError, match=r"duck.npy: 100% of the grasps have nothing of duck \(2\) between"):
        _scene(duck, GraspSettings(folder=str(tmp_path))).check_any_grasp()
