"""Features, tables, clusters and agreement by themselves."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from tests.estimators.views import random_pose, view
from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import angle_between, apply, axis_angle, transform
from verefine_viz.estimators.clouds import Oriented, model_surface, segment_surface, thinned_surface
from verefine_viz.estimators.ppf import SamePose, clustered, distinct
from verefine_viz.estimators.ppf_agreement import agreement, surface_field
from verefine_viz.estimators.ppf_model import local_rotation, pair_feature, pair_table, pose_of_match, turn_about_normal
from verefine_viz.scenes.demo_models import demo_model

seeds = st.integers(0, 10**6)


def unit(rng: np.random.Generator) -> Float:
    v = rng.normal(size=3)
    return v / np.linalg.norm(v)


def motion(rng: np.random.Generator) -> Float:
    return transform(axis_angle(unit(rng), rng.uniform(0, np.pi)), rng.normal(size=3))


def pair(rng: np.random.Generator) -> tuple[Float, Float, Float, Float]:
    return 0.1 * rng.normal(size=3), unit(rng), 0.1 * rng.normal(size=3), unit(rng)


@given(seeds)
def test_a_rigid_motion_leaves_the_feature_as_it_is(seed: int) -> None:
    rng = np.random.default_rng(seed)
    p, n, q, m = pair(rng)
    T = motion(rng)
    R = T[:3, :3]
    moved = pair_feature(R @ p + T[:3, 3], R @ n, R @ q + T[:3, 3], R @ m)
    assert np.allclose(pair_feature(p, n, q, m), moved, atol=1e-6)


@given(seeds)
def test_a_pair_and_its_moved_copy_give_the_motion(seed: int) -> None:
    rng = np.random.default_rng(seed)
    p, n, q, _ = pair(rng)
    T = motion(rng)
    p_cam, q_cam, n_cam = apply(T, p), apply(T, q), T[:3, :3] @ n
    on_obj, on_cam = local_rotation(n), local_rotation(n_cam)
    turn = turn_about_normal(on_cam, p_cam, q_cam) - turn_about_normal(on_obj, p, q)
    assert np.allclose(pose_of_match(p_cam, on_cam, p, on_obj, turn), T, atol=1e-6)


@given(seeds)
def test_the_local_rotation_turns_the_normal_onto_x(seed: int) -> None:
    n = unit(np.random.default_rng(seed))
    R = local_rotation(n)
    assert np.allclose(R @ n, [1, 0, 0], atol=1e-9)
    assert np.allclose(R @ R.T, np.eye(3), atol=1e-9)
    assert np.linalg.det(R) > 0


def test_the_local_rotation_has_no_singular_direction() -> None:
    for z in (-1.0, 1.0):
        assert np.allclose(local_rotation(np.array([0, 0, z])) @ [0, 0, z], [1, 0, 0]), z


def test_both_sides_of_a_thin_wall_stay() -> None:
    rng = np.random.default_rng(0)
    front = np.c_[rng.uniform(0, 0.1, (4000, 2)), np.zeros(4000)]
    up = np.tile([0.0, 0.0, 1.0], (4000, 1))
    wall = thinned_surface(Oriented(np.r_[front, front - [0, 0, 0.001]], np.r_[up, -up]), 0.02)
    assert np.isclose(np.linalg.norm(wall.normals, axis=1), 1).all()
    assert (wall.normals[:, 2] > 0).sum() == (wall.normals[:, 2] < 0).sum() == 25
    assert np.allclose(wall.points[wall.normals[:, 2] > 0, 2], 0)


def test_model_normals_point_outwards() -> None:
    surface = model_surface(demo_model("block", 10, 0), 0)
    assert (np.einsum("ij,ij->i", surface.points, surface.normals) > 0).all()


def test_segment_normals_point_to_the_camera_and_points_lie_on_the_object() -> None:
    model = demo_model("duck", 10, 0)
    T = random_pose(0, model)
    segment = segment_surface(view(model, T, noise_m=0.0))
    assert (np.einsum("ij,ij->i", segment.points, segment.normals) < 0).all()
    surface = model_surface(model, 0).points
    gap = np.linalg.norm(segment.points[::50, None] - apply(T, surface)[None], axis=2).min(axis=1)
    assert gap.max() < 0.02 * model.diameter_m


def test_a_limited_table_stands_for_all_pairs() -> None:
    model = demo_model("block", 10, 0)
    cloud = thinned_surface(model_surface(model, 0), 0.1 * model.diameter_m)
    for limit in (7, 10**9):
        table = pair_table(cloud, 0.05 * model.diameter_m, np.deg2rad(12), limit)
        kept = np.diff(table.starts)
        assert kept.max() <= limit, limit
        assert np.isclose((kept * table.weights).sum(), len(cloud.points) * (len(cloud.points) - 1)), limit
        everything = pair_table(cloud, 0.05 * model.diameter_m, np.deg2rad(12), 10**9)
        assert np.array_equal(kept > 0, np.diff(everything.starts) > 0), limit


def round_about_y() -> Float:
    return np.stack([transform(axis_angle([0, 1, 0], a), [0, 0, 0]) for a in np.arange(36) * np.pi / 18])


@given(seeds)
def test_poses_that_look_the_same_are_one_cluster(seed: int) -> None:
    rng = np.random.default_rng(seed)
    T = motion(rng)
    symmetries = round_about_y()
    turned = T @ symmetries[rng.choice(len(symmetries), 5)]
    poses, votes = clustered(turned, np.arange(1.0, 6.0), SamePose(symmetries, np.array([0.0, 0.3, 0.0]), 0.01, 0.2))
    assert votes.tolist() == [15.0]
    assert min(angle_between(poses[0, :3, :3], R) for R in (T @ symmetries)[:, :3, :3]) < 1e-6
    assert np.allclose(poses[0, :3, 3], T[:3, 3])


@given(seeds)
def test_every_vote_is_kept_and_clusters_come_in_order(seed: int) -> None:
    rng = np.random.default_rng(seed)
    Ts = np.stack([motion(rng) for _ in range(12)])
    votes = rng.uniform(1, 2, 12)
    nearness = SamePose(np.eye(4)[None], np.zeros(3), 0.5, 1.0)
    poses, sums = clustered(Ts, votes, nearness)
    assert np.isclose(sums.sum(), votes.sum())
    assert (np.diff(sums) <= 0).all()
    chosen = distinct(poses, 4, nearness)
    assert chosen[0] == 0
    assert len(chosen) <= 4


def test_the_true_pose_agrees_best_with_the_depth_image() -> None:
    model = demo_model("jug", 10, 0)
    T = random_pose(3, model)
    target = view(model, T)
    d = model.diameter_m
    surface = model_surface(model, 0)
    segment = thinned_surface(segment_surface(target), 0.05 * d)
    shifts = [[0, 0, 0], [0.2, 0, 0], [0, -0.2, 0], [0, 0, 0.2], [0, 0, -0.2], [9, 0, 0]]
    poses = np.stack([transform(T[:3, :3], T[:3, 3] + d * np.array(s)) for s in shifts])
    flipped = T @ transform(axis_angle([1, 0, 0], np.pi), [0, 0, 0])
    poses = np.concatenate([poses, flipped[None], transform(T[:3, :3], -T[:3, 3])[None]])
    agree = agreement(
        target, thinned_surface(surface, 0.05 * d), surface_field(surface.points, d), segment, poses, 0.03 * d
    )
    assert agree[0] > 0.7
    assert (agree[1:] < 0.75 * agree[0]).all()
    assert (agree >= 0).all()
    assert agree[5] == agree[7] == 0  # out of the picture, and behind the camera
