"""The parts a diagnosis stands on: registration of depth, the true plane, undeclared symmetries, errors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.made_up_frames import CAMERA, frame_of, model, moved, near, small_carton, standing
from tests.made_up_frames import Thing as Made
from verefine_viz.calibration.depth_shift import registration_of
from verefine_viz.core.geometry import apply, axis_angle, inverse, random_unit_vector, transform
from verefine_viz.diagnosis.frame_ground_truth import FrameGroundTruth, supporting_plane
from verefine_viz.diagnosis.symmetry import nearby_symmetry, undeclared_turn
from verefine_viz.evaluation.pose_errors import ErrorOf, pose_errors


def bumpy_object() -> tuple[np.ndarray, np.ndarray]:
    """(observed, true) depth of a bump on a table."""
    v, u = np.mgrid[0:120, 0:160]
    inside = ((u - 80) / 26) ** 2 + ((v - 60) / 30) ** 2 < 1
    bump = 0.55 - 0.04 * np.sqrt(np.clip(1 - ((u - 80) / 26) ** 2 - ((v - 60) / 30) ** 2, 0, None))
    true = np.where(inside, bump, 0.0)
    return np.where(inside, bump, 0.62).astype(np.float32), true


@settings(max_examples=20)
@given(st.integers(-30, 30), st.integers(-30, 30))
def test_a_shift_is_found_and_undone(right: int, down: int) -> None:
    observed, true = bumpy_object()
    off = registration_of(np.roll(observed, (down, right), axis=(0, 1)), true)
    assert off.shift_px == (right, down)
    assert off.is_off == (max(abs(right), abs(down)) >= 3 and off.best_agreement > off.agreement + 0.06)
    if max(abs(right), abs(down)) >= 8:
        assert off.is_off
    back = off.undone(np.roll(observed, (down, right), axis=(0, 1)))
    assert np.array_equal(back[30:90, 40:120], observed[30:90, 40:120])


@settings(max_examples=20)
@given(st.floats(0.5, 1.5).filter(lambda s: abs(s - 1) > 0.04))
def test_a_wrong_unit_is_found_and_undone(scale: float) -> None:
    observed, true = bumpy_object()
    off = registration_of((observed * scale).astype(np.float32), true)
    assert off.is_off
    assert off.scale == pytest.approx(scale, rel=1e-3)
    assert off.undone((observed * scale).astype(np.float32)) == pytest.approx(observed, rel=2e-3)


def test_good_depth_is_left_alone_and_missing_depth_is_not_shifted() -> None:
    observed, true = bumpy_object()
    assert not registration_of(observed, true).is_off
    assert not registration_of(np.where(true > 0, 0, observed), true).is_off
    assert not registration_of(observed, np.zeros_like(true)).is_off


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10_000))
def test_objects_stand_on_the_true_plane(seed: int) -> None:
    rng = np.random.default_rng(seed)
    m = model(str(rng.choice(["mug", "carton", "cereal", "jug", "can"])))
    T_cam_world = inverse(transform(axis_angle([1, 0, 0], -np.pi / 2 - rng.uniform(0.4, 1.0)), [0, -0.35, 0.45]))
    T_world_obj = standing(m, rng, 0.05)
    table = np.column_stack([rng.uniform(-0.4, 0.4, (3000, 2)), rng.normal(0, 0.001, 3000)])
    table = table[np.linalg.norm(table[:, :2] - T_world_obj[:2, 3], axis=1) > 0.5 * m.diameter_m]
    # A wall behind must not be taken for the table.
    wall = np.column_stack([rng.uniform(-0.4, 0.4, 2000), np.full(2000, 0.4), rng.uniform(0, 0.5, 2000)])
    found = supporting_plane(apply(T_cam_world @ T_world_obj, m.vertices), apply(T_cam_world, np.vstack([table, wall])))
    assert found is not None
    heights_m = apply(found.T_world_cam @ T_cam_world, table)[:, 2]
    assert np.abs(heights_m).max() < 0.008
    up = found.T_world_cam[2, :3]
    assert up @ T_cam_world[:3, 2] > np.cos(np.deg2rad(2))


def test_no_plane_where_none_is_seen() -> None:
    m = model("mug")
    assert supporting_plane(apply(transform(np.eye(3), [0, 0, 0.5]), m.vertices), np.zeros((0, 3))) is None


@pytest.mark.parametrize("name", ["can", "block", "cereal", "bottle", "bracket", "bowl"])
def test_declared_symmetries_are_found_without_being_declared(name: str) -> None:
    full, rng = model(name), np.random.default_rng(3)
    bare = model(name, symmetric=False)
    turned = [S for S in full.symmetries if np.trace(S[:3, :3]) < 2.5]
    for S in turned[:: max(len(turned) // 4, 1)]:
        off = transform(axis_angle(random_unit_vector(rng), np.deg2rad(4)), random_unit_vector(rng) * 0.003)
        found = nearby_symmetry(bare, off @ S)
        assert found is not None
        errors = pose_errors(full, found, np.eye(4))
        assert errors.rotation_deg < 4  # The declared turns of round things are a few degrees apart.
        assert errors.translation_mm < 1


@pytest.mark.parametrize("deg", [20, 150])
def test_a_can_that_is_nearly_round_counts_as_round(deg: float) -> None:
    can = model("can", symmetric=False)
    # A dent on one side and a seam: 3 mm from round, more than 2 % of the diameter.
    around = np.arctan2(can.points[:, 1], can.points[:, 0])
    out = 1.0 + 0.003 * np.cos(around) / np.linalg.norm(can.points[:, :2], axis=1).max()
    points = can.points * np.stack([out, out, np.ones_like(out)], axis=1)
    found = nearby_symmetry(
        replace(can, points=points), transform(axis_angle(np.array([0, 0, 1.0]), np.deg2rad(deg)), [0.002, 0, 0])
    )
    assert found is not None
    assert np.rad2deg(np.arccos((np.trace(found[:3, :3]) - 1) / 2)) == pytest.approx(deg, abs=5)


def test_a_can_whose_ends_differ_by_what_a_sensor_is_off_by_is_not_the_same_upside_down() -> None:
    can = model("can", symmetric=False)
    # A can with a wider top: its halves are 2.7 mm apart when it is turned over, more than 2 % of the diameter.
    height, radius = np.abs(can.points[:, 2]).max(), np.linalg.norm(can.points[:, :2], axis=1).max()
    out = 1.0 + (0.5 * (0.02 * can.diameter_m + 0.0006) * can.points[:, 2] / height) / radius
    wider = replace(can, points=can.points * np.stack([out, out, np.ones_like(out)], axis=1))
    over, round_ = (transform(axis_angle(axis, np.pi), np.zeros(3)) for axis in (np.eye(3)[0], np.eye(3)[2]))
    assert nearby_symmetry(can, over) is not None
    assert nearby_symmetry(wider, over) is None
    assert nearby_symmetry(wider, round_) is not None


def test_a_turn_that_keeps_the_shape_says_whether_texture_could_tell() -> None:
    can = model("can", symmetric=False)
    T_est = transform(axis_angle(np.array([0, 0, 1.0]), np.deg2rad(60)), np.zeros(3))
    half = np.where(can.vertices[:, :1] > 0, [[255, 0, 0]], [[0, 0, 255]]).astype(np.uint8)
    plain = np.full_like(half, 128)
    said = {}
    for name, colors in (("none", None), ("half", half), ("plain", plain)):
        turn = undeclared_turn(replace(can, vertex_colors=colors), T_est, np.eye(4), 0.1)
        assert turn is not None
        said[name] = turn.describe("can")
    assert said["none"].endswith("the model has no colours.")
    assert said["half"].endswith("Its texture could tell, as colours differ there; depth cannot.")
    assert said["plain"].endswith("Its colours are alike as well.")


@pytest.mark.parametrize("name", ["duck", "mug", "carton", "jug", "teddy"])
def test_what_has_no_symmetry_gets_none(name: str) -> None:
    m = model(name)
    for deg in (45, 90, 135, 180):
        for axis in np.eye(3):
            assert nearby_symmetry(m, transform(axis_angle(axis, np.deg2rad(deg)), np.zeros(3))) is None
    assert nearby_symmetry(m, transform(np.eye(3), [0.002, 0, 0])) is None  # An error is no symmetry.


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10_000), st.sampled_from(["duck", "can", "bracket"]))
def test_errors_are_those_of_the_evaluation(seed: int, name: str) -> None:
    rng = np.random.default_rng(seed)
    m, T_true = model(name), transform(axis_angle(random_unit_vector(rng), 2.0), [0.1, 0.0, 0.7])
    T = moved(T_true, random_unit_vector(rng), rng.uniform(0, 180), 30 * random_unit_vector(rng))
    assert ErrorOf(m, T_true)(T) == pytest.approx(pose_errors(m, T, T_true).relative, rel=1e-9)


def test_the_outline_is_what_is_seen_of_the_object() -> None:
    rng = np.random.default_rng(1)
    front, behind = model("can"), small_carton()
    T_front = standing(front, rng, 0.0)
    T_behind = standing(behind, rng, 0.0)
    T_behind[:2, 3] += [0.04, 0.02]
    things = [Made(behind, T_behind, near(T_behind, rng, 1, 5, 5)), Made(front, T_front, is_asked_for=False)]
    problem = frame_of(things, rng)
    outline, mask = FrameGroundTruth(problem).outline(0), problem.instances[0].mask
    assert np.count_nonzero(outline & mask) / np.count_nonzero(outline | mask) > 0.9
    whole = replace(problem, observation=replace(problem.observation, depth_m=np.zeros(CAMERA.shape, np.float32)))
    assert np.count_nonzero(FrameGroundTruth(whole).outline(0)) > np.count_nonzero(outline)
