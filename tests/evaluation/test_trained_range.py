"""How far a start is from the ground truth, and the same start brought into a refiner's range."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

from tests.fakes import box_problem
from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import angle_between, apply, axis_angle, random_unit_vector, transform
from verefine_viz.core.refiner_steps import TrainedRange
from verefine_viz.evaluation.trained_range import start_of

TARGET = box_problem().targets[0]
MODEL, T_GT = TARGET.model, TARGET.instance.T_cam_obj_gt
TRAINED = TrainedRange(rotation_deg=60.0, shift_radii=0.8)
RADIUS_M = MODEL.diameter_m / 2


def off_by(rotation_deg: float, shift_m: float, seed: int) -> Float:
    """The ground truth turned about the object's middle, and shifted, both in random directions."""
    rng = np.random.default_rng(seed)
    middle = apply(T_GT, ((MODEL.vertices.min(axis=0) + MODEL.vertices.max(axis=0)) / 2)[None])[0]
    R = axis_angle(random_unit_vector(rng), np.deg2rad(rotation_deg))
    return transform(R @ T_GT[:3, :3], R @ (T_GT[:3, 3] - middle) + middle + shift_m * random_unit_vector(rng))


def test_a_start_is_beyond_the_range_by_its_rotation_or_by_the_shift_of_its_middle() -> None:
    model = replace(MODEL, symmetries=np.eye(4)[None])
    cases = (0, 0.3), (10, 0.0), (59, 0.7), (61, 0.1), (20, 0.9), (179, 2)
    for seed, (rotation_deg, shift_radii) in itertools.product(range(4), cases):
        start = start_of(model, off_by(rotation_deg, shift_radii * RADIUS_M, seed), T_GT)
        assert start.rotation_deg == pytest.approx(rotation_deg, abs=1e-6), seed
        assert start.shift_mm == pytest.approx(1e3 * shift_radii * RADIUS_M, abs=1e-6), seed
        assert start.is_beyond(TRAINED) == (rotation_deg > 60 or shift_radii > 0.8), (rotation_deg, shift_radii)


def test_brought_within_a_start_keeps_its_direction_and_what_is_already_small() -> None:
    model = replace(MODEL, symmetries=np.eye(4)[None])
    for seed in range(4):
        far = start_of(model, off_by(120, 0.2 * RADIUS_M, seed), T_GT)
        near = start_of(model, far.brought_within(TRAINED, 0.5), T_GT)
        assert near.turn == pytest.approx(far.turn / 4, abs=1e-9), seed
        assert near.shift_m == pytest.approx(far.shift_m, abs=1e-9), seed
        shifted = start_of(model, off_by(10, 1.6 * RADIUS_M, seed), T_GT)
        near = start_of(model, shifted.brought_within(TRAINED, 0.5), T_GT)
        assert near.turn == pytest.approx(shifted.turn, abs=1e-9), seed
        assert near.shift_m == pytest.approx(shifted.shift_m / 4, abs=1e-9), seed


def test_a_turn_that_looks_the_same_is_no_distance() -> None:
    half_turn = transform(axis_angle([0, 0, 1], np.pi), np.zeros(3))
    model = replace(MODEL, symmetries=np.stack([np.eye(4), half_turn]))
    assert start_of(model, T_GT @ half_turn, T_GT).rotation_deg == pytest.approx(0, abs=1e-6)
    near = start_of(model, T_GT @ half_turn, T_GT).brought_within(TRAINED, 0.5)
    assert angle_between(near[:3, :3], (T_GT @ half_turn)[:3, :3]) < 1e-6
