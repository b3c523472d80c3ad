"""The physics step against numbers known by hand."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest
import trimesh

from tests.physics.bodies import (
    T_CAM_WORLD,
    T_WORLD_CAM,
    ball,
    box,
    heights,
    model,
    placed,
    ring,
    standing,
    table,
    tilt_deg,
)
from verefine_viz.core.errors import ShapeError
from verefine_viz.core.geometry import angle_between, axis_angle, transform
from verefine_viz.core.observation import Support
from verefine_viz.core.problem import Placed
from verefine_viz.core.settings import PhysicsSettings
from verefine_viz.physics.simulator import BulletSimulator
from verefine_viz.physics.world import QuietClient, pybullet

LEVEL = Support(np.eye(4), np.array([0.0, 0, 1]), "plane", 1.0)
"""The world is the camera's frame: no arithmetic between what Bullet says and the path."""
BRICK = box(0.06, 0.04, 0.1)
CUBE = box(0.05, 0.05, 0.05)


def test_three_steps_of_free_fall_drop_13_millimetres(simulator: BulletSimulator):
    path = simulator.settle(placed(BRICK, (0, 0, 0.5)), (), table(), 3)
    start, end = (T_WORLD_CAM @ path.Ts_cam_obj)[[0, -1], :3, 3]
    assert (end - start) * 1e3 == pytest.approx([0, 0, -13.27], abs=0.02)
    assert angle_between(path.Ts_cam_obj[0, :3, :3], path.T_cam_obj[:3, :3]) < 1e-9
    assert [len(c.depths_m) for c in path.contacts] == [0, 0, 0]


def test_path_starts_with_the_very_pose_that_was_given(simulator: BulletSimulator):
    start = standing(BRICK, axis_angle([1, 2, 3], 0.7))
    for n_steps in (0, 3):
        path = simulator.settle(start, (), table(), n_steps)
        assert path.Ts_cam_obj.shape == (n_steps + 1, 4, 4)
        assert len(path.contacts) == n_steps
        assert path.Ts_cam_obj[0].tobytes() == np.ascontiguousarray(start.T_cam_obj).tobytes()
    with pytest.raises(ShapeError, match="n_steps is -1"):
        simulator.settle(start, (), table(), -1)


def test_small_tilts_are_almost_flat_after_three_steps_and_larger_ones_after_ten(simulator: BulletSimulator):
    for angle_deg, axis in itertools.product((5, 10), ((1, 0, 0), (0, 1, 0))):
        start = standing(CUBE, axis_angle(axis, np.deg2rad(angle_deg)))
        assert tilt_deg(start.T_cam_obj) == pytest.approx(angle_deg)
        assert tilt_deg(simulator.settle(start, (), table(), 3).T_cam_obj) < 1.2, (angle_deg, axis)
    path = simulator.settle(standing(CUBE, axis_angle([1, 0, 0], np.deg2rad(20))), (), table(), 10)
    assert tilt_deg(path.Ts_cam_obj[3]) > 10
    assert tilt_deg(path.T_cam_obj) < 2


def test_what_lies_at_rest_stays(simulator: BulletSimulator):
    for normal in ((0, 0, 1), (np.sin(0.1), 0, np.cos(0.1))):
        # The second plane is inclined by 5.7° against gravity; friction of 0.5 holds up to 26°.
        R = axis_angle([0, 1, 0], np.arctan2(normal[0], normal[2]))
        T = T_CAM_WORLD @ transform(R, R @ [0, 0, 0.05])
        path = simulator.settle(Placed(0, BRICK, T), (), table(normal), 60)
        assert np.linalg.norm(path.T_cam_obj[:3, 3] - T[:3, 3]) < 3e-4, normal
        assert np.rad2deg(angle_between(path.T_cam_obj[:3, :3], T[:3, :3])) < 0.3, normal


def test_contacts_carry_the_weight_and_lie_on_the_plane(simulator: BulletSimulator):
    path = simulator.settle(standing(CUBE), (), table(), 90)
    contacts = path.contacts[-1]
    assert set(contacts.others) == {-1}
    assert contacts.forces_n.sum() == pytest.approx(9.81, rel=0.05)
    up_cam = T_CAM_WORLD[:3, 2]
    np.testing.assert_allclose(contacts.normals_cam, np.tile(up_cam, (len(contacts.others), 1)), atol=1e-9)
    points_world = contacts.points_cam @ T_WORLD_CAM[:3, :3].T + T_WORLD_CAM[:3, 3]
    assert np.abs(points_world[:, 2]).max() < 3e-4
    assert np.abs(contacts.depths_m).max() < 3e-4


def test_objects_rest_a_tenth_of_a_millimetre_above_the_plane_and_a_millimetre_as_published(
    simulator: BulletSimulator, cache: Path
):
    path = simulator.settle(placed(CUBE, (0, 0, 0.03)), (), table(), 120)
    assert heights(CUBE, path.T_cam_obj).min() == pytest.approx(0, abs=3e-4)
    published = BulletSimulator(PhysicsSettings(margin_m=1e-3), cache)
    path = published.settle(placed(CUBE, (0, 0, 0.03)), (), table(), 120)
    assert heights(CUBE, path.T_cam_obj).min() == pytest.approx(1e-3, abs=3e-4)
    assert np.abs(path.contacts[-1].depths_m + 1e-3).max() < 3e-4  # reported between the true surfaces


def test_nothing_ends_below_the_plane(simulator: BulletSimulator):
    rng = np.random.default_rng(5)
    for _ in range(10):
        R = axis_angle(rng.normal(size=3), rng.uniform(0, 3))
        path = simulator.settle(placed(BRICK, (0, 0, rng.uniform(-0.02, 0.1)), R), (), table(), 60)
        assert heights(BRICK, path.T_cam_obj).min() > -5e-4


@pytest.mark.usefixtures("processes")
def test_ball_falls_into_a_ring_that_is_hollow_and_onto_its_hull(simulator: BulletSimulator, cache: Path):
    around = standing(ring(), instance_id=1)
    start = placed(ball(), (0, 0, 0.075))
    inside = simulator.settle(start, (around,), table(), 60)
    assert (T_WORLD_CAM @ inside.T_cam_obj)[2, 3] == pytest.approx(0.020, abs=5e-4)
    hull = BulletSimulator(PhysicsSettings(collider="hull"), cache)
    above = hull.settle(start, (around,), table(), 60)
    assert (T_WORLD_CAM @ above.T_cam_obj)[2, 3] == pytest.approx(0.070, abs=5e-4)
    assert set(above.contacts[-1].others) == {1}


def test_placed_neighbour_pushes_and_is_not_pushed_unless_dynamic(simulator: BulletSimulator, cache: Path):
    # 15 mm of lateral overlap. Two boxes share the push where both may move, so each goes less far.
    overlapping = standing(BRICK, xy=(0.045, 0), instance_id=3)
    start = standing(BRICK)
    away = T_WORLD_CAM @ simulator.settle(start, (overlapping,), table(), 60).T_cam_obj
    dynamic = BulletSimulator(PhysicsSettings(placed="dynamic"), cache)
    shared = T_WORLD_CAM @ dynamic.settle(start, (overlapping,), table(), 60).T_cam_obj
    assert away[0, 3] < -0.010
    assert away[0, 3] < shared[0, 3] - 0.003 < -0.003


def test_contacts_name_the_neighbour_and_point_away_from_it(simulator: BulletSimulator):
    overlapping = standing(BRICK, xy=(0.055, 0), instance_id=42)
    contacts = simulator.settle(standing(BRICK), (overlapping,), table(), 1).contacts[0]
    from_neighbour = contacts.others == 42
    assert from_neighbour.any()
    normals_world = contacts.normals_cam[from_neighbour] @ T_WORLD_CAM[:3, :3].T
    assert (normals_world[:, 0] < -0.9).all()
    assert contacts.depths_m[from_neighbour].max() > 2e-3


def test_two_instances_of_one_class_are_two_bodies(simulator: BulletSimulator):
    path = simulator.settle(
        placed(CUBE, (0, 0, 0.11), instance_id=0),
        (standing(CUBE, xy=(-0.03, 0), instance_id=1), standing(CUBE, xy=(0.03, 0), instance_id=2)),
        table(),
        60,
    )
    assert set(path.contacts[-1].others) == {1, 2}
    assert (T_WORLD_CAM @ path.T_cam_obj)[2, 3] == pytest.approx(0.075, abs=5e-4)


def test_order_of_the_fixed_objects_is_free(simulator: BulletSimulator):
    a, b = standing(CUBE, xy=(-0.03, 0), instance_id=1), standing(BRICK, xy=(0.03, 0), instance_id=2)
    moving = placed(CUBE, (0, 0, 0.11))
    one, two = (simulator.settle(moving, fixed, table(), 20) for fixed in ((a, b), (b, a)))
    assert one.Ts_cam_obj.tobytes() == two.Ts_cam_obj.tobytes()


def test_a_block_with_a_thin_arm_stands_by_its_centre_of_mass_and_turns_as_its_box(cache: Path):
    block = trimesh.creation.box(bounds=[[-0.02, -0.02, 0], [0.02, 0.02, 0.04]])
    arm = trimesh.creation.box(bounds=[[-0.02, -0.005, 0.04], [0.10, 0.005, 0.05]])
    crane = model(trimesh.util.concatenate([block, arm]))
    by_mesh, by_box = (
        BulletSimulator(PhysicsSettings(collider="hull", inertia=kind), cache) for kind in ("mesh", "box")
    )
    np.testing.assert_array_equal(by_box.collider(crane).com_obj, by_mesh.collider(crane).com_obj)
    assert by_mesh.collider(crane).com_obj[0] < 0.01
    on_edge = standing(crane, axis_angle([0, 1, 0], np.deg2rad(20)))
    for still, start in ((True, standing(crane)), (False, on_edge)):
        paths = [s.settle(start, (), table(), 10).T_cam_obj for s in (by_mesh, by_box)]
        if still:
            assert max(tilt_deg(T) for T in paths) < 1
        else:
            assert angle_between(paths[0][:3, :3], paths[1][:3, :3]) > np.deg2rad(0.5)


def test_physics_off_leaves_the_pose(cache: Path):
    start = placed(CUBE, (0, 0, 0.5))
    path = BulletSimulator(PhysicsSettings(enabled=False), cache).settle(start, (), table(), 3)
    assert path.T_cam_obj.tobytes() == start.T_cam_obj.tobytes()


def fallen_m(physics: PhysicsSettings, cache: Path, n_steps: int = 60) -> float:
    """How far a cube falls freely."""
    path = BulletSimulator(physics, cache).settle(placed(CUBE, (0, 0, 20.0)), (), table(), n_steps)
    start, end = (T_WORLD_CAM @ path.Ts_cam_obj)[[0, -1], 2, 3]
    return start - end


def test_fall_without_damping_is_half_gravity_times_time_squared(cache: Path):
    for gravity_m_s2 in (0.0, 2.0, 9.81, 20.0):
        physics = PhysicsSettings(gravity_m_s2=gravity_m_s2, damping=0.0)
        assert fallen_m(physics, cache) == pytest.approx(gravity_m_s2 / 2, rel=0.01, abs=1e-12), gravity_m_s2


def test_a_hundredth_of_the_speed_is_left_after_a_second_of_strong_damping(cache: Path):
    """v' = g − k v with k = −ln(1 − 0.99), as of rigid bodies; Bullet damps articulated ones by 1 + v more."""
    k = -np.log(0.01)
    expected_m = 2.0 / k * (1 - (1 - np.exp(-k)) / k)
    fallen = fallen_m(PhysicsSettings(gravity_m_s2=2.0, damping=0.99), cache)
    assert expected_m / 1.4 < fallen < expected_m
    shares = [fallen_m(PhysicsSettings(damping=share), cache) for share in (0.0, 0.04, 0.5, 0.99, 1.0)]
    assert shares == sorted(shares, reverse=True)
    assert len(set(shares)) == 5


def test_damping_slows_turning_too(cache: Path):
    start = standing(BRICK, axis_angle([1, 0, 0], np.deg2rad(40)))
    toppling, held = (
        BulletSimulator(PhysicsSettings(gravity_m_s2=2.0, damping=share), cache).settle(start, (), table(), 20)
        for share in (0.0, 0.999)
    )
    assert abs(tilt_deg(toppling.T_cam_obj) - 40) > 1.3 * abs(tilt_deg(held.T_cam_obj) - 40)


def test_default_gravity_and_damping_are_bullets_own(simulator: BulletSimulator, cache: Path):
    """0.04 goes into Bullet's single precision and comes out as another number: it must not be set at all."""
    client = QuietClient()
    client.setPhysicsEngineParameter(fixedTimeStep=1 / 60, numSubSteps=4, numSolverIterations=10)
    client.setGravity(0, 0, -9.81)
    body = client.createMultiBody(1.0, client.createCollisionShape(pybullet.GEOM_SPHERE, radius=0.01))
    client.resetBasePositionAndOrientation(body, (0, 0, 20.0), (0, 0, 0, 1))
    heights_m = []
    for _ in range(30):
        client.stepSimulation()
        heights_m.append(client.getBasePositionAndOrientation(body)[0][2])
    client.disconnect()
    path = simulator.settle(Placed(0, CUBE, transform(np.eye(3), [0, 0, 20.0])), (), LEVEL, 30)
    assert path.Ts_cam_obj[1:, 2, 3].tolist() == heights_m


BAD = [
    (np.full((4, 4), np.nan), "NaN or infinity"),
    (transform(np.eye(3), [0, 0, np.nan]), "NaN or infinity"),
    (transform(np.eye(3), [np.inf, 0, 0]), "NaN or infinity"),
    (transform(np.eye(3), [0, 0, 800.0]), "800 m away"),  # in millimetres
    (transform(np.diag([1, 1, -1]), [0, 0, 1]), "not rigid"),
    (transform(2 * np.eye(3), [0, 0, 1]), "not rigid"),
    (np.eye(4)[:3], "shape"),
]


def test_impossible_pose_is_refused_and_the_simulator_goes_on(simulator: BulletSimulator):
    good = standing(CUBE)
    before = simulator.settle(good, (), table(), 3)
    for T_bad, says in BAD:
        bad = Placed(9, CUBE, T_bad)
        for asked in ((bad, ()), (good, (bad,))):
            with pytest.raises(ShapeError, match=says) as caught:
                simulator.settle(*asked, table(), 3)
            assert "instance 9" in str(caught.value)
            assert "\n" not in str(caught.value)
            assert simulator.settle(good, (), table(), 3).Ts_cam_obj.tobytes() == before.Ts_cam_obj.tobytes(), says


def test_a_path_ends_before_it_leaves_the_reach_of_the_camera(cache: Path):
    simulator = BulletSimulator(PhysicsSettings(gravity_m_s2=100.0), cache)
    floor = Support(transform(np.eye(3), [0, 0, 150.0]), np.array([0.0, 0, 1]), "plane", 1.0)
    path = simulator.settle(Placed(0, CUBE, transform(np.eye(3), [0, 0, -99.0])), (), floor, 60)
    assert 1 < len(path.Ts_cam_obj) < 61
    assert len(path.contacts) == len(path.Ts_cam_obj) - 1
    assert np.linalg.norm(path.Ts_cam_obj[:, :3, 3], axis=1).max() <= 100.0
    assert simulator.settle(Placed(0, CUBE, path.T_cam_obj), (), floor, 1).T_cam_obj.shape == (4, 4)
