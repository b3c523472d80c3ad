"""Mistakes are named without ground truth, by what initial poses of an estimator have in common."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.calibration.right_variants import estimated, off, only
from tests.calibration.sizes import real, scene, with_focal
from tests.calibration.test_consistency import with_depth
from verefine_viz.calibration.consistency import data_doubts
from verefine_viz.core.arrays import Float
from verefine_viz.core.camera import Camera
from verefine_viz.core.doubt import DoubtKind, texts_of
from verefine_viz.core.geometry import transform
from verefine_viz.core.problem import Instance, Problem

CLUTTER = scene("clutter", "0/0")


def blind(problem: Problem, deg: float = 3, mm: float = 3) -> Problem:
    return estimated(problem, off(np.random.default_rng(0), deg, mm))


def said(problem: Problem) -> str:
    return "; ".join(texts_of(data_doubts(problem)))


@pytest.mark.parametrize(
    ("times", "words"),
    [
        (1.25, "about 0.80 times as much would fit"),
        (0.8, "about 1.25 times as much would fit"),
        (4.0, "RealSense L515"),
        (5.0, "TUM"),
        (39.37, "metres and inches"),
        (10.0, "depth that is 10 times smaller would fit"),
    ],
)
def test_depth_of_another_scale_is_named_with_its_factor_in_a_frame_and_for_one_object(times: float, words: str):
    assert words in said(blind(with_depth(CLUTTER, times)))
    assert words in said(blind(with_depth(only(1)(CLUTTER, np.random.default_rng(0)), times)))


def with_camera(problem: Problem, camera: Camera) -> Problem:
    return replace(problem, observation=replace(problem.observation, camera=camera))


def test_a_camera_of_other_images_is_named() -> None:
    right = CLUTTER.observation.camera
    assert "fx and fy of cam_K look too small" in said(blind(with_camera(CLUTTER, with_focal(right, 0.63))))
    for factor in (0.5, 2.0):
        other = Camera(np.diag([factor, factor, 1]) @ right.K, right.width, right.height)
        assert "images of another size" in said(blind(with_camera(CLUTTER, other))), factor


def test_transposed_rotations_are_named() -> None:
    def transposed(T: Float) -> Float:
        return transform(T[:3, :3].T, T[:3, 3])

    disturb = off(np.random.default_rng(0), 3, 3)
    assert "transposed rotations would fit" in said(estimated(CLUTTER, lambda T: transposed(disturb(T))))


def with_masks(problem: Problem, change: Callable[[Instance], Instance]) -> Problem:
    return replace(problem, instances=tuple(map(change, problem.instances)))


def test_masks_of_everything_are_looked_at_before_meshes() -> None:
    whole = with_masks(CLUTTER, lambda i: replace(i, mask=np.ones_like(i.mask)))
    assert "of the image" in said(blind(whole))
    assert "models" not in said(blind(whole))
    everything = np.any([i.mask for i in CLUTTER.instances], axis=0)
    labels = with_masks(CLUTTER, lambda i: replace(i, mask=everything))
    assert "several objects (labels)" in said(blind(labels))
    assert "models" not in said(blind(labels))


def test_poses_that_nothing_explains_are_doubted_together_and_not_alone() -> None:
    away = estimated(CLUTTER, off(np.random.default_rng(0), 90, 500))
    assert "do not agree: 0 of 5 objects lie where depth is" in said(away)
    assert said(only(1)(away, np.random.default_rng(0))) == ""


def test_one_object_that_others_hide_shows_a_factor_of_depth_and_not_of_a_pose(shared_data: Path) -> None:
    hidden = blind(only(1)(real(shared_data / "ycbv", "50/1"), np.random.default_rng(0)))
    for factor in (0.8, 1.25, 39.37):
        (doubt,) = data_doubts(with_depth(hidden, factor))
        assert doubt.remedy is not None
        assert doubt.remedy.depth_times == pytest.approx(1 / factor, rel=0.03)
    (one,) = hidden.instances
    T = one.hypotheses[0].T_cam_obj
    farther = transform(T[:3, :3], 1.25 * T[:3, 3])
    assert data_doubts(hidden) == ()
    assert data_doubts(estimated(hidden, lambda _: farther)) == ()


def test_a_camera_is_named_where_few_outlines_are_sure_and_a_mask_of_several_objects_at_one(shared_data: Path) -> None:
    frame = real(shared_data / "ycbv", "50/1")
    camera = with_focal(frame.observation.camera, 0.63)
    (doubt,) = data_doubts(blind(with_camera(frame, camera)))
    assert doubt.remedy is not None
    assert doubt.remedy.camera_times[:2] == pytest.approx((1 / 0.63, 1 / 0.63), rel=0.03)
    frame = real(shared_data / "ycbv", "49/2365")
    everything = np.any([i.mask for i in frame.instances], axis=0)
    alone = only(1)(frame, np.random.default_rng(0))
    (doubt,) = data_doubts(blind(with_masks(alone, lambda i: replace(i, mask=everything))))
    assert doubt.kind == DoubtKind.MASK
    assert data_doubts(blind(alone)) == ()
