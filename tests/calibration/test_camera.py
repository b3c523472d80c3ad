"""One wrong focal length, and a wrong principal point, are told from how objects lie over their models."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.calibration.sizes import fitting, objects, of_problem, real, scene, verdict
from tests.calibration.test_sizes import REAL
from verefine_viz.calibration.camera_check import CameraVerdict
from verefine_viz.core.camera import Camera
from verefine_viz.core.problem import Problem


def with_camera(problem: Problem, fx: float = 1.0, fy: float = 1.0, dx: float = 0.0, dy: float = 0.0) -> Problem:
    """With focal lengths multiplied, and the principal point moved [px]."""
    seen = problem.observation
    K = seen.camera.K * [[fx, 1, 1], [1, fy, 1], [1, 1, 1]] + [[0, 0, dx], [0, 0, dy], [0, 0, 0]]
    return replace(problem, observation=replace(seen, camera=Camera(K, seen.camera.width, seen.camera.height)))


def test_one_wrong_focal_length_is_named_with_its_factor() -> None:
    for factor in (0.75, 0.88, 1.12, 1.3):
        size, off = ("wider", "small") if factor < 1 else ("narrower", "large")
        said = of_problem(with_camera(scene(), fx=factor))
        assert said.cause == "one focal length", factor
        assert f"{size} than their models" in said.message, factor
        assert said.advice.startswith(f"fx of cam_K looks too {off}, "), factor
        assert fitting(said) == pytest.approx(1 / factor, rel=0.02), factor
        assert "fy" not in said.advice, factor
        said = of_problem(with_camera(scene(), fy=factor))
        assert said.advice.startswith(f"fy of cam_K looks too {off}, "), factor
        assert fitting(said) == pytest.approx(1 / factor, rel=0.02), factor
        assert "fx" not in said.advice, factor


def test_focal_lengths_that_are_off_by_different_factors_are_both_named() -> None:
    said = of_problem(with_camera(scene(), fx=1.25, fy=0.85))
    assert "narrower and" in said.message
    assert "fx of cam_K looks too large, about 0.80" in said.advice
    assert "fy of cam_K looks too small, about 1.18" in said.advice


def test_a_wrong_principal_point_is_named_with_its_pixels() -> None:
    for dx, dy, found, advice in (
        (40, 0, "objects lie 40 px left of where their models are", "cx of cam_K looks 40 px too large;"),
        (0, -15, "objects lie 15 px below where their models are", "cy of cam_K looks 15 px too small;"),
        (
            -30,
            40,
            "30 px right of and 40 px above where",
            "cx of cam_K looks 30 px too small and cy of",
        ),
    ):
        said = of_problem(with_camera(scene(), dx=dx, dy=dy))
        assert said.cause == "principal point", (dx, dy)
        assert found in said.message, (dx, dy)
        assert advice in said.advice, (dx, dy)


def test_masks_that_are_all_displaced_are_reported_from_a_wrong_principal_point() -> None:
    seen = scene().observation
    displaced = [(model, T, np.roll(mask, (8, -30), axis=(0, 1))) for model, T, mask in objects(scene())]
    said = verdict(displaced, seen.camera, seen.depth_m)
    assert said.cause == "masks"
    assert said.message.endswith("but depth does not")
    assert "the masks are displaced" in said.advice


def test_a_single_object_tells_neither() -> None:
    alone = scene().only([scene().instances[0].instance_id])
    assert not of_problem(with_camera(alone, dx=40)).advice
    assert of_problem(with_camera(alone, fx=1.2)).cause != "one focal length"


def test_objects_that_lie_beside_their_models_each_another_way_say_nothing_of_the_camera() -> None:
    seen = scene().observation
    ways = [(0, 30), (0, -30), (30, 0), (-30, 0), (20, 20), (-20, -20)]
    beside = [(m, T, np.roll(mask, way, axis=(0, 1))) for (m, T, mask), way in zip(objects(scene()), ways, strict=True)]
    assert verdict(beside, seen.camera, seen.depth_m) == CameraVerdict(
        "objects appear as large as their models in their ground-truth poses"
    )


@pytest.mark.parametrize("frame", REAL)
def test_real_frames_tell_both(shared_data: Path, frame: str) -> None:
    problem = real(shared_data / "ycbv", frame)
    for factor, px in ((0.8, -20), (1.2, 20)):
        assert of_problem(with_camera(problem, fx=factor)).advice.startswith("fx of cam_K looks too")
        assert of_problem(with_camera(problem, fy=factor)).advice.startswith("fy of cam_K looks too")
        assert of_problem(with_camera(problem, dx=px)).advice.startswith("cx of cam_K looks ")
        assert of_problem(with_camera(problem, dy=px)).advice.startswith("cy of cam_K looks ")
