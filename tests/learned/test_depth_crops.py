"""What the network sees, against the score's own renderer and plain numpy; and that a step undoes what made it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.fakes import box_model, box_problem
from tests.rendering.witness import cast
from verefine_viz.core.camera import Camera
from verefine_viz.core.geometry import angle_between, apply, axis_angle, random_unit_vector, transform
from verefine_viz.core.geometry import rotation_vector as vector_of
from verefine_viz.learned.depth_crops import (
    CHANNELS,
    DEEPEST,
    REACH,
    SIDE_PX,
    DepthCrops,
    crops_at,
    extent_of,
    fill_crop,
    moved_by,
    rotation_by,
)
from verefine_viz.rendering.mesh import render_mesh

SEEDS = st.integers(0, 2**32 - 1)
MODEL = box_model()
MESH = render_mesh(MODEL.vertices, MODEL.faces)
EXTENT = extent_of(MODEL.vertices, MODEL.diameter_m)
OBSERVED, RENDERED, DIFFERENCE, OWN, DRAWN, MEASURED = range(len(CHANNELS))


def random_pose(rng: np.random.Generator, off_axis: float = 0.25) -> np.ndarray:
    z = rng.uniform(0.4, 0.9)
    place = np.array([*rng.uniform(-off_axis, off_axis, 2) * z, z])
    return transform(axis_angle(random_unit_vector(rng), rng.uniform(0, np.pi)), place)


def at(T: np.ndarray, depth_m: np.ndarray, mask: np.ndarray, camera: Camera) -> DepthCrops:
    return crops_at(depth_m.astype(np.float32), mask, camera, MESH, EXTENT, T[None])


def pictured(T: np.ndarray) -> tuple[np.ndarray, np.ndarray, Camera]:
    """Perfect depth of the box at a pose by ray casting, its mask, and the camera."""
    camera = Camera(np.array([[500.0, 0, 299.5], [0, 500.0, 299.5], [0, 0, 1]]), 600, 600)
    depth_m, _, labels = cast([(MODEL, T)], camera)
    return np.where(labels >= 0, depth_m, 0.0), labels >= 0, camera


@settings(max_examples=40)
@given(SEEDS)
def test_a_pose_that_is_right_shows_no_difference(seed: int) -> None:
    """Observed by ray casting, drawn by our rasteriser in the virtual camera: inside the outline both are the same."""
    T = random_pose(np.random.default_rng(seed))
    depth_m, mask, camera = pictured(T)
    crop = at(T, depth_m, mask, camera).channels[0]
    both = (crop[OWN] > 0) & (crop[DRAWN] > 0)
    assert both.sum() > 80
    gap = np.abs(crop[OBSERVED] - crop[RENDERED])[both]
    # A crop reads the nearest pixel of the image, up to 0.7 px beside the ray: at a slant that is a few millimetres.
    assert np.median(gap) < 0.02
    assert np.mean((crop[OWN] > 0) == (crop[DRAWN] > 0)) > 0.95
    assert np.array_equal(crop[OWN], crop[MEASURED])


@given(SEEDS)
def test_crops_look_alike_wherever_the_object_is(seed: int) -> None:
    """Turned about the camera's centre, object and pose give the same drawing: it is the virtual camera's."""
    rng = np.random.default_rng(seed)
    T = random_pose(rng, 0.0)
    turned = transform(axis_angle([*rng.normal(size=2), 0.0], rng.uniform(0, 0.3)), np.zeros(3)) @ T
    nothing, camera = np.zeros((60, 80)), Camera(np.array([[80.0, 0, 39.5], [0, 80.0, 29.5], [0, 0, 1]]), 80, 60)
    first, second = (at(pose, nothing, nothing > 0, camera).channels[0, RENDERED] for pose in (T, turned))
    # Pixels on an edge may fall to either side.
    assert np.mean(np.abs(first - second) > 1e-3) < 0.01


@given(SEEDS)
def test_a_step_brings_the_object_where_it_points(seed: int) -> None:
    """The step is worked out in the camera's frame by plain algebra; carried out, it gives the wanted pose."""
    rng = np.random.default_rng(seed)
    T, wanted = random_pose(rng), random_pose(rng)
    model_middle = np.array([0.01, -0.02, 0.03])
    extent = extent_of(MODEL.vertices + model_middle, MODEL.diameter_m)
    R_crop = at(T, np.zeros((4, 4)), np.zeros((4, 4), bool), Camera(np.diag([9.0, 9, 1]), 4, 4)).Rs_crop_cam[0]
    turn = R_crop @ wanted[:3, :3] @ T[:3, :3].T @ R_crop.T
    middles = [apply(pose, model_middle[None])[0] for pose in (T, wanted)]
    step = np.concatenate([vector_of(turn), R_crop @ (middles[1] - middles[0]) / extent.radius_m])
    result = moved_by(T, step, R_crop, extent)
    np.testing.assert_allclose(result, wanted, atol=1e-9)


@given(SEEDS)
def test_the_virtual_camera_looks_at_the_object(seed: int) -> None:
    T = random_pose(np.random.default_rng(seed), 1.5)
    R = at(T, np.zeros((4, 4)), np.zeros((4, 4), bool), Camera(np.diag([9.0, 9, 1]), 4, 4)).Rs_crop_cam[0]
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-9)
    assert np.linalg.det(R) > 0
    middle = T[:3, 3]
    np.testing.assert_allclose(R @ middle, [0, 0, np.linalg.norm(middle)], atol=1e-9)
    assert angle_between(R, np.eye(3)) == pytest.approx(np.arccos(middle[2] / np.linalg.norm(middle)), abs=1e-6)


@given(SEEDS, st.floats(0, 3))
def test_rotation_vectors_are_those_of_the_geometry(seed: int, angle: float) -> None:
    axis = random_unit_vector(np.random.default_rng(seed))
    np.testing.assert_allclose(rotation_by(axis * angle), axis_angle(axis, angle), atol=1e-12)


def test_what_is_in_front_or_not_in_the_mask_is_no_part_of_the_object() -> None:
    T = transform(np.eye(3), [0.0, 0.0, 0.6])
    depth_m, mask, camera = pictured(T)
    left = np.arange(600) < 300
    depth_m = np.where(left & (depth_m > 0), 0.3, depth_m)
    crop = at(T, depth_m, mask & ~left, camera).channels[0]
    seen_left = (crop[MEASURED] > 0) & (np.arange(SIDE_PX) < SIDE_PX // 2 - 1)
    assert seen_left.any()
    assert (crop[OWN][seen_left] == 0).all()
    assert (crop[DIFFERENCE][seen_left] == 0).all()
    assert (crop[OBSERVED][seen_left] == -DEEPEST).all()


def test_where_nothing_can_be_seen_or_was_measured_the_crop_is_not_used() -> None:
    depth_m, mask, camera = pictured(transform(np.eye(3), [0.0, 0.0, 0.6]))
    for place, why in (
        ((0, 0, -0.6), "behind"),
        ((0, 0, 0.05), "around the camera"),
        ((40, 0, 0.6), "beside the image"),
    ):
        assert not at(transform(np.eye(3), place), depth_m, mask, camera).is_usable[0], why
    T = transform(np.eye(3), [0.0, 0.0, 0.6])
    depth_m, mask, camera = pictured(T)
    for bad in (np.nan, np.inf, -1.0, 0.0):
        crop = at(T, np.full_like(depth_m, bad), mask, camera)
        assert not crop.is_usable[0]
        assert (crop.channels[0, [OBSERVED, DIFFERENCE, OWN, MEASURED]] == 0).all()


def test_several_poses_are_seen_as_each_alone() -> None:
    problem = box_problem()
    target = problem.targets[0]
    Ts = np.stack([h.T_cam_obj for h in target.instance.hypotheses])
    o = problem.observation
    together = crops_at(o.depth_m, target.instance.mask, o.camera, MESH, EXTENT, Ts)
    for k, T in enumerate(Ts):
        alone = at(T, np.asarray(o.depth_m), target.instance.mask, o.camera)
        assert np.array_equal(together.channels[k], alone.channels[0])
    assert together.channels.shape[1:] == (len(CHANNELS), SIDE_PX, SIDE_PX)
    assert REACH > 1


def test_compiles_once_for_all_kinds_of_input() -> None:
    """Read-only arrays are another type to numba: a frame's and a model's are, those of training are not."""
    T = transform(np.eye(3), [0.0, 0.0, 0.6])
    depth_m, mask, camera = pictured(T)
    for vertices in (MODEL.vertices, MODEL.vertices.copy()):
        crops_at(np.float32(depth_m), mask, camera, render_mesh(vertices, MODEL.faces), EXTENT, T[None])
    assert len(fill_crop.signatures) == 1
