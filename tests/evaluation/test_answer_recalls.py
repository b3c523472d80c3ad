"""Recalls of single answers: their mean is the score of the benchmark."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.evaluation import demo_set
from tests.evaluation.demo_set import disturbed, table
from tests.fakes import box_problem
from verefine_viz.core.geometry import axis_angle, transform
from verefine_viz.evaluation.answer_recalls import answer_recalls
from verefine_viz.evaluation.bop_scores import bop_scores
from verefine_viz.evaluation.ground_truth import ProblemGroundTruth


@pytest.mark.usefixtures("long_run")
def test_the_mean_over_all_objects_is_the_score_of_the_same_poses(tmp_path: Path) -> None:
    demo = demo_set.make(tmp_path / "demo")
    truth, rows = ProblemGroundTruth("demo", demo.problems), demo.rows(disturbed)
    recalls = bop_scores([table(rows)], truth, demo.targets)[0].recalls
    pose_of = {(row.scene_id, row.im_id, row.obj_id): row.T_cam_obj for row in rows}
    own = [
        answer_recalls(target, pose, problem.observation)
        for problem in demo.problems
        for target in problem.targets
        if (pose := pose_of.get((problem.scene_id, problem.im_id, target.instance.obj_id))) is not None
    ]
    assert len(own) == len(rows) >= 10
    expected = recalls.ar_vsd, recalls.ar_mssd, recalls.ar_mspd
    assert np.mean([[one.ar_vsd, one.ar_mssd, one.ar_mspd] for one in own], axis=0) == pytest.approx(expected)
    assert np.mean([one.ar for one in own]) == pytest.approx(recalls.ar)
    assert 0 < recalls.ar < 1


def test_recalls_are_full_for_the_truth_and_fall_with_the_error() -> None:
    problem = box_problem()
    target = problem.targets[0]
    T_gt = target.instance.T_cam_obj_gt
    assert answer_recalls(target, T_gt, problem.observation).ar == 1.0
    found = []
    for step in range(6):
        T = T_gt @ transform(axis_angle(np.array([1.0, 0, 0]), np.radians(4 * step)), np.array([0.01 * step, 0, 0]))
        found.append(answer_recalls(target, T, problem.observation).ar)
    assert found == sorted(found, reverse=True)
    assert found[-1] < 0.8
