import json
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import open3d as o3d
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec import structs

from tests.fakes import box_model, box_problem
from tests.refiners.alignment import Cloud, icp_align
from verefine_viz.core.algorithm_settings import IcpSettings
from verefine_viz.core.geometry import angle_between, apply, axis_angle, inverse, random_unit_vector, transform
from verefine_viz.core.presets import PRESETS
from verefine_viz.core.problem import Target
from verefine_viz.refiners.icp import Icp, gate_schedule_m, largest_extent_m, observed_normals
from verefine_viz.refiners.icp_kernel import icp_loop, nearest_rotation

SEEDS = st.integers(0, 2**32 - 1)
PLAIN = IcpSettings(gate="published", matches="all")
MANY = IcpSettings(stop="tolerance", max_iterations=200, matches="all")


def lumpy_cloud(rng: np.random.Generator, n: int = 500) -> np.ndarray:
    """Points on an uneven ellipsoid of about 100 × 160 × 60 mm: no symmetry, no flat side."""
    direction = rng.normal(size=(n, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    bumps = 1 + 0.25 * np.sin(3 * direction[:, 0] + 1) * np.cos(2 * direction[:, 1]) + 0.2 * direction[:, 2]
    return direction * bumps[:, None] * [0.05, 0.08, 0.03]


def small_motion(rng: np.random.Generator, angle_deg: float, shift_m: float) -> np.ndarray:
    return transform(axis_angle(random_unit_vector(rng), np.deg2rad(angle_deg)), random_unit_vector(rng) * shift_m)


def assert_rigid(T: np.ndarray) -> None:
    assert np.allclose(T[:3, :3].T @ T[:3, :3], np.eye(3), atol=1e-12)
    assert np.linalg.det(T[:3, :3]) > 0
    assert np.array_equal(T[3], [0, 0, 0, 1])


def moved(target: Target, T_cam_obj: np.ndarray) -> Target:
    """The same target with an observed cloud that fits ``T_cam_obj``: every third model point."""
    points = apply(T_cam_obj, target.model.points[::3])
    return replace(target, instance=replace(target.instance, points_cam=points, T_cam_obj_gt=T_cam_obj))


# The clouds -----------------------------------------------------------------------------------------------------------


@given(seed=SEEDS)
@settings(max_examples=12, deadline=None)
def test_recovers_a_known_motion(seed: int) -> None:
    rng = np.random.default_rng(seed)
    cloud = lumpy_cloud(rng)
    T = small_motion(rng, 5, 0.004)
    result = icp_align(apply(inverse(T), cloud), cloud, MANY)
    assert np.abs(result.T_target_source - T).max() < 1e-6
    assert_rigid(result.T_target_source)


def test_recovers_a_motion_from_a_part_of_the_surface() -> None:
    rng = np.random.default_rng(5)
    model = box_model()
    seen = model.points[(model.point_normals @ [0.5, 0.6, 0.62]) > 0.1]
    T = small_motion(rng, 4, 0.003)
    for metric in ("point", "plane"):
        stop = IcpSettings(metric=metric, stop="tolerance", max_iterations=300)
        result = icp_align(apply(inverse(T), seen), model.points, stop, target_normals=model.point_normals)
        assert angle_between(result.T_target_source[:3, :3], T[:3, :3]) < np.deg2rad(0.1), metric
        assert np.linalg.norm(result.T_target_source[:3, 3] - T[:3, 3]) < 1e-4, metric


def test_stays_where_the_clouds_already_agree() -> None:
    model = box_model()
    for metric in ("point", "plane"):
        result = icp_align(
            model.points[::4], model.points, IcpSettings(metric=metric), target_normals=model.point_normals
        )
        assert np.abs(result.T_target_source - np.eye(4)).max() < 1e-12, metric
        assert result.rms_m < 1e-12, metric


@given(seed=SEEDS, metric=st.sampled_from(["point", "plane"]), stop=st.sampled_from(["max_iterations", "tolerance"]))
@settings(max_examples=12, deadline=None)
def test_result_is_rigid_whatever_the_clouds(seed: int, metric: str, stop: str) -> None:
    rng = np.random.default_rng(seed)
    source = rng.normal(size=(int(rng.integers(1, 60)), 3)) * 0.05
    target = rng.normal(size=(int(rng.integers(1, 60)), 3)) * 0.05 + rng.normal(size=3) * 0.05
    normals = rng.normal(size=target.shape)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    result = icp_align(source, target, IcpSettings(metric=metric, stop=stop), target_normals=normals)
    assert_rigid(result.T_target_source)


@given(seed=SEEDS, metric=st.sampled_from(["point", "plane"]))
@settings(max_examples=10, deadline=None)
def test_moving_both_clouds_moves_the_result_along(seed: int, metric: str) -> None:
    rng = np.random.default_rng(seed)
    model = box_model()
    source = apply(small_motion(rng, 10, 0.01), model.points[::4])
    steps = IcpSettings(metric=metric, max_iterations=3)
    extent_m = largest_extent_m(source)
    result = icp_align(source, model.points, steps, target_normals=model.point_normals).T_target_source
    T = transform(axis_angle(random_unit_vector(rng), rng.uniform(0, np.pi)), rng.normal(size=3))
    result_T = icp_align(
        apply(T, source),
        apply(T, model.points),
        steps,
        target_normals=model.point_normals @ T[:3, :3].T,
        extent_m=extent_m,
    ).T_target_source
    assert np.allclose(result_T, T @ result @ inverse(T), atol=1e-7)


def test_equals_open3d_iteration_by_iteration() -> None:
    rng = np.random.default_rng(3)
    cloud = lumpy_cloud(rng, 1500)
    source = apply(small_motion(rng, 8, 0.006), cloud[::3]) + rng.normal(0, 0.0005, (500, 3))
    gate_m = 0.1 * largest_extent_m(source)
    clouds = [o3d.geometry.PointCloud(o3d.utility.Vector3dVector(c)) for c in (source, cloud)]
    for n in (1, 2, 5, 10):
        witness = o3d.pipelines.registration.registration_icp(
            *clouds, gate_m, np.eye(4), o3d.pipelines.registration.TransformationEstimationPointToPoint(),
            o3d.pipelines.registration.ICPConvergenceCriteria(0, 0, n),
        )  # fmt: skip
        ours = icp_align(source, cloud, structs.replace(PLAIN, max_iterations=n))
        assert ours.n_iterations == n
        assert np.abs(ours.T_target_source - witness.transformation).max() < 1e-9


def test_equals_pcl(shared_data: Path) -> None:
    golden = json.loads((shared_data / "golden" / "icp_pcl.json").read_text())
    observed = np.array(golden["obs"])
    for case, stop, max_iterations in (
        ("icp_10_eps1", "published", 10),
        ("icp_10_default", "max_iterations", 10),
        ("icp_10_default", "tolerance", 10),
        ("icp_50_default", "tolerance", 50),
    ):
        setting = IcpSettings(stop=stop, max_iterations=max_iterations, gate="published")
        assert gate_schedule_m(largest_extent_m(observed), setting)[0] == pytest.approx(golden["max_corr"], rel=1e-12)
        result = icp_align(observed, np.array(golden["model"]), setting)
        assert result.n_iterations == golden[case]["iters"], (case, stop)
        assert np.abs(result.T_target_source - golden[case]["T"]).max() < 1e-5, (case, stop)


@given(seed=st.integers(0, 2**32 - 1), kind=st.sampled_from(["any", "flat", "mirrored", "a line", "nothing"]))
@settings(max_examples=60)
def test_the_nearest_rotation_is_that_of_the_singular_values(seed: int, kind: str) -> None:
    rng = np.random.default_rng(seed)
    H = rng.normal(size=(3, 3)) * 10.0 ** rng.uniform(-6, 2)
    if kind == "flat":
        H = H @ np.diag([1.0, 1.0, 0.0])
    elif kind == "a line":
        H = np.outer(H[0], H[1])
    elif kind == "nothing":
        H = np.zeros((3, 3))
    elif (np.linalg.det(H) < 0) != (kind == "mirrored"):
        H[0] *= -1.0
    R = nearest_rotation(H.copy())
    assert np.allclose(R @ R.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(R) == pytest.approx(1.0, abs=1e-12)
    U, s, Vt = np.linalg.svd(H)
    best = s[0] + s[1] + s[2] * np.sign(np.linalg.det(U) * np.linalg.det(Vt))
    assert np.trace(R.T @ H) == pytest.approx(best, rel=1e-9, abs=1e-12 * s[0])


def test_same_bits_every_time() -> None:
    rng = np.random.default_rng(8)
    cloud = lumpy_cloud(rng, 2000)
    source = apply(small_motion(rng, 20, 0.02), cloud[::2])
    target = Cloud(cloud)
    results = [icp_align(source, target, IcpSettings()).T_target_source.tobytes() for _ in range(3)]
    icp_align(cloud[::7], target, IcpSettings())
    results.append(icp_align(source, Cloud(cloud), IcpSettings()).T_target_source.tobytes())
    assert len(set(results)) == 1


def test_compiles_once_for_all_kinds_of_input() -> None:
    """Read-only arrays are another type to numba: ten more seconds of waiting for whoever starts the page."""
    target = box_problem().targets[0]
    T = target.instance.hypotheses[0].T_cam_obj
    for matches in ("same_side", "all"):
        for metric in ("point", "plane"):
            Icp(IcpSettings(matches=matches, metric=metric)).refine(target, T)
            Icp(IcpSettings(matches=matches, metric=metric)).refine(target, np.array(T))
    icp_align(np.zeros((5, 3)), np.asfortranarray(np.eye(3)), PLAIN)
    assert len(icp_loop.signatures) == 1


# Stop rules and gates -------------------------------------------------------------------------------------------------


def test_stop_rules_differ_in_how_long_they_run() -> None:
    rng = np.random.default_rng(4)
    cloud = lumpy_cloud(rng, 800)
    source = apply(small_motion(rng, 6, 0.004), cloud[::2]) + rng.normal(0, 0.0003, (400, 3))
    ran = {
        stop: icp_align(source, cloud, structs.replace(PLAIN, stop=stop, max_iterations=60)).n_iterations
        for stop in ("published", "tolerance", "max_iterations")
    }
    assert ran["published"] == 2
    assert 2 < ran["tolerance"] < 60
    assert ran["max_iterations"] == 60


def test_no_small_step_ends_the_loop_while_the_gate_still_shrinks() -> None:
    cloud = lumpy_cloud(np.random.default_rng(4), 300)
    shrinking = IcpSettings(stop="tolerance", max_iterations=30)
    assert icp_align(cloud, cloud, shrinking).n_iterations == 10
    assert icp_align(cloud, cloud, structs.replace(shrinking, gate="published")).n_iterations == 1


def test_gate_starts_wide_and_ends_at_the_published_one() -> None:
    extent_m = largest_extent_m(np.array([[0.0, 0, 0], [0.2, 0.1, 0.05]]))
    published = gate_schedule_m(extent_m, IcpSettings(gate="published", max_iterations=4))
    assert np.allclose(published, 0.02)
    shrinking = gate_schedule_m(extent_m, IcpSettings(max_iterations=14))
    assert shrinking[0] == pytest.approx(0.1)
    assert (np.diff(shrinking[:10]) < 0).all()
    assert np.allclose(shrinking[9:], 0.02)
    two = gate_schedule_m(extent_m, IcpSettings(stop="published"))
    assert np.allclose(two[:3], [0.1, 0.02, 0.02])


def test_published_gate_leaves_a_far_start_untouched_and_the_default_does_not() -> None:
    target = moved(box_problem().targets[0], transform(np.eye(3), [0, 0, 0.6]))
    far = transform(np.eye(3), [0.01, 0.02, 0.68])
    published = Icp(msgspec.convert(PRESETS["published"]["icp"], IcpSettings)).refine(target, far)
    assert np.array_equal(published, far)
    T = far
    for _ in range(5):
        T = Icp(IcpSettings()).refine(target, T)
    assert np.linalg.norm(T[:3, 3] - [0, 0, 0.6]) < 0.01


# The refiner ----------------------------------------------------------------------------------------------------------


@given(seed=SEEDS)
@settings(max_examples=10, deadline=None)
def test_refines_a_disturbed_pose_to_the_true_one(seed: int) -> None:
    for metric in ("point", "plane"):
        rng = np.random.default_rng(seed)
        T_true = transform(axis_angle(random_unit_vector(rng), rng.uniform(0, np.pi)), [0.05, -0.02, 0.7])
        target = moved(box_problem().targets[0], T_true)
        refiner = Icp(IcpSettings(metric=metric, matches="all"))
        T = T_true @ small_motion(rng, 4, 0.003)
        for _ in range(8):
            T = refiner.refine(target, T)
        assert_rigid(T)
        assert angle_between(T[:3, :3], T_true[:3, :3]) < np.deg2rad(0.3), metric
        assert np.linalg.norm(T[:3, 3] - T_true[:3, 3]) < 3e-4, metric


def test_same_as_moving_the_model_in_the_camera_frame() -> None:
    """docs/methods.md 4.1 as written: source = observed cloud, target = model at T, new pose = X⁻¹ T."""
    target = box_problem().targets[0]
    T = target.instance.hypotheses[1].T_cam_obj
    for stop in ("published", "tolerance", "max_iterations"):
        setting = structs.replace(PLAIN, stop=stop, max_iterations=20)
        X = icp_align(target.instance.points_cam, apply(T, target.model.points), setting).T_target_source
        assert np.abs(Icp(setting).refine(target, T) - inverse(X) @ T).max() < 1e-9


def test_same_side_keeps_the_seen_front_from_the_models_back() -> None:
    """A thin plate seen from the front, 4 mm too near: its back is nearer than its front."""
    problem = box_problem()
    target = problem.targets[0]
    u, v = np.meshgrid(np.linspace(-0.04, 0.04, 30), np.linspace(-0.03, 0.03, 30))
    front = np.stack([u.ravel(), v.ravel(), np.full(900, -0.002)], axis=1)
    normals = np.repeat([[0.0, 0, -1], [0.0, 0, 1]], 900, axis=0)
    plate = replace(target.model, points=np.concatenate([front, front * [1, 1, -1]]), point_normals=normals)
    T_true = transform(np.eye(3), [0, 0, 0.6])
    shape = problem.observation.camera.shape
    facing = np.broadcast_to(np.array([0, 0, -1], np.float32), (*shape, 3))
    observation = replace(problem.observation, normals_cam=facing)
    instance = replace(target.instance, points_cam=apply(T_true, front[::2]))
    seen = Target(observation, instance, plate)
    too_near = transform(np.eye(3), [0, 0, 0.6 - 0.004])
    assert Icp(IcpSettings(matches="all")).refine(seen, too_near)[2, 3] == pytest.approx(0.596, abs=1e-4)
    assert np.array_equal(Icp(IcpSettings(matches="same_side")).refine(seen, too_near), too_near)


def test_unknown_observed_normals_take_every_match() -> None:
    target = box_problem().targets[0]
    zero = replace(target.observation, normals_cam=np.zeros_like(target.observation.normals_cam))
    T = target.instance.hypotheses[0].T_cam_obj
    blind = replace(target, observation=zero)
    assert np.array_equal(
        Icp(IcpSettings(matches="same_side")).refine(blind, T), Icp(IcpSettings(matches="all")).refine(blind, T)
    )


def test_observed_normals_are_those_of_the_points_pixels() -> None:
    observation = box_problem().observation
    v, u = np.nonzero(observation.depth_m)
    points = observation.camera.back_project(observation.depth_m)[v, u]
    assert np.array_equal(observed_normals(observation, points), observation.normals_cam[v, u])
    outside = np.array([[10.0, 0, 1], [0, -10.0, 1]])
    assert not observed_normals(observation, outside).any()


def test_too_few_points_leave_the_pose_as_it_is() -> None:
    target = box_problem().targets[0]
    T = target.instance.hypotheses[0].T_cam_obj
    for n in (0, 1, 2):
        few = replace(target, instance=replace(target.instance, points_cam=target.instance.points_cam[:n]))
        assert np.array_equal(Icp(IcpSettings()).refine(few, T), T), n


def test_published_preset_spells_out_every_choice_of_icp() -> None:
    assert set(PRESETS["published"]["icp"]) == set(IcpSettings.__struct_fields__)
