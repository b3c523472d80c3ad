"""Whether cam_K, models, distances or depth are of another size is told by how large objects appear and where."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.calibration.sizes import Depth, Objects, fitting, objects, of_problem, real, scene, verdict
from verefine_viz.core.camera import Camera
from verefine_viz.core.geometry import transform
from verefine_viz.core.problem import Problem
from verefine_viz.scenes.demo import demo_names

HALF_A_PIXEL = np.array([[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]])


@settings(max_examples=25)
@given(factor=st.one_of(st.floats(0.6, 0.93), st.floats(1.07, 1.6)))
def test_a_wrong_focal_length_is_noticed_with_its_factor(factor: float) -> None:
    said = of_problem(scene(), factor)
    assert said.cause == "focal length"
    assert fitting(said) == pytest.approx(1 / factor, rel=0.02)
    size, away, off = ("larger", "farther from", "small") if factor < 1 else ("smaller", "nearer to", "large")
    assert f" {size} than their models in their ground-truth poses and lie {away} the image's centre" in said.message
    assert said.advice.startswith(f"fx and fy of cam_K look too {off}, about ")


def test_a_camera_of_images_of_another_size_is_reported_from_a_wrong_focal_length() -> None:
    camera = scene().observation.camera
    for factor in (0.5, 0.8, 0.92, 1.08, 1.3, 2.0):
        K = np.diag([factor, factor, 1.0]) @ (camera.K + HALF_A_PIXEL)
        K[:2, 2] -= 0.5
        said = verdict(objects(scene()), Camera(K, camera.width, camera.height), scene().observation.depth_m)
        assert said.cause == "image", factor
        assert fitting(said) == pytest.approx(1 / factor, rel=0.03), factor


def resized(of: Objects, factor: float) -> Objects:
    return [(replace(m, vertices=m.vertices * factor, points=m.points * factor), T, mask) for m, T, mask in of]


def moved_away(of: Objects, factor: float) -> Objects:
    return [(model, transform(T[:3, :3], T[:3, 3] * factor), mask) for model, T, mask in of]


def test_models_distances_and_depth_of_another_size_are_reported_apart() -> None:
    camera, depth_m = scene().observation.camera, scene().observation.depth_m
    for factor in (0.75, 0.88, 1.12, 1.3):
        said = verdict(resized(objects(scene()), factor), camera, depth_m)
        assert said.cause == "models", factor
        assert fitting(said) == pytest.approx(1 / factor, rel=0.03), factor
        assert verdict(moved_away(objects(scene()), factor), camera, depth_m).cause == "distances", factor
        said = verdict(objects(scene()), camera, depth_m * factor)
        assert said.cause == "depth", factor
        assert "check depth_scale" in said.advice, factor
        assert fitting(said) == pytest.approx(1 / factor, rel=0.02), factor


@pytest.mark.parametrize("name", demo_names())
def test_the_right_data_say_nothing(name: str) -> None:
    said = of_problem(scene(name))
    assert not said.advice
    assert said.cause is None


def test_a_lone_object_in_the_middle_tells_no_focal_length_from_a_model() -> None:
    mug = scene("failure_no_hypothesis_near")
    assert of_problem(mug, 0.8).cause == "focal length or models"
    # What masks that are too wide would do as well is not put down to either.
    assert of_problem(mug, 0.95).cause in (None, "masks")
    assert not of_problem(mug, 0.95).advice


def test_one_object_that_is_off_is_no_sign_of_wrong_data() -> None:
    first, *others = objects(scene())
    assert not verdict([*resized([first], 1.3), *others], *seen_by(scene())).advice
    assert verdict([first, *resized(others, 1.3)], *seen_by(scene())).cause == "models"


def seen_by(problem: Problem) -> tuple[Camera, Depth]:
    return problem.observation.camera, problem.observation.depth_m


REAL = ("0/1", "0/5", "49/2365", "50/1", "900/2")


@pytest.mark.parametrize("frame", REAL)
def test_real_frames_are_silent_until_their_focal_length_is_wrong(shared_data: Path, frame: str) -> None:
    for kind, factors in (("mask_visib", (0.7, 0.9, 1.1)), ("mask", (0.9, 1.1, 1.3))):
        problem = real(shared_data / "ycbv", frame, kind)
        assert not of_problem(problem).advice, kind
        for factor in factors:
            said = of_problem(problem, factor)
            assert said.cause == "focal length", (kind, factor)
            assert fitting(said) == pytest.approx(1 / factor, rel=0.03), (kind, factor)
