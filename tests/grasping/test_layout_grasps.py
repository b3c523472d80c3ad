"""The simulated gripper on layout 0 of the GRASPA benchmark: annotated grasps lift their objects, and nothing else."""

from pathlib import Path

import pytest

from verefine_viz.core.algorithm_settings import GraspSettings
from verefine_viz.core.problem import Problem
from verefine_viz.core.settings import HypothesesSettings, SceneSettings
from verefine_viz.grasping.grasp_answer import GraspScene
from verefine_viz.grasping.grasp_check import are_free
from verefine_viz.scenes.source import open_scene

pytestmark = pytest.mark.usefixtures("long_run", "processes")

MOST = 3
"""Free grasps per object that are carried out, spread over the list."""


@pytest.fixture(scope="module")
def problem(shared_data: Path) -> Problem:
    layout, models = shared_data / "grasps/graspa_layouts/layout_0.xml", shared_data / "ycbv/models_textured"
    scene = SceneSettings(source="layout", layout=str(layout), dataset=str(models))
    return open_scene(scene, HypothesesSettings()).problem("0/0")


@pytest.fixture(scope="module")
def scene(problem: Problem, shared_data: Path) -> GraspScene:
    return GraspScene(problem, GraspSettings(folder=str(shared_data / "grasps/ycbv")))


def test_free_annotated_grasps_of_rigid_objects_lift_them_and_nothing_without(
    problem: Problem, scene: GraspScene
) -> None:
    lifted: list[bool] = []
    for target in problem.targets:
        if target.model.name == "banana":  # The fingers of most of its grasps would reach below the plane.
            continue
        instance = target.instance
        grasps = scene.grasps(instance.instance_id)
        assert grasps.source == "annotated"
        Ts = instance.T_cam_obj_gt @ grasps.T_obj_gripper
        free = Ts[are_free(Ts, scene.around, GraspSettings())]
        assert len(free) > 0, target.model.name
        for T in free[:: -(-len(free) // MOST)]:
            lifted.append(scene.carry_out(instance.instance_id, T).verdict == "success")
        assert scene.carry_out(instance.instance_id, free[0], without_target=True).verdict != "success"
    assert sum(lifted) >= 0.9 * len(lifted)
