"""Dropping things until they lie still."""

from __future__ import annotations

import numpy as np
import pytest

from tests.physics.bodies import T_WORLD_CAM, ball, box, heights, placed, ring, standing, table
from verefine_viz.core.geometry import angle_between, axis_angle
from verefine_viz.core.problem import Placed
from verefine_viz.physics.plausibility import plausibility
from verefine_viz.physics.simulator import BulletSimulator, settle_to_rest
from verefine_viz.recording.verify import first_difference

BRICK = box(0.06, 0.04, 0.1)


def test_dropped_box_ends_on_one_of_its_faces(simulator: BulletSimulator):
    start = placed(BRICK, (0, 0, 0.1), axis_angle([1, 2, 0.5], 0.6))
    path = settle_to_rest(simulator, start, (), table())
    z = heights(BRICK, path.T_cam_obj)
    assert z.min() == pytest.approx(0, abs=3e-4)
    assert np.sort(z)[:4].max() < 5e-4
    assert len(path.contacts) == len(path.Ts_cam_obj) - 1 < 600
    again = simulator.settle(Placed(0, BRICK, path.T_cam_obj), (), table(), 60)
    assert angle_between(again.T_cam_obj[:3, :3], path.T_cam_obj[:3, :3]) < np.deg2rad(0.5)
    assert plausibility(Placed(0, BRICK, path.T_cam_obj), (), table()).light == "green"


def test_it_is_the_beginning_of_the_long_simulation(simulator: BulletSimulator):
    start = placed(BRICK, (0, 0, 0.1), axis_angle([1, 0, 0], 0.3))
    path = settle_to_rest(simulator, start, (), table())
    long = simulator.settle(start, (), table(), 600)
    n = len(path.contacts)
    assert path.Ts_cam_obj.tobytes() == long.Ts_cam_obj[: n + 1].tobytes()
    assert first_difference(path.contacts, long.contacts[:n]) is None


def test_what_never_rests_ends_at_the_limit(simulator: BulletSimulator):
    path = settle_to_rest(simulator, placed(BRICK, (0, 0, 50.0)), (), table(), max_steps=70)
    assert len(path.contacts) == 70


def test_ball_rests_in_the_ring(simulator: BulletSimulator):
    path = settle_to_rest(simulator, placed(ball(), (0, 0, 0.1)), (standing(ring(), instance_id=1),), table())
    assert (T_WORLD_CAM @ path.T_cam_obj)[2, 3] == pytest.approx(0.02, abs=5e-4)
    assert len(path.contacts) < 600
