"""Objects in the world that a depth image shows: made-up frames with a slope, a step, a wall, a box without a model."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace
from functools import cache, partial

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import settings as examples
from hypothesis import strategies as st
from msgspec import structs
from scipy.ndimage import binary_erosion

from tests.made_up_frames import Thing, frame_of
from verefine_viz.core.arrays import Float, Mask
from verefine_viz.core.geometry import angle_between, apply, axis_angle, transform
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.observation import Support
from verefine_viz.core.problem import Placed, Problem
from verefine_viz.core.settings import PhysicsSettings
from verefine_viz.core.surroundings import SupportSurface, Surroundings, unknown_id
from verefine_viz.observation.observed_support import convex_model, observed_surroundings
from verefine_viz.physics.plausibility import plausibility
from verefine_viz.physics.simulator import BulletSimulator
from verefine_viz.recording.verify import first_difference

pytestmark = pytest.mark.usefixtures("long_run")

HULLS = PhysicsSettings(collider="hull")
BRICK = (0.06, 0.05, 0.08)


def model(mesh: trimesh.Trimesh, obj_id: int) -> ObjectModel:
    vertices, diameter_m = np.asarray(mesh.vertices), float(np.linalg.norm(mesh.extents))
    faces, normals = np.asarray(mesh.faces), np.zeros_like(vertices)
    return ObjectModel(obj_id, f"thing {obj_id}", vertices, faces, vertices, normals, diameter_m, np.eye(4)[None])


@cache
def box(*size_m: float) -> ObjectModel:
    return model(trimesh.creation.box(size_m), round(1e3 * sum(size_m)))


def at(x: float, y: float, z: float, yaw_deg: float = 20.0) -> Float:
    return transform(axis_angle([0, 0, 1], np.radians(yaw_deg)), [x, y, z])


def unmodelled(thing: ObjectModel, T_world_obj: Float) -> Thing:
    return Thing(thing, T_world_obj, is_asked_for=False)


def made(things: Sequence[Thing], seed: int = 0, dropped: Sequence[int] = ()) -> tuple[Problem, Support]:
    """A frame, and its support with what is observed around the objects."""
    problem = frame_of(things, np.random.default_rng(seed))
    support = problem.observation.support
    assert support is not None
    return problem, replace(support, surroundings=observed_surroundings(problem.observation, support, dropped))


def world_of(problem: Problem) -> Float:
    """T_world_cam in which the frame was made up: the table is z = 0."""
    assert problem.observation.T_map_cam is not None
    return problem.observation.T_map_cam


def settled(problem: Problem, support: Support, T_world_obj: Float, n_steps: int = 120):
    """The object in a pose of the made-up world, simulated: the path, and its pose there at the end."""
    target = problem.targets[0]
    T_cam_world = np.linalg.inv(world_of(problem))
    path = BulletSimulator(HULLS).settle(Placed(0, target.model, T_cam_world @ T_world_obj), (), support, n_steps)
    return path, world_of(problem) @ path.T_cam_obj


def test_a_bare_table_gives_the_answers_of_the_plane() -> None:
    for seed in range(3):
        brick = box(*BRICK)
        problem, support = made([Thing(brick, at(0.0, 0.0, 0.04))], seed)
        around = support.surroundings
        assert around.base.is_endless, seed
        assert not around.solids, seed
        assert not around.unknown, seed
        # Heights of the two planes under the object.
        plane = replace(support, surroundings=None)
        for start in (at(0.0, 0.0, 0.05), at(0.01, 0.0, 0.01), at(-0.02, 0.01, 0.04, 75)):
            _, observed = settled(problem, support, start)
            _, on_plane = settled(problem, plane, start)
            np.testing.assert_allclose(observed[:3, 3], on_plane[:3, 3], atol=0.003)
            assert np.degrees(angle_between(observed[:3, :3], on_plane[:3, :3])) < 2.0, seed


def test_an_object_on_a_box_without_a_model_stays_on_it() -> None:
    brick, low = box(*BRICK), box(0.14, 0.12, 0.05)
    stands = at(0.0, 0.0, 0.09)
    problem, support = made([Thing(brick, stands), unmodelled(low, at(0.0, 0.0, 0.025))])
    around = support.surroundings
    assert around is not None
    _, T = settled(problem, support, stands)
    assert T[2, 3] == pytest.approx(0.09, abs=0.005)
    T_cam = np.linalg.inv(world_of(problem)) @ stands
    checked = plausibility(Placed(0, brick, T_cam), (), support, HULLS)
    assert checked.is_stable
    assert checked.penetration_mm < 5


def test_an_unknown_object_stops_another_until_it_is_dropped() -> None:
    brick, post = box(*BRICK), box(0.05, 0.05, 0.1)
    things = [Thing(brick, at(-0.03, 0.0, 0.04, 0)), unmodelled(post, at(0.08, 0.0, 0.05, 0))]
    problem, support = made(things)
    around = support.surroundings
    assert [u.number for u in around.unknown] == [1]
    size = np.ptp(around.unknown[0].model.vertices, axis=0)
    assert size == pytest.approx([0.05, 0.05, 0.1], abs=0.015)
    inside = at(0.04, 0.0, 0.04, 0)  # Overlaps the post by 15 mm.
    path, T = settled(problem, support, inside, 20)
    assert unknown_id(1) in np.concatenate([c.others for c in path.contacts])
    assert T[0, 3] < 0.035
    checked = plausibility(Placed(0, brick, np.linalg.inv(world_of(problem)) @ inside), (), support, HULLS)
    assert checked.penetrates == unknown_id(1)
    assert "into unknown object 1." in checked.sentence
    _, dropped = made(things, dropped=[1])
    assert [u.is_dropped for u in dropped.surroundings.unknown] == [True]
    path, T = settled(problem, dropped, inside, 20)
    assert T[0, 3] == pytest.approx(0.04, abs=0.002)


def shrunk_one(k: int, masks: Sequence[Mask], px: int) -> Mask:
    return np.asarray(binary_erosion(masks[k], iterations=px), dtype=bool)


def test_the_rim_beside_a_mask_that_is_too_small_is_no_object_and_a_post_beside_it_is() -> None:
    brick, post = Thing(box(*BRICK), at(0.0, 0.0, 0.04, 0)), unmodelled(box(0.03, 0.03, 0.06), at(0.055, 0.0, 0.03, 0))
    for px, things in itertools.product((2, 5, 8, 12), ([brick], [brick, post])):
        problem = frame_of(things, np.random.default_rng(0), spoil_mask=partial(shrunk_one, px=px))
        support = problem.observation.support
        assert support is not None
        around = observed_surroundings(problem.observation, support)
        assert not around.solids, px
        assert len(around.unknown) == len(things) - 1, px


@given(x_m=st.sampled_from([0.0, 0.01, 0.06, 0.08]), yaw_deg=st.sampled_from([0.0, 90.0]))
@examples(max_examples=8, deadline=None)
def test_an_object_stands_on_a_shelf_and_tips_over_its_edge(x_m: float, yaw_deg: float) -> None:
    """The shelf ends at x = 0.05, and the brick's centre of mass is beyond it or not."""
    problem, support = shelf()
    path, T = settled(problem, support, at(x_m, 0.0, 0.105, yaw_deg), 120)
    if x_m < 0.05:
        assert T[2, 3] == pytest.approx(0.10, abs=0.006)
        assert path.tipping is None
    else:
        assert T[2, 3] < 0.08
    T_cam = np.linalg.inv(world_of(problem)) @ at(x_m, 0.0, 0.10, yaw_deg)
    assert plausibility(Placed(0, box(*BRICK), T_cam), (), support, HULLS).is_stable == (x_m < 0.05)


@cache
def shelf() -> tuple[Problem, Support]:
    board = box(0.35, 0.4, 0.06)
    return made([Thing(box(*BRICK), at(-0.05, 0.0, 0.10)), unmodelled(board, at(-0.125, 0.0, 0.03, 0))])


def test_an_object_rests_on_a_slope() -> None:
    tilt = np.radians(12)
    R = axis_angle([1, 0, 0], tilt)  # Rises away from the camera.
    wedge = box(0.4, 0.4, 0.1)
    T_wedge = transform(R, R @ [0, 0, -0.05] + [0, 0, 0.04])
    T_brick = transform(R, R @ [0, 0, 0.04] + [0, 0, 0.04])
    problem, support = made([Thing(box(*BRICK), T_brick), unmodelled(wedge, T_wedge)])
    _, T = settled(problem, support, T_brick, 60)
    assert np.degrees(angle_between(T[:3, :3], T_brick[:3, :3])) < 3
    np.testing.assert_allclose(T[:3, 3], T_brick[:3, 3], atol=0.008)
    _, level = settled(problem, support, transform(np.eye(3), T_brick[:3, 3] + [0, 0, 0.01]), 120)
    assert np.degrees(angle_between(level[:3, :3], T_brick[:3, :3])) < 4


def test_a_wall_stops_an_object() -> None:
    """A bin's wall behind the object, too long to be an object of its own."""
    wall = box(0.9, 0.02, 0.12)
    problem, support = made([Thing(box(*BRICK), at(0.0, -0.03, 0.04, 0)), unmodelled(wall, at(0.0, 0.05, 0.06, 0))])
    around = support.surroundings
    assert not around.unknown
    inside = at(0.0, 0.025, 0.04, 0)  # 10 mm into the wall's face at y = 0.04.
    path, T = settled(problem, support, inside, 30)
    assert T[1, 3] < 0.019
    assert len(path.contacts[-1].others)


def board(tilt_deg: float) -> Support:
    """A board of 60 × 60 cm above the table, and which way is up; the world is the camera's."""
    R = axis_angle([1, 0, 0], np.radians(tilt_deg))
    corners = np.array([[x, y, 0.0] for x, y in ((-0.3, -0.3), (0.3, -0.3), (0.3, 0.3), (-0.3, 0.3))]) @ R.T + [0, 0, 1]
    top = SupportSurface(R[:, 2], -float(R[:, 2] @ [0, 0, 1]), corners[:, :2])
    solid = convex_model(np.concatenate([corners, corners - 0.02 * R[:, 2]]), "board")
    assert solid is not None
    below = SupportSurface(np.array([0.0, 0.0, 1.0]), 0.0, np.zeros((0, 2)))
    around = Surroundings("observed", below, True, (top,), (solid,))
    return Support(np.eye(4), np.array([0.0, 0.0, 1.0]), "world", 1.0, surroundings=around)


@given(sinks_m=st.floats(0.0, 0.035), yaw_deg=st.floats(0, 360))
@examples(max_examples=10, deadline=None)
def test_what_stays_over_the_first_surface_is_on_a_plane(sinks_m: float, yaw_deg: float) -> None:
    """Also what starts deep inside of a board of 2 cm, and above all below its middle."""
    support, start = board(0.0), Placed(0, box(*BRICK), at(0.05, -0.1, 1.04 - sinks_m, yaw_deg))
    plane = replace(support, T_world_cam=transform(np.eye(3), [0, 0, -1.0]), surroundings=None)
    path, on_plane = (BulletSimulator(HULLS).settle(start, (), s, 60) for s in (support, plane))
    np.testing.assert_allclose(path.Ts_cam_obj, on_plane.Ts_cam_obj, atol=1e-5)
    assert path.T_cam_obj[2, 3] > 1.03


def test_what_slides_off_the_first_surface_falls() -> None:
    """At first it is over the board, as a shorter simulation shows."""
    support, start = board(35.0), Placed(0, box(*BRICK), at(0.0, 0.0, 1.06, 0))
    slippery = BulletSimulator(structs.replace(HULLS, friction=0.01))
    short, path = (slippery.settle(start, (), support, n) for n in (10, 70))
    first = support.surroundings.surfaces[0] if support.surroundings else None
    assert first.heights(short.Ts_cam_obj[:, :3, 3]).min() > 0.02
    assert first.heights(path.Ts_cam_obj[:, :3, 3]).min() < -0.02
    assert path.T_cam_obj[1, 3] < -0.3
    assert path.T_cam_obj[2, 3] > 0.0  # On what lies below the board.


def test_what_is_under_the_first_surface_stays_under_it() -> None:
    """An object on the table below the board."""
    start = Placed(0, box(*BRICK), at(0.0, 0.0, 0.045))
    path = BulletSimulator(HULLS).settle(start, (), board(0.0), 60)
    assert path.T_cam_obj[2, 3] == pytest.approx(0.04, abs=0.002)


def test_simulations_do_not_depend_on_what_was_simulated_before() -> None:
    """Plane, shelf and wall in turns, by one simulator and by new ones."""
    shelf_frame, shelf_support = shelf()
    _, bare_support = made([Thing(box(*BRICK), at(0.0, 0.0, 0.04))])
    rng = np.random.default_rng(4)
    model_, T_cam_world = box(*BRICK), np.linalg.inv(world_of(shelf_frame))
    supports = (shelf_support, bare_support, replace(shelf_support, surroundings=None))
    simulator = BulletSimulator(HULLS)
    for _ in range(30):
        T = T_cam_world @ at(rng.uniform(-0.1, 0.1), rng.uniform(-0.05, 0.05), rng.uniform(0.02, 0.12), 40)
        moving, support = Placed(0, model_, T), supports[int(rng.integers(3))]
        used, new = (s.settle(moving, (), support, 3) for s in (simulator, BulletSimulator(HULLS)))
        assert first_difference(used, new) is None


def test_too_little_around_the_objects_is_none() -> None:
    problem, support = made([Thing(box(*BRICK), at(0.0, 0.0, 0.04))])
    observation = problem.observation
    alone = replace(observation, depth_m=np.where(observation.object_mask, observation.depth_m, np.float32(0)))
    assert observed_surroundings(alone, support) is None
    nothing = replace(observation, object_mask=np.zeros_like(observation.object_mask))
    assert observed_surroundings(nothing, support) is None


def test_surfaces_stay_below_what_is_seen() -> None:
    """No surface covers more than a few of the points of the frame: it would be in the way of what is seen there."""
    problem, support = shelf()
    around = support.surroundings
    observation = problem.observation
    seen = observation.camera.back_project(observation.depth_m.astype(float))[observation.depth_m > 0]
    points = apply(support.T_world_cam, seen)
    for surface in around.surfaces:
        covered = surface.reaches(points[:, :2], -0.01) & (surface.heights(points) < -0.012)
        assert covered.mean() < 0.02
