"""What lies between two poses, in words."""

from __future__ import annotations

import numpy as np
import pytest

from tests.fakes import box_problem
from verefine_viz.core.geometry import axis_angle, transform
from verefine_viz.evaluation.pose_errors import pose_errors, turning_on
from verefine_viz.viewer.text.pose_words import errors_in_words, movement, shift_mm


def test_movement_in_words() -> None:
    points = np.array([[-1.0, 0, 0], [1.0, 0, 0]])
    cases: tuple[tuple[list[float], float, list[float], str], ...] = (
        ([1, 0, 0], 6.8, [0, 0, 0], "turned it 6.8° about x"),
        ([0, 0, -1], 3.0, [0, 0.004, 0], "turned it 3.0° about z and moved it 4.0 mm"),
        ([1, 1, 1], 10.0, [0, 0, 0], "turned it 10.0°"),
        ([1, 0, 0], 0.0, [0, 0, 0.012], "moved it 12.0 mm"),
        ([1, 0, 0], 0.0, [0, 0, 0], "left it where it was"),
    )
    for axis, angle_deg, shift, said in cases:
        T_to = transform(axis_angle(axis, np.deg2rad(angle_deg)), shift)
        assert movement(np.eye(4), T_to, points) == said


def test_movement_is_that_of_the_objects_middle_not_of_its_origin() -> None:
    points = np.array([[1.0, 0, 0]])
    half_turn = transform(axis_angle([0, 0, 1], np.pi), [2.0, 0, 0])
    assert shift_mm(np.eye(4), half_turn, points) == pytest.approx(0.0, abs=1e-9)


def test_an_error_says_which_way_it_is_turned() -> None:
    (target,) = box_problem().targets
    T_gt = target.instance.T_cam_obj_gt
    cases: tuple[tuple[list[float], float, str], ...] = (
        ([0, 1, 0], 20.0, "20.0° (all of it a turn on the table)"),
        ([1, 0, 0], 5.0, "5.0° (all of it tilt against the table)"),
        ([3, 4, 0], 10.0, "10.0° (6.0° of tilt against the table, 8.0° of turn on it)"),
        ([3, 4, 0], 0.9, "0.9° and 3.0 mm"),
    )
    for axis, angle_deg, said in cases:
        T_est = T_gt @ transform(axis_angle(axis, np.deg2rad(angle_deg)), [0, 0, 0.003])
        told = errors_in_words(pose_errors(target.model, T_est, T_gt), turning_on(target, T_est))
        assert told.startswith(said)
