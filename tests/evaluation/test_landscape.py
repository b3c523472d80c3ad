"""The score around a pose, and the noise of the score against resampled depth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.evaluation.test_allowed_poses import VERIFIER, allowed_of, target_of
from tests.made_up_frames import CAMERA
from verefine_viz.core.geometry import axis_angle, transform
from verefine_viz.core.problem import Target
from verefine_viz.evaluation.depth_noise import DepthNoise, ScoreNoise, depth_noise, resampled
from verefine_viz.evaluation.landscape import landscape, score_slice
from verefine_viz.evaluation.pose_axes import N_AXES, axes_of
from verefine_viz.observation.normals import estimate_normals
from verefine_viz.scenes.sensor import STEREO


def test_the_noise_of_a_made_up_sensor_is_measured_in_the_frame() -> None:
    noise = depth_noise(target_of("box").observation)
    made = STEREO.noise_px / (CAMERA.fx * STEREO.baseline_m)
    assert noise.per_m == pytest.approx(made, rel=0.25)
    assert noise.grain_px == pytest.approx(STEREO.noise_grain_px, abs=0.4)
    assert noise.at_m(0.5) == pytest.approx(noise.per_m * 0.25)


def test_noise_as_it_was_measured_is_measured_again() -> None:
    flat = np.full((240, 320), 0.7, np.float32)
    for given in (DepthNoise(1e-3, 0.0), DepthNoise(2e-3, 1.5)):
        drawn = resampled(flat, given, np.random.default_rng(1))
        frame = replace(target_of("box").observation, depth_m=drawn)
        measured = depth_noise(frame)
        assert measured.per_m == pytest.approx(given.per_m, rel=0.1)
        assert measured.grain_px == pytest.approx(given.grain_px, abs=0.3)


@pytest.mark.parametrize("name", ["cylinder", "box"])
def test_the_noise_of_a_difference_is_that_of_resampled_images(name: str) -> None:
    target = target_of(name)
    T, frame = target.instance.T_cam_obj_gt, target.observation
    poses = [a.moved(T, s * x) for a in axes_of(target, T)[:6] for x in (1.5, 4.0) for s in (-1, 1)]
    rng, noise = np.random.default_rng(7), depth_noise(frame)
    differences = []
    for _ in range(25):
        depth_m = resampled(frame.depth_m, noise, rng)
        drawn = replace(frame, depth_m=depth_m, normals_cam=estimate_normals(depth_m, CAMERA))
        scores = VERIFIER.score(Target(drawn, target.instance, target.model), np.array([T, *poses])).score
        differences.append(scores[1:] - scores[0])
    resampled_std = np.std(differences, axis=0, ddof=1)
    score_noise = ScoreNoise(VERIFIER, target, T)
    n_pixels = VERIFIER.score(target, np.array(poses)).n_pixels
    linear = np.array([score_noise.of_depth(pose, int(n)) for pose, n in zip(poses, n_pixels, strict=True)])
    # Both are known to about 20 %; single poses may differ by more, all together may not.
    ratio = linear / resampled_std
    assert 0.7 < np.median(ratio) < 1.4
    assert ((ratio > 0.33) & (ratio < 3)).mean() > 0.9
    assert linear.max() <= 1.3 * score_noise.most


def test_curves_go_through_the_score_of_the_pose_and_fall_off() -> None:
    around = landscape(VERIFIER, target_of("box"), allowed_of("box"))
    assert len(around.curves) == N_AXES
    for c in around.curves:
        assert c.scores[np.flatnonzero(c.offsets == 0)[0]] == around.score
        assert c.scores[0] < around.score > c.scores[-1]
        assert c.extent.low <= 0 <= c.extent.high


def test_a_slice_holds_the_scores_of_its_poses() -> None:
    target, allowed = target_of("box"), allowed_of("box")
    axes = [c.axis.words for c in allowed.extents]
    across, up = axes.index("turn about the vertical"), axes.index("shift right")
    two = score_slice(VERIFIER, target, allowed, across, up)
    n = len(two.across_offsets)
    assert two.scores.shape == (n, n)
    assert two.scores[n // 2, n // 2] == pytest.approx(allowed.score)
    pose = two.pose(allowed.T_cam_obj, 2, 9)
    assert VERIFIER.score(target, pose[None]).score[0] == two.scores[9, 2]


def test_axes_are_unit_and_at_right_angles_whatever_way_the_camera_is_held() -> None:
    target = target_of("box")
    T, frame = target.instance.T_cam_obj_gt, target.observation
    for roll_deg in (0, 90):
        roll = transform(axis_angle([0, 0, 1], np.deg2rad(roll_deg)), np.zeros(3))
        support = replace(frame.support, T_world_cam=frame.support.T_world_cam @ roll)
        axes = axes_of(replace(target, observation=replace(frame, support=support)), T)
        assert len(axes) == N_AXES, roll_deg
        for of in (axes[:3], axes[3:6], axes[6:9], axes[9:]):
            D = np.array([axis.direction_cam for axis in of])
            np.testing.assert_allclose(D @ D.T, np.eye(3), atol=1e-9)
        assert axes[2].direction_cam @ (support.T_world_cam[:3, :3].T @ support.normal_world) == pytest.approx(1)
