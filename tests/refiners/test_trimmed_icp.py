import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec import structs
from scipy.spatial import cKDTree

from tests.fakes import box_model, box_problem
from tests.refiners.alignment import trimmed_align
from tests.refiners.test_icp import assert_rigid, lumpy_cloud, moved, small_motion
from verefine_viz.core.algorithm_settings import TricpSettings
from verefine_viz.core.geometry import angle_between, apply, axis_angle, inverse, random_unit_vector, transform
from verefine_viz.core.problem import Placed, Target
from verefine_viz.refiners.nearest import Leaves, nearest_from_afar
from verefine_viz.refiners.trimmed_icp import TrimmedIcp, trimmed_loop

SEEDS = st.integers(0, 2**32 - 1)
TRIMS = st.sampled_from([1.0, 0.9, 0.5])
MANY = TricpSettings(energy_ratio=0.999999, max_passes=500)
FAR = np.array([1.0, 0.0, 0.0])


def with_trim(trim: float) -> TricpSettings:
    return structs.replace(MANY, trim=trim)


# The clouds -----------------------------------------------------------------------------------------------------------


def test_equals_pcl(shared_data: Path) -> None:
    golden = json.loads((shared_data / "golden" / "icp_pcl.json").read_text())
    for trim in ("1", "0.9", "0.5"):
        result = trimmed_align(np.array(golden["obs"]), np.array(golden["model"]), TricpSettings(trim=float(trim)))
        assert np.abs(result.T_target_source - golden["tricp"][trim]).max() < 1e-5, trim
        assert result.n_matches == int(float(trim) * len(golden["obs"])), trim


@given(seed=SEEDS, trim=TRIMS)
@settings(max_examples=15)
def test_recovers_a_known_motion(seed: int, trim: float) -> None:
    rng = np.random.default_rng(seed)
    cloud = lumpy_cloud(rng)
    T = small_motion(rng, 4, 0.003)
    result = trimmed_align(apply(inverse(T), cloud[::2]), cloud, with_trim(trim))
    assert np.abs(result.T_target_source - T).max() < 1e-6
    assert result.rms_m < 1e-6


@given(seed=SEEDS, away_m=st.sampled_from([0.0, 0.3, 1.0]))
@settings(max_examples=15)
def test_one_pass_fits_the_points_to_their_nearest_ones_however_far(seed: int, away_m: float) -> None:
    rng = np.random.default_rng(seed)
    cloud = lumpy_cloud(rng)
    source = apply(small_motion(rng, 10, 0.01), cloud[::2]) + away_m * FAR
    result = trimmed_align(source, cloud, TricpSettings(trim=1.0, max_passes=1))
    matched = cloud[cKDTree(cloud).query(source)[1]]
    a, b = source - source.mean(axis=0), matched - matched.mean(axis=0)
    U, _, Vt = np.linalg.svd(b.T @ a)
    R = U @ np.diag([1.0, 1.0, np.sign(np.linalg.det(U @ Vt))]) @ Vt
    expected = transform(R, matched.mean(axis=0) - R @ source.mean(axis=0))
    assert np.abs(result.T_target_source - expected).max() < 1e-9


@given(seed=SEEDS)
@settings(max_examples=10)
def test_trimming_bears_outliers_and_using_all_points_does_not(seed: int) -> None:
    """A fifth of the observed points belongs to something else, 60 mm beside the object."""
    rng = np.random.default_rng(seed)
    cloud = lumpy_cloud(rng)
    T = small_motion(rng, 4, 0.003)
    source = np.vstack([cloud[::2], lumpy_cloud(rng, 62) * 0.3 + random_unit_vector(rng) * 0.14])
    source = apply(inverse(T), source)
    trimmed = trimmed_align(source, cloud, with_trim(0.75)).T_target_source
    everything = trimmed_align(source, cloud, with_trim(1.0)).T_target_source
    assert np.abs(trimmed - T).max() < 1e-6
    assert np.linalg.norm(everything[:3, 3] - T[:3, 3]) > 0.005


@given(seed=SEEDS, trim=st.floats(0.05, 1.0), passes=st.integers(1, 20))
@settings(max_examples=20)
def test_equals_the_loop_written_with_a_kd_tree(seed: int, trim: float, passes: int) -> None:
    rng = np.random.default_rng(seed)
    cloud = lumpy_cloud(rng, 300)
    source = apply(small_motion(rng, 40, 0.05), cloud[::3]) + rng.normal(0, 0.001, (100, 3))
    n_used = int(trim * 100)
    T, energy, n_passes = np.eye(4), np.inf, 0
    while n_passes < passes:
        n_passes += 1
        distance, match = cKDTree(cloud).query(apply(T, source))
        used = np.argsort(distance, kind="stable")[:n_used]
        a, b = source[used], cloud[match[used]]
        U, _, Vt = np.linalg.svd((b - b.mean(0)).T @ (a - a.mean(0)))
        R = U @ np.diag([1, 1, np.linalg.det(U @ Vt)]) @ Vt
        T, previous, energy = transform(R, b.mean(0) - R @ a.mean(0)), energy, float((distance[used] ** 2).sum())
        if not energy < 0.99 * previous:
            break
    result = trimmed_align(source, cloud, TricpSettings(trim=trim, max_passes=passes))
    assert result.n_iterations == n_passes
    assert result.n_matches == n_used
    assert np.abs(result.T_target_source - T).max() < 1e-9
    assert result.rms_m == pytest.approx(np.sqrt(energy / n_used), rel=1e-9)


@given(seed=SEEDS, trim=st.floats(0.01, 1.0), spread_m=st.sampled_from([0.0, 0.05, 5.0]))
@settings(max_examples=25)
def test_result_is_rigid_whatever_the_clouds(seed: int, trim: float, spread_m: float) -> None:
    rng = np.random.default_rng(seed)
    source = rng.normal(size=(int(rng.integers(0, 60)), 3)) * spread_m
    target = rng.normal(size=(int(rng.integers(0, 60)), 3)) * 0.05 + rng.normal(size=3)
    result = trimmed_align(source, target, TricpSettings(trim=trim))
    assert_rigid(result.T_target_source)
    assert result.n_iterations <= 50


@given(seed=SEEDS, trim=TRIMS)
@settings(max_examples=10)
def test_moving_both_clouds_moves_the_result_along(seed: int, trim: float) -> None:
    rng = np.random.default_rng(seed)
    cloud = lumpy_cloud(rng)
    source = apply(small_motion(rng, 10, 0.01), cloud[::4])
    result = trimmed_align(source, cloud, TricpSettings(trim=trim)).T_target_source
    T = transform(axis_angle(random_unit_vector(rng), rng.uniform(0, np.pi)), rng.normal(size=3))
    result_T = trimmed_align(apply(T, source), apply(T, cloud), TricpSettings(trim=trim)).T_target_source
    assert np.allclose(result_T, T @ result @ inverse(T), atol=1e-7)


@given(seed=SEEDS, shift_m=st.sampled_from([0.5, 20.0]))
@settings(max_examples=10)
def test_a_far_start_comes_near_at_once(seed: int, shift_m: float) -> None:
    rng = np.random.default_rng(seed)
    cloud = lumpy_cloud(rng)
    source = apply(small_motion(rng, 20, shift_m), cloud[::2])
    result = trimmed_align(source, cloud, TricpSettings())
    moved_centre = apply(result.T_target_source, source).mean(0)
    assert np.linalg.norm(moved_centre - cloud.mean(0)) < 0.03


def test_stays_where_the_clouds_already_agree() -> None:
    model = box_model()
    result = trimmed_align(model.points[::4], model.points, TricpSettings())
    assert np.abs(result.T_target_source - np.eye(4)).max() < 1e-12
    assert result.n_iterations == 2


@given(seed=SEEDS, n=st.integers(1, 300), distance_m=st.sampled_from([0.0, 0.1, 3.0]))
@settings(max_examples=25)
def test_leaves_find_the_neighbours_that_a_kd_tree_finds(seed: int, n: int, distance_m: float) -> None:
    rng = np.random.default_rng(seed)
    cloud = lumpy_cloud(rng, n)
    leaves = Leaves.build(cloud)
    for query in rng.normal(0, 0.05, (20, 3)) + distance_m * FAR:
        distance, expected = cKDTree(cloud).query(query)
        found, squared = nearest_from_afar(*query, leaves)
        assert found == expected
        assert squared == pytest.approx(distance**2, rel=1e-9)


def test_leaves_take_the_first_of_equal_points() -> None:
    leaves = Leaves.build(np.tile([[0.0, 0, 0], [0, 1, 0]], (100, 1)))
    assert nearest_from_afar(5.0, 0.5, 0.0, leaves)[0] == 0
    assert nearest_from_afar(5.0, 2.0, 0.0, leaves)[0] == 1


# The refiner ----------------------------------------------------------------------------------------------------------


@given(seed=SEEDS)
@settings(max_examples=10)
def test_brings_a_pose_back_to_the_true_one(seed: int) -> None:
    rng = np.random.default_rng(seed)
    T_true = transform(axis_angle(random_unit_vector(rng), rng.uniform(0, np.pi)), [0.05, -0.02, 0.7])
    target = moved(box_problem().targets[0], T_true)
    T = TrimmedIcp(MANY).refine(target, T_true @ small_motion(rng, 3, 0.002))
    assert_rigid(T)
    assert angle_between(T[:3, :3], T_true[:3, :3]) < np.deg2rad(0.3)
    assert np.linalg.norm(T[:3, 3] - T_true[:3, 3]) < 3e-4


def test_same_as_moving_the_model_in_the_camera_frame() -> None:
    """docs/methods.md 4.2 as written: source = observed cloud, target = model at T, new pose = G⁻¹ T."""
    target = box_problem().targets[0]
    T = target.instance.hypotheses[2].T_cam_obj
    for trim in (1.0, 0.6):
        setting = TricpSettings(trim=trim)
        G = trimmed_align(target.instance.points_cam, apply(T, target.model.points), setting).T_target_source
        assert np.abs(TrimmedIcp(setting).refine(target, T) - inverse(G) @ T).max() < 1e-9


def shared_cloud(rng: np.random.Generator) -> tuple[Target, Placed, np.ndarray]:
    """A target whose segment also holds half of a neighbour's points, the neighbour, and the ground truth."""
    target = box_problem().targets[0]
    T_true, T_other = transform(np.eye(3), [0, 0, 0.7]), transform(np.eye(3), [0.12, 0, 0.7])
    own = apply(T_true, target.model.points[::3])
    foreign = apply(T_other, target.model.points[::2]) + rng.normal(0, 0.0005, (300, 3))
    instance = replace(target.instance, points_cam=np.vstack([own, foreign]))
    return replace(target, instance=instance), Placed(7, box_model(), T_other), T_true


def test_what_placed_objects_explain_does_not_pull() -> None:
    rng = np.random.default_rng(4)
    target, neighbour, T_true = shared_cloud(rng)
    start = T_true @ small_motion(rng, 3, 0.002)
    alone = TrimmedIcp(MANY).refine(target, start)
    beside = TrimmedIcp(MANY).refine(target, start, (neighbour,))
    kept_all = TrimmedIcp(structs.replace(MANY, explained_m=0.0)).refine(target, start, (neighbour,))
    assert np.linalg.norm(alone[:3, 3] - T_true[:3, 3]) > 0.02
    assert np.linalg.norm(beside[:3, 3] - T_true[:3, 3]) < 5e-4
    assert np.array_equal(kept_all, alone)


@given(seed=SEEDS)
@settings(max_examples=15)
def test_explained_points_are_those_within_reach_of_any_placed_object(seed: int) -> None:
    rng = np.random.default_rng(seed)
    T_cam_a, T_cam_b = (small_motion(rng, 90, 0.08) for _ in range(2))
    points = rng.normal(0, 0.1, (300, 3))
    fixed = (Placed(1, box_model(1), T_cam_a), Placed(2, box_model(2), T_cam_b))
    refiner = TrimmedIcp(TricpSettings(explained_m=0.02))
    surfaces = np.vstack([apply(p.T_cam_obj, p.model.points) for p in fixed])
    expected = points[cKDTree(surfaces).query(points)[0] > 0.02]
    assert np.array_equal(refiner.unexplained(points, fixed), expected)
    assert np.array_equal(refiner.unexplained(points, fixed[::-1]), expected)
    assert np.array_equal(refiner.unexplained(points, ()), points)


def test_nothing_left_to_explain_leaves_the_pose_as_it_is() -> None:
    target = box_problem().targets[0]
    T = target.instance.hypotheses[0].T_cam_obj
    twin = Placed(5, target.model, T)
    seen = moved(target, T)
    assert np.array_equal(TrimmedIcp(TricpSettings()).refine(seen, T, (twin,)), T)


def test_too_few_points_leave_the_pose_as_it_is() -> None:
    target = box_problem().targets[0]
    T = target.instance.hypotheses[0].T_cam_obj
    for n, trim in ((0, 1.0), (2, 1.0), (5, 0.5)):
        few = replace(target, instance=replace(target.instance, points_cam=target.instance.points_cam[:n]))
        assert np.array_equal(TrimmedIcp(TricpSettings(trim=trim)).refine(few, T), T), (n, trim)


def test_a_model_without_points_leaves_the_pose_as_it_is() -> None:
    target = box_problem().targets[0]
    bare = replace(target.model, points=np.empty((0, 3)), point_normals=np.empty((0, 3)))
    T = target.instance.hypotheses[0].T_cam_obj
    refiner = TrimmedIcp(TricpSettings())
    assert np.array_equal(refiner.refine(replace(target, model=bare), T), T)
    placed = Placed(1, bare, T)
    assert np.array_equal(refiner.refine(target, T, (placed,)), refiner.refine(target, T))


def test_answers_depend_on_the_arguments_only() -> None:
    target, neighbour, T_true = shared_cloud(np.random.default_rng(1))
    start = T_true @ small_motion(np.random.default_rng(2), 10, 0.01)
    used, fresh = TrimmedIcp(TricpSettings(trim=0.9)), TrimmedIcp(TricpSettings(trim=0.9))
    first = used.refine(target, start, (neighbour,))
    used.refine(target, start)
    used.refine(moved(target, T_true), T_true)
    assert np.array_equal(used.refine(target, start, (neighbour,)), first)
    assert np.array_equal(fresh.refine(target, start, (neighbour,)), first)


def test_compiles_once_for_all_kinds_of_input() -> None:
    target = box_problem().targets[0]
    T = target.instance.hypotheses[0].T_cam_obj
    TrimmedIcp(TricpSettings()).refine(target, T, (Placed(3, target.model, T @ transform(np.eye(3), [1, 0, 0])),))
    TrimmedIcp(TricpSettings(trim=0.5)).refine(target, np.array(T))
    trimmed_align(np.zeros((5, 3)), np.asfortranarray(np.eye(3)), TricpSettings())
    assert len(trimmed_loop.signatures) == 1
