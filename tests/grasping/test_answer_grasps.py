"""The grasps of a frame's answers, and those of its ground truth."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from verefine_viz.core.algorithm_settings import GraspSettings
from verefine_viz.core.errors import Cancelled
from verefine_viz.core.problem import Problem
from verefine_viz.core.progress_token import ProgressToken
from verefine_viz.grasping.grasp_answer import answer_grasps
from verefine_viz.run.session_file import load_session
from verefine_viz.run.toolbox import Toolbox

SETTINGS = GraspSettings()
pytestmark = pytest.mark.usefixtures("processes")


@pytest.fixture(scope="module")
def problem() -> Problem:
    return Toolbox(load_session(None, {"scene": {"demo": "duck"}})).problem("0/0")


def test_a_pose_far_off_ends_otherwise_than_the_ground_truth(problem: Problem) -> None:
    (target,) = problem.targets
    T_gt = target.instance.T_cam_obj_gt
    support = problem.observation.support
    T_high = T_gt.copy()
    T_high[:3, 3] += 0.15 * support.T_world_cam[:3, :3].T @ support.normal_world
    pair = answer_grasps(problem, [T_high], SETTINGS).pairs[target.instance.instance_id]
    assert pair.ground_truth.verdict == "success"
    assert pair.answer.verdict == "no contact"
    path = pair.ground_truth.path
    assert len(path.contacts) == path.n_moments
    last = path.contacts[-1]
    assert {contact.instance_id for contact in last} == {target.instance.instance_id}
    T_end = path.Ts_world_obj[target.instance.instance_id][-1]
    reach_m = [float(np.linalg.norm(contact.point_world - T_end[:3, 3])) for contact in last]
    assert max(reach_m) < target.model.diameter_m


def test_why_nothing_was_tried_is_a_line(problem: Problem, tmp_path: Path) -> None:
    (target,) = problem.targets
    poses = [target.instance.T_cam_obj_gt]
    unknown = replace(problem, instances=tuple(replace(i, T_cam_obj_gt=None) for i in problem.instances))
    assert answer_grasps(unknown, poses, SETTINGS).notes == (
        "no grasps: frame 0/0: object 2 has no ground truth; a simulated grasp needs it",
    )
    np.save(tmp_path / "duck.npy", np.eye(4)[None] * 2)
    (note,) = answer_grasps(problem, poses, GraspSettings(folder=str(tmp_path))).notes
    assert note.startswith("no grasp of duck: ")
    assert "grasp 1, 4×4 in metres" in note
    assert answer_grasps(problem, [None], SETTINGS).pairs == {}


def test_a_grasp_can_be_cancelled(problem: Problem) -> None:
    (target,) = problem.targets
    stages: list[str] = []
    progress = ProgressToken(lambda doing, share: stages.append(doing), lambda: "Grasping: lift" not in stages)
    with pytest.raises(Cancelled):
        answer_grasps(problem, [target.instance.T_cam_obj_gt], SETTINGS, progress)
    assert stages[-1] == "Grasping: lift"
