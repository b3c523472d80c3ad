"""What a doubt offers puts the data right: the frame with its remedy is doubted no more, and is the right one again."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.calibration.right_variants import off, only
from tests.calibration.sizes import moved, real, with_instances, with_truth
from tests.calibration.spoiled import CLUTTER, IN_TRUTH, SPOILED, blind, other_focal, other_size, with_depth
from tests.made_up_frames import Thing, frame_of, model, standing
from verefine_viz.calibration.consistency import data_doubts
from verefine_viz.calibration.corrected_data import corrected
from verefine_viz.core.camera import Camera
from verefine_viz.core.data_remedies import (
    AS_READ,
    IN_CONVENTION,
    changes_between,
    corrected_pose,
    of_models,
    on_top,
)
from verefine_viz.core.doubt import DOUBTS, DoubtKind
from verefine_viz.core.geometry import random_unit_vector, transform
from verefine_viz.core.problem import Problem
from verefine_viz.core.settings import DataSettings, SceneSettings
from verefine_viz.scenes.demo_layout import Viewpoint

LARGEST_FIRST = sorted(CLUTTER.instances, key=lambda i: -int(np.count_nonzero(i.mask)))
RNG = np.random.default_rng


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


@pytest.mark.parametrize("name", IN_TRUTH)
def test_a_mistake_in_ground_truth_is_named_by_its_remedy(name: str) -> None:
    doubt, *_ = data_doubts(with_truth(CLUTTER, IN_TRUTH[name]))
    assert doubt.kind == (DoubtKind.POSE_SCALE if "×" in name else DoubtKind.CONVENTION)


def test_one_object_that_is_off_is_named_alone() -> None:
    first, *others = LARGEST_FIRST
    assert first.T_cam_obj_gt is not None
    for T in (moved(10)(first.T_cam_obj_gt), transform(first.T_cam_obj_gt[:3, :3], np.zeros(3))):
        (doubt,) = data_doubts(replace(CLUTTER, instances=(replace(first, T_cam_obj_gt=T), *others)))
        assert [*doubt.instances] == [first.instance_id]


def test_masks_in_another_order_are_doubted_at_those_two() -> None:
    a, b = LARGEST_FIRST[:2]
    swapped = {a.instance_id: b.mask, b.instance_id: a.mask}
    doubts = data_doubts(with_instances(CLUTTER, lambda i: replace(i, mask=swapped.get(i.instance_id, i.mask))))
    assert {i for doubt in doubts for i in doubt.instances} == {a.instance_id, b.instance_id}


def test_masks_of_everything_are_looked_at_before_meshes() -> None:
    everything = np.any([i.mask for i in CLUTTER.instances], axis=0)
    for mask in (np.ones_like(everything), everything):
        doubts = data_doubts(blind(problem=with_instances(CLUTTER, lambda i, mask=mask: replace(i, mask=mask))))
        assert DoubtKind.MASK in {doubt.kind for doubt in doubts}
        assert DoubtKind.MODEL_SCALE not in {doubt.kind for doubt in doubts}


def wide_frame() -> Problem:
    """Four objects at the edge of the picture of a wide lens."""
    camera = Camera(np.array([[280.0, 0, 319.5], [0, 280.0, 239.5], [0, 0, 1]]), 640, 480)
    rng, things = RNG(2), []
    for k, name in enumerate(("jug", "carton", "block", "bottle")):
        m = model(name)
        T = standing(m, rng, 0.01)
        T[:2, 3] += 0.32 * np.array([np.cos(k * np.pi / 2), np.sin(k * np.pi / 2)])
        things.append(Thing(m, T))
    return frame_of(things, rng, Viewpoint(20, 60, 0.6), camera=camera)


def test_distances_in_place_of_depth_are_put_right_where_the_lens_is_wide() -> None:
    problem = wide_frame()
    camera = problem.observation.camera
    v, u = np.indices(camera.shape)
    rays = np.sqrt(1 + ((u - camera.cx) / camera.fx) ** 2 + ((v - camera.cy) / camera.fy) ** 2)
    assert data_doubts(problem) == ()
    (doubt,) = data_doubts(with_depth(problem, rays))
    assert doubt.remedy == DataSettings(depth_along="ray")


def test_what_nothing_single_explains_has_no_remedy_and_a_camera_goes_before() -> None:
    rng = RNG(3)
    (doubt,) = data_doubts(with_truth(CLUTTER, lambda T: T @ transform(np.eye(3), 0.4 * random_unit_vector(rng))))
    assert (doubt.kind, doubt.remedy) == (DoubtKind.MISFIT, None)
    away = blind(off(RNG(0), 90, 500))
    assert {doubt.kind for doubt in data_doubts(away)} == {DoubtKind.MISFIT}
    assert data_doubts(only(1)(away, RNG(0))) == ()
    assert DoubtKind.CAMERA in {doubt.kind for doubt in data_doubts(other_size(CLUTTER))}


def depth_doubt(problem: Problem, factor: float, rel: float = 0.03) -> DoubtKind:
    """The kind of the one doubt of a frame whose depth is so many times as large; its remedy divides by it."""
    (doubt,) = data_doubts(with_depth(problem, factor))
    assert doubt.remedy is not None
    assert doubt.remedy.depth_times == pytest.approx(1 / factor, rel=rel)
    return doubt.kind


def test_one_object_shows_a_factor_of_depth_as_a_whole_frame_does() -> None:
    for factor in (1.25, 4.0, 39.37):
        depth_doubt(only(1)(blind(), RNG(0)), factor)


def test_of_a_real_frame_one_hidden_object_shows_depth_and_not_a_pose_and_all_show_the_camera(
    shared_data: Path,
) -> None:
    frame = real(shared_data / "ycbv", "50/1")
    hidden = blind(problem=only(1)(frame, RNG(0)))
    for factor in (0.8, 1.25, 39.37):
        depth_doubt(hidden, factor)
    farther = with_instances(
        hidden, lambda i: replace(i, hypotheses=(replace(h := i.hypotheses[0], T_cam_obj=moved(1.25)(h.T_cam_obj)),))
    )
    assert data_doubts(hidden) == data_doubts(farther) == ()
    (doubt,) = data_doubts(other_focal(blind(problem=frame), 0.63))
    assert doubt.remedy is not None
    assert doubt.remedy.camera_times[:2] == pytest.approx((1 / 0.63, 1 / 0.63), rel=0.03)


@pytest.mark.parametrize("frame", ["0/1", "49/2365", "50/1"])
def test_of_real_frames_units_are_named(shared_data: Path, frame: str) -> None:
    for factor in (10.0, 0.001):
        assert depth_doubt(real(shared_data / "ycbv", frame), factor, rel=0.1) == DoubtKind.DEPTH_SCALE


def test_data_as_read_are_the_same_frame_and_poses_made_from_ground_truth_stay() -> None:
    assert corrected(CLUTTER, AS_READ, SceneSettings()) is CLUTTER
    data = DataSettings(pose_times=0.001, model_times=of_models([*CLUTTER.models], 2.0).model_times)
    first, second = (corrected(CLUTTER, data, SceneSettings()) for _ in range(2))
    assert [first.models[i] is second.models[i] for i in first.models] == [True] * len(first.models)
    for one, before in zip(first.instances, CLUTTER.instances, strict=True):
        assert [h.T_cam_obj.tolist() for h in one.hypotheses] == [h.T_cam_obj.tolist() for h in before.hypotheses]


def test_what_is_put_right_after_something_else_does_both() -> None:
    rng = RNG(0)
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
