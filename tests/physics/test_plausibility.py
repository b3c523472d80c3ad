"""Verdicts whose numbers can be checked by hand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.physics.bodies import T_CAM_WORLD, T_WORLD_CAM, angle, ball, box, model, placed, ring, standing, table
from tests.progress import ending_after
from verefine_viz.core.errors import Cancelled, ShapeError
from verefine_viz.core.geometry import axis_angle, transform
from verefine_viz.core.problem import Placed
from verefine_viz.core.settings import PhysicsSettings
from verefine_viz.physics.colliders import Collider, build
from verefine_viz.physics.plausibility import Plausibility, holds, plausibility
from verefine_viz.physics.simulator import BulletSimulator
from verefine_viz.recording.verify import first_difference

BRICK = box(0.06, 0.04, 0.1)
PLATE = box(0.1, 0.1, 0.04)
DOWN = np.array([0.0, 0.0, -1.0])
SQUARE = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * 0.03


@pytest.fixture(scope="module")
def judge(cache: Path):
    def judged(moving: Placed, *fixed: Placed, normal=(0, 0, 1), **physics) -> Plausibility:
        return plausibility(moving, fixed, table(normal), PhysicsSettings(**physics), cache)

    return judged


def test_standing_box_is_green_and_knows_its_polygon(judge):
    found = judge(standing(BRICK))
    assert (found.light, found.is_stable) == ("green", True)
    assert found.gap_mm == pytest.approx(0, abs=1e-6)
    assert found.penetration_mm == pytest.approx(0, abs=1e-6)
    assert found.penetrates is None
    assert found.margin_mm == pytest.approx(20)
    corners = found.polygon_cam @ T_WORLD_CAM[:3, :3].T + T_WORLD_CAM[:3, 3]
    expected = [[x, y, 0] for x in (-0.03, 0.03) for y in (-0.02, 0.02)]
    np.testing.assert_allclose(sorted(corners.tolist()), expected, atol=1e-9)
    np.testing.assert_allclose(found.com_cam, (T_CAM_WORLD @ [0, 0, 0.05, 1])[:3], atol=1e-9)
    np.testing.assert_allclose(found.com_on_plane_cam, (T_CAM_WORLD @ [0, 0, 0, 1])[:3], atol=1e-9)
    assert found.sentence == "Stands: the centre of mass is 20.0 mm inside its support."


@given(height_mm=st.floats(-40, 40))
@settings(max_examples=25, deadline=None)
def test_gap_and_penetration_of_the_plane_are_exact(judge, height_mm: float):
    found = judge(placed(BRICK, (0, 0, 0.05 + height_mm * 1e-3)))
    assert found.gap_mm == pytest.approx(max(height_mm, 0), abs=0.01)
    assert found.penetration_mm == pytest.approx(max(-height_mm, 0), abs=0.01)
    # 5 mm, 5 % of the height of 100 mm, and half the diagonal of its base, 36.1 mm, at 2.5°.
    assert found.tolerance_mm == pytest.approx(11.57, abs=0.01)
    # Contacts deep inside a surface do not tell how it would stand.
    assert (found.is_stable is None) == (found.penetration_mm > found.tolerance_mm)
    if height_mm > 5.01 or height_mm < -11.6:
        assert found.light == "red"
        assert found.sentence.startswith("Floats" if height_mm > 0 else "Sinks")
        assert f"{max(found.gap_mm, found.penetration_mm):.1f} mm" in found.sentence
    if height_mm < -0.1:
        assert found.penetrates == -1
        assert "support plane" in found.sentence or found.light == "green"


def test_collision_margin_does_not_enter(judge):
    for margin_m in (1e-4, 1e-3):
        assert judge(placed(BRICK, (0, 0, 0.065)), margin_m=margin_m).gap_mm == pytest.approx(15, abs=0.01), margin_m
        assert judge(placed(BRICK, (0, 0, 0.035)), margin_m=margin_m).penetration_mm == pytest.approx(15, abs=0.01)


@given(overlap_mm=st.floats(-6, 15))
@settings(max_examples=20, deadline=None)
def test_gap_and_penetration_of_a_neighbour(judge, overlap_mm: float):
    # Both hang in the air side by side, so that only the neighbour is near.
    found = judge(placed(BRICK, (0, 0, 0.3)), placed(BRICK, (0.06 - overlap_mm * 1e-3, 0, 0.3), instance_id=4))
    assert found.gap_mm == pytest.approx(max(-overlap_mm, 0), abs=0.3)
    assert found.penetration_mm == pytest.approx(max(overlap_mm, 0), abs=0.3)
    if overlap_mm > 0.1:
        assert found.penetrates == 4
    if overlap_mm > 5.3:
        assert found.sentence == f"Sinks {found.penetration_mm:.1f} mm into instance 4."
        assert found.light == "red"


def test_touching_at_an_edge_is_measured_too(judge):
    # The neighbour's vertical edge points at the flat side: 45° about z, its half diagonal away.
    edge_m = 0.02 * np.sqrt(2)
    post = box(0.04, 0.04, 0.1)
    turned = axis_angle([0, 0, 1], np.pi / 4)
    neighbour = placed(post, (0.03 + edge_m - 0.003, 0, 0.3), turned, instance_id=4)
    assert judge(placed(BRICK, (0, 0, 0.3)), neighbour).penetration_mm == pytest.approx(3, abs=0.3)


def test_a_far_neighbour_and_the_order_of_near_ones_change_nothing(judge):
    alone = judge(standing(BRICK))
    assert first_difference(alone, judge(standing(BRICK), standing(BRICK, xy=(0.3, 0), instance_id=4))) is None
    a, b = standing(BRICK, xy=(0.055, 0), instance_id=1), standing(PLATE, xy=(-0.07, 0), instance_id=2)
    assert first_difference(judge(standing(BRICK), a, b), judge(standing(BRICK), b, a)) is None


def test_box_on_a_box_stands_while_its_centre_is_above(judge):
    for offset_mm in (25, 29, 31, 40):
        found = judge(placed(BRICK, (offset_mm * 1e-3, 0, 0.15)), standing(BRICK, instance_id=4))
        assert found.is_stable == (offset_mm < 30), offset_mm
        assert found.margin_mm == pytest.approx(30 - offset_mm, abs=0.3), offset_mm
        assert set(found.contact_others) == {4}, offset_mm
        if offset_mm > 30:
            assert found.light == "red", offset_mm
            assert found.sentence.startswith("Would tip"), offset_mm


def test_on_an_edge_it_falls(judge):
    found = judge(standing(BRICK, axis_angle([0, 1, 0], np.deg2rad(45))))
    assert not found.is_stable
    assert len(found.polygon_cam) == 2
    assert found.margin_mm == pytest.approx(-20 / np.sqrt(2), abs=0.01)
    assert found.light == "red"


def test_what_leans_as_much_as_depth_may_measure_stands(judge):
    """It touches at an edge, like ground truth of real frames."""
    for lean_deg, light in ((2.4, "amber"), (3, "amber"), (6, "red")):
        R = axis_angle([0, 1, 0], np.deg2rad(lean_deg))
        found = judge(standing(BRICK, R))
        assert (found.light, found.is_stable) == (light, light == "amber"), lean_deg
        assert found.gap_mm == pytest.approx(0, abs=1e-6)


def test_either_of_two_that_overlap_is_allowed_what_the_taller_explains(judge):
    tall = box(0.06, 0.06, 0.24)
    on_it = placed(tall, (0, 0, 0.04 + 0.12 - 0.014), instance_id=4)
    for one, other in ((standing(PLATE), on_it), (on_it, standing(PLATE))):
        found = judge(one, other)
        assert (found.penetrates, found.light) == (other.instance_id, "amber")
        assert found.tolerance_mm == pytest.approx(5 + 12 + 1e3 * 0.03 * np.sqrt(2) * np.sin(np.deg2rad(2.5)), abs=0.01)


def test_incline_of_20_degrees_holds_for_half_and_slips_for_a_third(judge):
    for direction_deg in (0, 22.5, 45, 100):
        turn = axis_angle([0, 0, 1], np.deg2rad(direction_deg))
        R = turn @ axis_angle([0, 1, 0], np.deg2rad(20)) @ turn.T
        plate = Placed(0, PLATE, T_CAM_WORLD @ transform(R, R @ [0, 0, 0.02]))
        for friction, stands in ((0.5, True), (0.3, False)):
            found = judge(plate, normal=tuple(R[:, 2]), friction=friction)
            assert found.is_stable == stands, (direction_deg, friction)
            assert found.margin_mm > 30, (direction_deg, friction)  # it is the friction that fails
            on_plane = (found.polygon_cam @ T_WORLD_CAM[:3, :3].T + T_WORLD_CAM[:3, 3]) @ R[:, 2]
            np.testing.assert_allclose(on_plane, 0, atol=1e-9)


def test_ball_in_a_ring_stands_inside(judge, cache: Path):
    around = standing(ring(), instance_id=1)
    found = judge(standing(ball(), xy=(0.01, 0)), around)
    assert found.penetration_mm < 0.1
    assert found.is_stable
    assert judge(standing(ball(), xy=(0.025, 0)), around).penetration_mm == pytest.approx(5, abs=0.5)


def test_a_closed_hollow_mesh_need_not_be_taken_apart_to_know_its_centre_of_mass(
    hollow_ring: Collider, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    thing, expected = standing(ring()), hollow_ring.com_obj
    monkeypatch.setattr("verefine_viz.physics.colliders.decomposed", lambda *_: pytest.fail("taken apart"))
    found = plausibility(thing, (), table(), cache=tmp_path)
    np.testing.assert_allclose(found.com_cam, (thing.T_cam_obj @ [*expected, 1])[:3], atol=1e-12)
    np.testing.assert_array_equal(build(ring(), "hull").com_obj, expected)


@pytest.mark.usefixtures("processes")
def test_a_mesh_with_a_hole_is_taken_apart_unless_nobody_waits(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    mesh = trimesh.Trimesh(angle().vertices, angle().faces[1:], process=False)
    thing = standing(model(mesh))
    with pytest.raises(Cancelled):
        plausibility(thing, (), table(), cache=tmp_path, progress=ending_after(3))
    assert [path.name.split("-")[1] for path in tmp_path.iterdir()] == ["hull"]
    legs = [np.abs(angle().vertices[:, k]) < 0.031 for k in (0, 1)]
    monkeypatch.setattr("verefine_viz.physics.colliders.decomposed", lambda *_: [angle().vertices[leg] for leg in legs])
    plausibility(thing, (), table(), cache=tmp_path)
    assert {path.name.split("-")[1] for path in tmp_path.iterdir()} == {"hull", "decomposition"}


def test_a_small_gap_is_amber_and_a_large_one_has_no_support(judge):
    found = judge(placed(BRICK, (0, 0, 0.053)))
    assert (found.light, found.is_stable) == ("amber", True)
    assert "3.0 mm" in found.sentence
    found = judge(placed(BRICK, (0, 0, 0.1)))
    assert found.polygon_cam.shape == (0, 3)
    assert found.margin_mm == -np.inf
    assert not found.is_stable


def test_verdict_agrees_with_the_simulator(judge, cache: Path):
    """What is called stable does not move in a second; what would tip does."""
    simulator = BulletSimulator(PhysicsSettings(), cache)
    below = standing(BRICK, instance_id=4)
    for offset_m in (0.02, 0.027, 0.034, 0.04):
        moving = placed(BRICK, (offset_m, 0, 0.1501))
        end = simulator.settle(moving, (below,), table(), 60).T_cam_obj
        moved = np.linalg.norm(end[:3, 3] - moving.T_cam_obj[:3, 3]) > 0.01
        assert moved != judge(moving, below).is_stable


def test_bad_pose_is_refused(judge):
    with pytest.raises(ShapeError, match="instance 0"):
        judge(Placed(0, BRICK, np.full((4, 4), np.nan)))
    with pytest.raises(ShapeError, match="instance 5"):
        judge(standing(BRICK), Placed(5, BRICK, transform(np.eye(3), [0, 0, 900.0])))


def square(com: tuple[float, float, float], points=SQUARE, friction: float = 0.5) -> bool:
    normals = np.tile([0.0, 0, 1], (len(points), 1))
    return holds(points, normals, np.full(len(points), friction), np.array(com), DOWN)


def test_equilibrium_of_four_feet_and_of_two_walls_that_hold_by_friction_alone():
    assert square((0, 0, 0.1))
    assert square((0.029, -0.029, 0.1))
    assert not square((0.031, 0, 0.1))
    assert not square((0, 0, 0.1), SQUARE[:2])  # an edge beside the centre
    assert square((0, -0.03, 0.1), SQUARE[:2])  # an edge below it
    assert not square((0, 0, 0.1), SQUARE[:0])
    points, normals = np.array([[-0.03, 0, 0], [0.03, 0, 0.0]]), np.array([[1.0, 0, 0], [-1, 0, 0]])
    assert holds(points, normals, np.full(2, 0.5), np.zeros(3), DOWN)
    assert not holds(points, normals, np.zeros(2), np.zeros(3), DOWN)
