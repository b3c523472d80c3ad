"""What does not fit together in a frame is named with what would fit; frames that are right are not doubted."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.calibration.sizes import real, scene
from tests.made_up_frames import Thing, frame_of, model, standing
from verefine_viz.calibration.consistency import data_doubts
from verefine_viz.core.arrays import Float
from verefine_viz.core.camera import Camera
from verefine_viz.core.data_remedies import TO_OPENGL
from verefine_viz.core.geometry import axis_angle, inverse, random_unit_vector, transform
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.problem import Hypothesis, Instance, Problem
from verefine_viz.scenes.demo_layout import Viewpoint

YCBV = Path(__file__).resolve().parents[3] / "shared" / "data" / "ycbv"
FRAMES = [("clutter", "0/0"), ("clutter", "0/2"), ("stack", "0/1"), ("mug", "0/0"), ("duck", "0/0"), ("bracket", "0/0")]


def frames() -> list[Problem]:
    made = [scene(*frame) for frame in FRAMES]
    return [*made, *(real(YCBV, frame) for frame in ("0/1", "49/2365", "50/1") if YCBV.is_dir())]


def with_depth(problem: Problem, factor: float | Float) -> Problem:
    seen = problem.observation
    return replace(problem, observation=replace(seen, depth_m=(seen.depth_m * factor).astype(np.float32)))


def with_truth(problem: Problem, change: Callable[[Float], Float]) -> Problem:
    def one(i: Instance) -> Instance:
        return i if i.T_cam_obj_gt is None else replace(i, T_cam_obj_gt=change(i.T_cam_obj_gt))

    return replace(problem, instances=tuple(map(one, problem.instances)))


def estimated(problem: Problem, change: Callable[[Float], Float]) -> Problem:
    """The frame with poses of an estimator in place of the ground truth."""

    def one(i: Instance) -> Instance:
        if i.T_cam_obj_gt is None:
            return replace(i, hypotheses=())
        return replace(i, T_cam_obj_gt=None, hypotheses=(Hypothesis(change(i.T_cam_obj_gt), 1.0, "est"),))

    return replace(problem, instances=tuple(map(one, problem.instances)))


def scaled(m: ObjectModel, factor: float) -> ObjectModel:
    return replace(m, vertices=m.vertices * factor, points=m.points * factor, diameter_m=m.diameter_m * factor)


def with_models(problem: Problem, factor: float) -> Problem:
    return replace(problem, models={obj_id: scaled(m, factor) for obj_id, m in problem.models.items()})


def moved(factor: float) -> Callable[[Float], Float]:
    return lambda T: transform(T[:3, :3], factor * T[:3, 3])


def off(rng: np.random.Generator, deg: float, mm: float) -> Callable[[Float], Float]:
    """A disturbance, another one at each call."""

    def change(T: Float) -> Float:
        R = axis_angle(random_unit_vector(rng), np.radians(deg)) @ T[:3, :3]
        return transform(R, T[:3, 3] + 1e-3 * mm * random_unit_vector(rng))

    return change


Z_UP = transform(axis_angle(np.array([1.0, 0.0, 0.0]), np.pi / 2), np.zeros(3))
FAULTS: dict[str, tuple[Callable[[Problem], Problem], str]] = {
    **{f"depth × {f:g}": (lambda p, f=f: with_depth(p, f), "depth that is") for f in (10.0, 0.1, 1000.0, 0.001)},
    **{f"models × {f:g}": (lambda p, f=f: with_models(p, f), "models that are") for f in (10.0, 0.1)},
    **{f"truth × {f:g}": (lambda p, f=f: with_truth(p, moved(f)), "translations that") for f in (10.0, 0.1, 0.001)},
    **{f"estimates × {f:g}": (lambda p, f=f: estimated(p, moved(f)), "translations that") for f in (10.0, 0.001)},
    "inverse": (lambda p: with_truth(p, inverse), "the inverse poses"),
    "inverse estimates": (lambda p: estimated(p, inverse), "the inverse poses"),
    "OpenGL": (lambda p: with_truth(p, lambda T: TO_OPENGL @ T), "OpenGL"),
    "OpenGL estimates": (lambda p: estimated(p, lambda T: TO_OPENGL @ T), "OpenGL"),
    "by columns": (lambda p: with_truth(p, lambda T: transform(T[:3, :3].T, T[:3, 3])), "transposed rotations"),
    "y up": (lambda p: with_truth(p, lambda T: T @ Z_UP), "turned by -90° about x"),
    "inverted masks": (
        lambda p: replace(p, instances=tuple(replace(i, mask=~i.mask) for i in p.instances)),
        "inverted masks",
    ),
}


@pytest.mark.parametrize("name", FAULTS)
def test_a_mistake_is_named_by_what_would_fit(name: str):
    spoil, words = FAULTS[name]
    of_all = frames()
    named = sum(any(words in doubt.text for doubt in data_doubts(spoil(problem))) for problem in of_all)
    assert named == len(of_all)


@pytest.mark.parametrize("deg_mm", [(0.0, 0.0), (15.0, 15.0), (40.0, 40.0)])
def test_right_frames_are_not_doubted_whatever_their_estimates(deg_mm: tuple[float, float]):
    rng = np.random.default_rng(0)
    for problem in frames():
        assert data_doubts(problem) == ()
        for _ in range(10):
            assert data_doubts(estimated(problem, off(rng, *deg_mm))) == ()


def test_a_unit_is_named_through_the_error_of_estimates():
    rng = np.random.default_rng(1)
    for problem in frames():
        disturb = off(rng, 15, 15)
        (doubt,) = data_doubts(estimated(problem, lambda T, d=disturb: moved(10)(d(T))))
        assert "the pose" in doubt.text
        assert "of est" in doubt.text
        assert "translations that are 10 times smaller would fit" in doubt.text


@pytest.mark.parametrize("change", [moved(10), lambda T: transform(T[:3, :3], np.zeros(3))])
def test_one_object_that_is_off_is_named_alone(change: Callable[[Float], Float]):
    problem = scene("clutter", "0/0")
    first, *others = sorted(problem.instances, key=lambda i: -int(np.count_nonzero(i.mask)))
    assert first.T_cam_obj_gt is not None
    spoiled = replace(problem, instances=(replace(first, T_cam_obj_gt=change(first.T_cam_obj_gt)), *others))
    (doubt,) = data_doubts(spoiled)
    assert problem.models[first.obj_id].name in doubt.text
    assert not any(problem.models[other.obj_id].name in doubt.text for other in others)


def test_masks_in_another_order_are_named():
    problem = scene("clutter", "0/0")
    a, b = sorted(problem.instances, key=lambda i: -int(np.count_nonzero(i.mask)))[:2]
    swapped = {a.instance_id: b.mask, b.instance_id: a.mask}
    spoiled = tuple(replace(i, mask=swapped.get(i.instance_id, i.mask)) for i in problem.instances)
    said = data_doubts(replace(problem, instances=spoiled))
    assert len(said) == 2
    assert all("masks and poses look as if they were in another order" in doubt.text for doubt in said)


def wide_frame() -> Problem:
    """Four objects at the edge of the picture of a wide lens."""
    camera = Camera(np.array([[280.0, 0, 319.5], [0, 280.0, 239.5], [0, 0, 1]]), 640, 480)
    rng, things = np.random.default_rng(2), []
    for k, name in enumerate(("jug", "carton", "block", "bottle")):
        m = model(name)
        T = standing(m, rng, 0.01)
        T[:2, 3] += 0.32 * np.array([np.cos(k * np.pi / 2), np.sin(k * np.pi / 2)])
        things.append(Thing(m, T))
    return frame_of(things, rng, Viewpoint(20, 60, 0.6), camera=camera)


def test_distances_in_place_of_depth_are_named_where_the_lens_is_wide():
    problem = wide_frame()
    camera = problem.observation.camera
    assert data_doubts(problem) == ()
    v, u = np.indices(camera.shape)
    rays = np.sqrt(1 + ((u - camera.cx) / camera.fx) ** 2 + ((v - camera.cy) / camera.fy) ** 2)
    (doubt,) = data_doubts(with_depth(problem, rays))
    assert "the depth images seem to hold distances" in doubt.text


def test_what_no_mistake_explains_is_said_to_be_unexplained_and_a_camera_goes_before():
    problem = scene("clutter", "0/0")
    rng = np.random.default_rng(3)
    (doubt,) = data_doubts(with_truth(problem, lambda T: T @ transform(np.eye(3), 0.4 * random_unit_vector(rng))))
    assert "no other unit or convention would fit" in doubt.text
    camera = problem.observation.camera
    half = Camera(np.diag([0.5, 0.5, 1.0]) @ camera.K, camera.width, camera.height)
    spoiled = replace(problem, observation=replace(problem.observation, camera=half))
    assert any("images of another size" in doubt.text for doubt in data_doubts(spoiled))


def test_a_frame_without_any_pose_is_not_doubted():
    problem = scene("clutter", "0/0")
    blind = tuple(replace(i, T_cam_obj_gt=None, hypotheses=()) for i in problem.instances)
    assert data_doubts(replace(problem, instances=blind)) == ()


def test_a_data_set_in_metres_throughout_is_named_as_that():
    for frame in FRAMES:
        problem = scene(*frame)
        small = with_models(with_truth(problem, moved(0.001)), 0.001)
        assert "models and translations that are both 1000 times as large would fit" in data_doubts(small)[0].text, (
            frame
        )
        (doubt,) = data_doubts(with_depth(small, 0.001))
        assert "the whole data set looks as if it was in metres, expected millimetres" in doubt.text, frame
