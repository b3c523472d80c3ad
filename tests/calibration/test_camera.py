"""Whether cam_K, models, distances or depth are of another size is told by how large objects appear and where."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.calibration.right_variants import cut_off
from tests.calibration.sizes import (
    Depth,
    Objects,
    moved,
    objects,
    of_problem,
    real,
    scene,
    verdict,
    with_camera,
    with_focal,
    with_instances,
)
from tests.calibration.spoiled import CLUTTER, blind, with_depth
from verefine_viz.calibration import camera_check
from verefine_viz.calibration.camera_check import CameraVerdict, estimate_doubts
from verefine_viz.core.camera import Camera
from verefine_viz.core.problem import Problem
from verefine_viz.scenes.demo import demo_names

HALF_A_PIXEL = np.array([[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]])
REAL = ("0/1", "0/5", "49/2365", "50/1", "900/2")
CAMERA, DEPTH_M = CLUTTER.observation.camera, CLUTTER.observation.depth_m
FACTORS = (0.75, 0.88, 1.12, 1.3)


def with_K(problem: Problem, fx: float = 1.0, fy: float = 1.0, dx: float = 0.0, dy: float = 0.0) -> Problem:
    """With focal lengths multiplied, and the principal point moved [px]."""
    camera = problem.observation.camera
    K = camera.K * [[fx, 1, 1], [1, fy, 1], [1, 1, 1]] + [[0, 0, dx], [0, 0, dy], [0, 0, 0]]
    return with_camera(problem, Camera(K, camera.width, camera.height))


def resized(of: Objects, factor: float) -> Objects:
    return [(replace(m, vertices=m.vertices * factor, points=m.points * factor), T, mask) for m, T, mask in of]


def assert_remedy(said: CameraVerdict, cause: str, fx: float = 1.0, fy: float = 1.0, rel: float = 0.02) -> None:
    """The verdict's cause, and by what its remedy multiplies the focal lengths."""
    assert said.cause == cause
    assert said.remedy is not None
    assert said.remedy.camera_times[:2] == pytest.approx((fx, fy), rel=rel)


@settings(max_examples=25)
@given(factor=st.one_of(st.floats(0.6, 0.93), st.floats(1.07, 1.6)))
def test_a_wrong_focal_length_is_noticed_with_its_factor(factor: float) -> None:
    assert_remedy(of_problem(CLUTTER, factor), "focal length", 1 / factor, 1 / factor)


@pytest.mark.parametrize(("fx", "fy"), [*((f, 1.0) for f in FACTORS), *((1.0, f) for f in FACTORS), (1.25, 0.85)])
def test_one_wrong_focal_length_or_two_factors_are_noticed(fx: float, fy: float) -> None:
    assert_remedy(of_problem(with_K(CLUTTER, fx=fx, fy=fy)), "one focal length", 1 / fx, 1 / fy)


@pytest.mark.parametrize(("dx", "dy"), [(40, 0), (0, -15), (-30, 40)])
def test_a_wrong_principal_point_is_noticed_with_its_pixels(dx: int, dy: int) -> None:
    said = of_problem(with_K(CLUTTER, dx=dx, dy=dy))
    assert said.cause == "principal point"
    assert said.remedy is not None
    cx, cy = CAMERA.cx + dx, CAMERA.cy + dy
    found = np.array(said.remedy.camera_times[2:]) * (cx, cy)
    np.testing.assert_allclose(found, (CAMERA.cx, CAMERA.cy), atol=3)


@pytest.mark.parametrize("factor", [0.5, 0.8, 0.92, 1.08, 1.3, 2.0])
def test_a_camera_of_images_of_another_size_is_told_from_a_wrong_focal_length(factor: float) -> None:
    K = np.diag([factor, factor, 1.0]) @ (CAMERA.K + HALF_A_PIXEL)
    K[:2, 2] -= 0.5
    said = verdict(objects(CLUTTER), Camera(K, CAMERA.width, CAMERA.height), DEPTH_M)
    assert_remedy(said, "image", 1 / factor, 1 / factor, rel=0.03)


@pytest.mark.parametrize("factor", FACTORS)
def test_models_distances_and_depth_of_another_size_are_told_apart(factor: float) -> None:
    of = objects(CLUTTER)
    said = verdict(resized(of, factor), CAMERA, DEPTH_M)
    assert said.cause == "models"
    assert said.model_factor == pytest.approx(1 / factor, rel=0.03)
    assert verdict([(m, moved(factor)(T), mask) for m, T, mask in of], CAMERA, DEPTH_M).cause == "distances"
    said = verdict(of, CAMERA, DEPTH_M * factor)
    assert said.cause == "depth"
    assert said.remedy is not None
    assert said.remedy.depth_times == pytest.approx(1 / factor, rel=0.02)


@pytest.mark.parametrize("name", demo_names())
def test_the_right_data_say_nothing(name: str) -> None:
    said = of_problem(scene(name))
    assert (said.advice, said.cause) == ("", None)


def test_what_a_lone_object_cannot_tell_is_not_said() -> None:
    mug = scene("failure_no_hypothesis_near")
    assert of_problem(mug, 0.8).cause == "focal length or models"
    # What masks that are too wide would do as well is not put down to either.
    assert of_problem(mug, 0.95).cause in (None, "masks")
    assert not of_problem(mug, 0.95).advice
    alone = CLUTTER.only([CLUTTER.instances[0].instance_id])
    assert not of_problem(with_K(alone, dx=40)).advice
    assert of_problem(with_K(alone, fx=1.2)).cause != "one focal length"


def test_one_object_that_is_off_is_no_sign_of_wrong_data() -> None:
    first, *others = objects(CLUTTER)
    assert not verdict([*resized([first], 1.3), *others], CAMERA, DEPTH_M).advice
    assert verdict([first, *resized(others, 1.3)], CAMERA, DEPTH_M).cause == "models"


def test_masks_that_are_displaced_are_told_from_a_camera() -> None:
    together = [(m, T, np.roll(mask, (8, -30), axis=(0, 1))) for m, T, mask in objects(CLUTTER)]
    assert verdict(together, CAMERA, DEPTH_M).cause == "masks"
    ways = [(0, 30), (0, -30), (30, 0), (-30, 0), (20, 20), (-20, -20)]
    for apart in (ways, np.random.default_rng(0).integers(-15, 16, (6, 2))):
        of = [
            (m, T, np.roll(mask, way, axis=(0, 1))) for (m, T, mask), way in zip(objects(CLUTTER), apart, strict=True)
        ]
        said = verdict(of, CAMERA, DEPTH_M)
        assert (said.advice, said.cause) == ("", None)


# Hidden parts and borders


def cropped(left: int, top: int, width: int, height: int) -> tuple[Objects, Camera, Depth]:
    """A part of a frame whose border cuts objects."""
    part = slice(top, top + height), slice(left, left + width)
    K = CAMERA.K - [[0, 0, left], [0, 0, top], [0, 0, 0]]
    of = [(model, T, mask[part]) for model, T, mask in objects(CLUTTER) if mask[part].any()]
    return of, Camera(K, width, height), DEPTH_M[part]


def hidden(seed: int) -> tuple[Objects, Camera, Depth]:
    """Bars that have no masks in front of everything."""
    v, u = np.indices(CAMERA.shape)
    rng = np.random.default_rng(seed)
    angle = rng.uniform(0, np.pi)
    bars = (u * np.cos(angle) + v * np.sin(angle) + rng.uniform(0, 90)) % 90 < 18
    return [(m, T, mask & ~bars) for m, T, mask in objects(CLUTTER)], CAMERA, np.where(bars, 0.3, DEPTH_M)


@pytest.mark.parametrize("focal", [0.85, 1.0, 1.18])
def test_parts_that_are_hidden_or_beyond_the_border_change_nothing(focal: float) -> None:
    crops = (cropped(200, 150, 250, 200), cropped(140, 100, 280, 180))
    for of, camera, depth_m in (*crops, *map(hidden, range(3))):
        said = verdict(of, with_focal(camera, focal), depth_m)
        if focal == 1:
            assert not said.advice
        else:
            assert_remedy(said, "focal length", 1 / focal, 1 / focal, rel=0.03)


def test_a_wrong_focal_length_is_noticed_beside_some_bad_masks() -> None:
    rng, cut = np.random.default_rng(4), cut_off(0.2)
    some = [(m, T, cut(mask, rng) if k in (1, 4) else mask) for k, (m, T, mask) in enumerate(objects(CLUTTER))]
    assert verdict(some, with_focal(CAMERA, 0.85), DEPTH_M).cause == "focal length"


def test_objects_of_few_pixels_say_nothing() -> None:
    step = 8
    small = Camera(np.diag([1 / step, 1 / step, 1]) @ CAMERA.K, CAMERA.width // step, CAMERA.height // step)
    of = [(model, T, mask[::step, ::step]) for model, T, mask in objects(CLUTTER)]
    said = verdict(of, with_focal(small, 0.8), DEPTH_M[::step, ::step])
    assert said == camera_check.verdict([])
    assert (said.advice, said.cause) == ("", None)


def test_without_ground_truth_initial_poses_show_depth_of_another_scale() -> None:
    for factor in (0.5, 0.9, 1.1, 2.0):
        (doubt,) = estimate_doubts(with_depth(blind(), factor))
        assert doubt.remedy is not None
        assert doubt.remedy.depth_times == pytest.approx(1 / factor, rel=0.05)
    assert estimate_doubts(blind()) == estimate_doubts(with_depth(CLUTTER, 0.5)) == ()
    few = blind().instances[0].instance_id
    some = with_instances(with_depth(blind(), 0.5), lambda i: replace(i, hypotheses=()) if i.instance_id == few else i)
    assert len(estimate_doubts(some)) == 1
    assert estimate_doubts(with_instances(some, lambda i: replace(i, hypotheses=()))) == ()


@pytest.mark.parametrize("frame", REAL)
def test_real_frames_are_silent_until_their_camera_is_wrong(shared_data: Path, frame: str) -> None:
    for kind, factors in (("mask_visib", (0.7, 0.9, 1.1)), ("mask", (0.9, 1.1, 1.3))):
        problem = real(shared_data / "ycbv", frame, kind)
        assert not of_problem(problem).advice, kind
        for factor in factors:
            assert_remedy(of_problem(problem, factor), "focal length", 1 / factor, 1 / factor, rel=0.03)
    for factor, px in ((0.8, -20), (1.2, 20)):
        problem = real(shared_data / "ycbv", frame)
        assert of_problem(with_K(problem, fx=factor)).cause == "one focal length"
        assert of_problem(with_K(problem, fy=factor)).cause == "one focal length"
        assert of_problem(with_K(problem, dx=px)).cause == "principal point"
        assert of_problem(with_K(problem, dy=px)).cause == "principal point"
