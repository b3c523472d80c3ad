"""What a doubt offers puts the data right: the frame with its remedy is doubted no more, and is the right one again."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from tests.calibration.right_variants import estimated, off
from tests.calibration.sizes import scene, with_focal
from tests.calibration.test_consistency import moved, with_depth, with_models
from tests.calibration.test_edges import with_depth_beside
from verefine_viz.calibration.consistency import data_doubts
from verefine_viz.calibration.corrected_data import corrected
from verefine_viz.core.arrays import Float
from verefine_viz.core.camera import Camera
from verefine_viz.core.data_remedies import (
    AS_READ,
    IN_CONVENTION,
    TO_OPENGL,
    changes_between,
    corrected_pose,
    of_models,
    on_top,
)
from verefine_viz.core.doubt import DOUBTS, DoubtKind
from verefine_viz.core.geometry import inverse, transform
from verefine_viz.core.problem import Problem
from verefine_viz.core.settings import DataSettings, SceneSettings

CLUTTER = scene("clutter", "0/0")


def blind(change: Callable[[Float], Float] = lambda T: T) -> Problem:
    disturb = off(np.random.default_rng(0), 3, 3)
    return estimated(CLUTTER, lambda T: change(disturb(T)))


def with_camera(problem: Problem, camera: Camera) -> Problem:
    return replace(problem, observation=replace(problem.observation, camera=camera))


def other_size(problem: Problem) -> Problem:
    right = problem.observation.camera
    return with_camera(problem, Camera(np.diag([0.5, 0.5, 1]) @ right.K, right.width, right.height))


SPOILED: dict[str, Callable[[], Problem]] = {
    "depth × 10": lambda: with_depth(blind(), 10.0),
    "depth × 4": lambda: with_depth(blind(), 4.0),
    "depth × 0.8": lambda: with_depth(blind(), 0.8),
    "depth beside": lambda: with_depth_beside(blind(), 25),
    "models × 0.1": lambda: with_models(blind(), 0.1),
    "translations × 1000": lambda: blind(moved(1000.0)),
    "everything in metres": lambda: with_depth(with_models(blind(moved(0.001)), 0.001), 0.001),
    "inverse": lambda: blind(inverse),
    "OpenGL": lambda: blind(lambda T: TO_OPENGL @ T),
    "transposed": lambda: blind(lambda T: transform(T[:3, :3].T, T[:3, 3])),
    "inverted masks": lambda: replace(blind(), instances=tuple(replace(i, mask=~i.mask) for i in blind().instances)),
    "K of another camera": lambda: with_camera(blind(), with_focal(CLUTTER.observation.camera, 0.63)),
    "K of another size": lambda: other_size(blind()),
    "ground truth and depth × 10": lambda: with_depth(CLUTTER, 10.0),
    "ground truth and another K": lambda: with_camera(CLUTTER, with_focal(CLUTTER.observation.camera, 0.8)),
}


@pytest.mark.parametrize("name", SPOILED)
def test_a_frame_with_the_remedy_of_its_doubt_is_right(name: str) -> None:
    spoiled = SPOILED[name]()
    (doubt,) = data_doubts(spoiled)
    assert doubt.remedy is not None
    assert doubt.remedy != AS_READ
    right = corrected(spoiled, doubt.remedy, SceneSettings())
    assert data_doubts(right) == ()
    assert right.observation.support is not None
    for one in right.instances:
        true = CLUTTER.target(one.instance_id).instance
        away_mm = 1e3 * np.linalg.norm(one.points_cam.mean(axis=0) - true.points_cam.mean(axis=0))
        assert away_mm < 40, (name, away_mm)
        size = right.models[one.obj_id].diameter_m / CLUTTER.models[one.obj_id].diameter_m
        assert size == pytest.approx(1), name


def test_data_as_read_are_the_same_frame() -> None:
    assert corrected(CLUTTER, AS_READ, SceneSettings()) is CLUTTER


def test_initial_poses_made_from_ground_truth_stay_and_a_model_is_made_once() -> None:
    data = DataSettings(pose_times=0.001, model_times=of_models([*CLUTTER.models], 2.0).model_times)
    first, second = (corrected(CLUTTER, data, SceneSettings()) for _ in range(2))
    assert [first.models[i] is second.models[i] for i in first.models] == [True] * len(first.models)
    for one, before in zip(first.instances, CLUTTER.instances, strict=True):
        assert [h.T_cam_obj.tolist() for h in one.hypotheses] == [h.T_cam_obj.tolist() for h in before.hypotheses]


def test_what_is_put_right_after_something_else_does_both() -> None:
    rng = np.random.default_rng(0)
    T = off(rng, 40, 300)(np.eye(4)) @ transform(np.eye(3), [0.0, 0.1, 0.8])
    for convention in IN_CONVENTION:
        one, more = DataSettings(pose_times=10.0, depth_times=0.1), DataSettings(poses=convention, depth_times=4.0)
        both = on_top(one, more)
        assert both is not None
        assert both.depth_times == pytest.approx(0.4)
        assert corrected_pose(T, both) == pytest.approx(corrected_pose(corrected_pose(T, one), more))
    assert on_top(DataSettings(poses="inverse"), DataSettings(poses="transposed")) is None
    twice = on_top(of_models([3], 10.0), of_models([3, 5], 0.1))
    assert twice is not None
    assert twice.model_times == ((5, 0.1),)
    assert changes_between(AS_READ, twice) == {"data.model_times": ((5, 0.1),)}


def test_every_kind_of_doubt_is_in_the_table() -> None:
    assert set(DOUBTS) == set(DoubtKind)
    assert len({known.title for known in DOUBTS.values()}) == len(DOUBTS)
