"""The score around a pose: known answers, and the noise of the score against resampled depth."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from tests.made_up_frames import CAMERA, Thing, frame_of
from tests.scenes.test_models import model_info
from verefine_viz.core.geometry import axis_angle, transform
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.problem import Target
from verefine_viz.core.settings import ScoreSettings
from verefine_viz.evaluation.depth_noise import DepthNoise, ScoreNoise, depth_noise, resampled
from verefine_viz.evaluation.landscape import N_AXES, Curve, Landscape, axes_of, landscape, score_slice, undetermined
from verefine_viz.observation.normals import estimate_normals
from verefine_viz.rendering.cpu_verifier import CpuVerifier
from verefine_viz.scenes.demo_layout import Viewpoint
from verefine_viz.scenes.demo_models import cuboid, lathe
from verefine_viz.scenes.meshes import Mesh
from verefine_viz.scenes.models import model_of_mesh, symmetry_transforms
from verefine_viz.scenes.sensor import STEREO

CYLINDER = lathe([(0, 0), (0.035, 0), (0.035, 0.1), (0, 0.1)], 96)
BOX = cuboid((0.06, 0.09, 0.12), 0.12)
FRONTAL = Viewpoint(elevation_deg=3, distance_m=0.45)
VERIFIER = CpuVerifier(ScoreSettings(pixels="classes", tau_m=0.02))


def modelled(mesh: Mesh, name: str) -> ObjectModel:
    return model_of_mesh(mesh, 91, name, 1000, 0)


@cache
def target_of(name: str) -> Target:
    """A thing on a table at its ground truth, from which its scores are taken."""
    mesh, view = {"cylinder": (CYLINDER, None), "box": (BOX, None), "frontal box": (BOX, FRONTAL)}[name]
    model = modelled(mesh, name)
    T_world_obj = transform(np.eye(3), [0, 0, -float(model.vertices[:, 2].min())])
    problem = frame_of([Thing(model, T_world_obj)], np.random.default_rng(3), view)
    return problem.targets[0]


@cache
def landscape_of(name: str) -> Landscape:
    target = target_of(name)
    return landscape(VERIFIER, target, target.instance.T_cam_obj_gt)


def curve(around: Landscape, kind: str, letter: str, frame: str = "object") -> Curve:
    return next(c for c in around.curves if (c.axis.kind, c.axis.letter, c.axis.frame) == (kind, letter, frame))


def test_a_cylinder_without_texture_is_undetermined_about_its_axis_and_determined_otherwise() -> None:
    around = landscape_of("cylinder")
    turn = curve(around, "turn", "z")
    assert (turn.low, turn.high) == (-180, 180)
    assert around.undetermined_deg == 180
    assert around.undetermined_mm < 1.5
    others = [
        c for c in around.curves if c.axis.kind == "turn" and abs(c.axis.direction_cam @ turn.axis.direction_cam) < 0.5
    ]
    assert len(others) == 4
    assert max(c.width for c in others) < 3
    assert around.least_certain.describe() == "turn about the vertical undetermined within ±180°"


def test_a_declared_axis_of_symmetry_is_undetermined_however_coarse_the_mesh() -> None:
    """Turned by less than the steps in which the symmetry is listed, a prism of twelve sides scores less."""
    twelve_sides = lathe([(0, 0), (0.035, 0), (0.035, 0.1), (0, 0.1)], 12)
    target = target_of("cylinder")
    T = target.instance.T_cam_obj_gt
    info = {"symmetries_continuous": [{"axis": [0, 0, 1], "offset": [0, 0, 0]}]}
    declared = replace(modelled(twelve_sides, "prism"), symmetries=symmetry_transforms(model_info(info), "prism"))
    around = undetermined(VERIFIER, replace(target, model=declared), T)
    turn = curve(around, "turn", "z")
    assert (turn.low, turn.high) == (-180, 180)
    assert (turn.scores == around.score).all()
    assert curve(around, "turn", "x").width < 10


def test_a_box_with_three_faces_in_sight_is_determined() -> None:
    around = landscape_of("box")
    assert around.undetermined_mm < 2
    assert around.undetermined_deg < 3


def test_the_missing_faces_of_a_box_seen_frontally_leave_its_depth_free() -> None:
    """One face in sight and no outline: where the mask ends nothing is observed, so that the box may slide and grow."""
    target = target_of("frontal box")
    T = target.instance.T_cam_obj_gt
    # Only a part of the front face is in the mask, and nothing was measured around it.
    v, u = np.nonzero(target.instance.mask)
    part = np.zeros_like(target.instance.mask)
    middle_v, middle_u = int(np.median(v)), int(np.median(u))
    part[middle_v - 12 : middle_v + 12, middle_u - 12 : middle_u + 12] = True
    depth_m = np.where(part, target.observation.depth_m, np.float32(0))
    seen = replace(target.observation, depth_m=depth_m, normals_cam=estimate_normals(depth_m, CAMERA), object_mask=part)
    blind = Target(seen, replace(target.instance, mask=part), target.model)
    around = landscape(VERIFIER, blind, T)
    whole = landscape_of("frontal box")
    # Across the face the box can slide; along the line of sight it cannot.
    assert curve(around, "shift", "x").width > 3 * curve(whole, "shift", "x").width
    assert curve(around, "shift", "x").width > 5
    assert curve(around, "shift", "y").width < 2
    assert curve(around, "turn", "z").width < 5


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


def test_a_batch_has_the_same_widths_as_the_page_bit_for_bit() -> None:
    target = target_of("box")
    T = target.instance.T_cam_obj_gt
    page, batch = landscape_of("box"), undetermined(CpuVerifier(VERIFIER.settings), target, T)
    assert [(c.low, c.high) for c in page.curves] == [(c.low, c.high) for c in batch.curves]
    assert (page.undetermined_mm, page.undetermined_deg) == (batch.undetermined_mm, batch.undetermined_deg)
    assert sum(len(c.offsets) for c in batch.curves) < sum(len(c.offsets) for c in page.curves) / 2


def test_curves_go_through_the_score_of_the_pose_and_fall_off() -> None:
    around = landscape_of("box")
    for c in around.curves:
        assert c.scores[np.flatnonzero(c.offsets == 0)[0]] == around.score
        assert c.scores[0] < around.score > c.scores[-1]
        assert c.low <= 0 <= c.high


def test_a_slice_holds_the_scores_of_its_poses() -> None:
    target, around = target_of("box"), landscape_of("box")
    axes = [c.axis.words for c in around.curves]
    across, up = axes.index("turn about the vertical"), axes.index("shift right")
    two = score_slice(VERIFIER, target, around, across, up)
    n = len(two.across_offsets)
    assert two.scores.shape == (n, n)
    assert two.scores[n // 2, n // 2] == pytest.approx(around.score)
    pose = two.pose(around.T_cam_obj, 2, 9)
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
