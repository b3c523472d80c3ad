"""Where no true pose is known, first poses tell of depth and cameras that are not those they were estimated for."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from tests.scenes.sizes import scene
from verefine_viz.core.arrays import Float
from verefine_viz.core.problem import Hypothesis, Instance, Problem
from verefine_viz.scenes.answer_fit import answer_notes, start_notes
from verefine_viz.scenes.first_fit import depth_notes, pull_notes

CLUTTER = scene()


def moved(instance: Instance, by_mm: Float) -> Float:
    """The true pose, somewhere else."""
    assert instance.T_cam_obj_gt is not None
    T = np.array(instance.T_cam_obj_gt)
    T[:3, 3] += 1e-3 * by_mm
    return T


def estimated(off_mm: float, depth: float = 1.0) -> Problem:
    """Without ground truth, with first poses as an estimator might give them, and depth multiplied."""
    rng = np.random.default_rng(0)
    instances = tuple(
        replace(i, T_cam_obj_gt=None, hypotheses=(Hypothesis(moved(i, rng.normal(0, off_mm, 3)), 1.0, "cosypose"),))
        for i in CLUTTER.instances
    )
    seen = replace(CLUTTER.observation, depth_m=CLUTTER.observation.depth_m * np.float32(depth))
    return replace(CLUTTER, instances=instances, observation=seen)


def found(focal: float, pull: Callable[[int], bool] = lambda k: True) -> list[Float]:
    """Poses as refinement finds them with fx and fy multiplied: depth holds z, and pixels the direction."""
    poses = [moved(i, np.zeros(3)) for i in CLUTTER.instances]
    for k, T in enumerate(poses):
        T[:2, 3] /= focal if pull(k) else 1 / focal
    return poses


@pytest.mark.parametrize(
    ("depth", "said"),
    [
        (0.5, "50% smaller than the first poses say: check depth_scale in scene_camera.json (about 2.0"),
        (0.9, "(about 1.1"),
        (1.1, "larger"),
        (2.0, "(about 0.50 times as much would fit)"),
    ],
)
def test_depth_that_is_off_by_a_factor_is_told_before_the_run(depth: float, said: str) -> None:
    (note,) = start_notes(estimated(5.0, depth))
    assert said in note


@pytest.mark.parametrize("off_mm", [0.0, 5.0, 30.0])
def test_right_depth_is_not_doubted(off_mm: float) -> None:
    assert not depth_notes(estimated(off_mm))


@pytest.mark.parametrize(
    ("focal", "said"), [(0.8, "farther from the image's centre"), (1.2, "nearer to the image's centre")]
)
def test_objects_that_are_all_pulled_from_the_centre_tell_of_the_camera(focal: float, said: str) -> None:
    (note,) = pull_notes(estimated(3.0), found(focal))
    assert said in note
    assert f"too {'small' if focal < 1 else 'large'}, about {1 / focal:.1f}" in note
    assert answer_notes(estimated(3.0), found(focal)) == (note,)


def displaced(dx: float, dy: float, wide: float = 1.0, high: float = 1.0) -> list[Float]:
    """Poses as refinement finds them with cx, cy moved [px], or fx, fy multiplied."""
    poses = [moved(i, np.zeros(3)) for i in CLUTTER.instances]
    camera = CLUTTER.observation.camera
    for T in poses:
        T[:2, 3] = T[:2, 3] / [wide, high] - np.array([dx / camera.fx, dy / camera.fy]) * T[2, 3]
    return poses


@pytest.mark.parametrize(
    ("dx", "dy", "moves", "off"),
    [
        (40, 0, "all objects 40 px left in the image", "cx of cam_K looks 40 px too large; check"),
        (0, -25, "all objects 25 px down in the image", "cy of cam_K looks 25 px too small; check"),
        (
            -30,
            60,
            "30 px right and 60 px up",
            "cx of cam_K looks 30 px too small and cy of cam_K",
        ),
    ],
)
def test_objects_that_are_all_moved_the_same_way_tell_of_the_principal_point(
    dx: float, dy: float, moves: str, off: str
) -> None:
    (note,) = pull_notes(estimated(0.0), displaced(dx, dy))
    assert moves in note
    assert off in note
    (rough,) = pull_notes(estimated(3.0), displaced(dx, dy))
    assert "refinement moved all objects" in rough
    assert answer_notes(estimated(3.0), displaced(dx, dy)) == (rough,)


@pytest.mark.parametrize(
    ("wide", "high", "said"),
    [
        (
            1.2,
            1.0,
            "centre sideways than their first poses: fx of cam_K looks too large, about 0.8",
        ),
        (1.0, 0.8, "centre up and down than their first poses: fy of cam_K looks too small, about 1.2"),
        (1.2, 1.2, "centre than their first poses: fx and fy of cam_K look too large, about 0.8"),
    ],
)
def test_of_several_explanations_the_one_that_leaves_the_least_is_named(wide: float, high: float, said: str) -> None:
    (note,) = pull_notes(estimated(2.0), displaced(0, 0, wide, high))
    assert said in note


def test_a_small_or_uncertain_displacement_tells_nothing() -> None:
    assert not pull_notes(estimated(0.0), displaced(8, 0))
    assert not pull_notes(estimated(30.0), displaced(40, 0))
    ids = [i.instance_id for i in CLUTTER.instances[:2]]
    assert not pull_notes(estimated(0.0).only(ids), displaced(40, 0)[:2])
    some = [T if k % 2 else other for k, (T, other) in enumerate(zip(displaced(40, 0), displaced(0, 0), strict=True))]
    assert not pull_notes(estimated(0.0), some), "half of them stay"


def test_first_poses_that_lie_far_apart_tell_nothing_though_their_middle_does() -> None:
    problem = estimated(0.0)
    ways = ([30.0, 0, 0], [-30.0, 0, 0], [0, 30.0, 0], [0, -30.0, 0])
    scattered = tuple(
        replace(i, hypotheses=tuple(Hypothesis(moved(known, np.array(way)), 1.0, "ppf") for way in ways))
        for i, known in zip(problem.instances, CLUTTER.instances, strict=True)
    )
    assert pull_notes(problem, displaced(40, 0))
    assert not pull_notes(replace(problem, instances=scattered), displaced(40, 0))


def test_three_objects_that_move_alike_by_chance_tell_nothing_of_one_axis_or_of_the_principal_point() -> None:
    three = estimated(0.0).only([i.instance_id for i in CLUTTER.instances[:3]])
    for seed in range(40):
        rng = np.random.default_rng(seed)
        found = [moved(i, rng.normal(0, 25, 3) * [1, 1, 0]) for i in CLUTTER.instances[:3]]
        told = " ".join(pull_notes(three, found))
        assert not any(words in told for words in ("all objects", "sideways", "up and down"))


@pytest.mark.parametrize("off_mm", [0.0, 3.0, 30.0])
def test_refinement_that_moves_each_object_its_own_way_tells_nothing(off_mm: float) -> None:
    assert not pull_notes(estimated(off_mm), found(1.0))
    assert not pull_notes(estimated(off_mm), found(1.2, lambda k: k % 2 == 0))


def test_first_poses_far_off_tell_nothing_of_a_pull() -> None:
    assert not pull_notes(estimated(60.0), found(0.8))


def test_two_objects_are_too_few() -> None:
    ids = [i.instance_id for i in CLUTTER.instances[:2]]
    assert not depth_notes(estimated(5.0, 0.5).only(ids))
    assert not pull_notes(estimated(3.0).only(ids), found(0.8)[:2])


def test_objects_without_answer_or_first_pose_are_left_out() -> None:
    problem = estimated(3.0)
    some = replace(problem, instances=(replace(problem.instances[0], hypotheses=()), *problem.instances[1:]))
    poses = found(0.8)
    assert pull_notes(some, [poses[0], None, *poses[2:]])
    assert not pull_notes(some, [None] * len(poses))


def test_true_poses_tell_more() -> None:
    known = replace(estimated(3.0, 0.5), instances=CLUTTER.instances)
    assert not start_notes(known)
    assert not answer_notes(known, found(0.8))
