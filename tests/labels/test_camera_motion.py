"""The camera's motion between two frames: by its poses, by registration, or unknown."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np

from tests.labels.moving_camera_frames import Shot, path, shot, things, without_camera_pose
from tests.made_up_frames import Z, moved
from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import angle_between, apply, axis_angle, inverse, transform
from verefine_viz.core.observation import Observation
from verefine_viz.core.settings import SceneSettings
from verefine_viz.labels.camera_motion import CameraMotion, UnknownMotion, camera_motion
from verefine_viz.observation.observed_frame import observe

MIDDLE = np.array([[0.0, 0.0, 0.7]])
"""A point of the scene in the camera frame [m]."""


@cache
def shots(n: int = 6, with_colour: bool = True) -> Sequence[Shot]:
    """The first frames of a sequence."""
    there = things()
    return [shot(there, T, k, with_colour=with_colour) for k, T in enumerate(path(n))]


def assert_right(motion: CameraMotion | UnknownMotion, a: Shot, b: Shot, mm: float = 1.0, deg: float = 0.5) -> None:
    """A motion is off the true one by less, at the scene's middle."""
    assert isinstance(motion, CameraMotion), motion.words
    truth = inverse(b.T_world_cam) @ a.T_world_cam
    off_mm = 1e3 * np.linalg.norm(apply(motion.T_next_last, MIDDLE) - apply(truth, MIDDLE))
    assert off_mm < mm, motion.words
    assert np.degrees(angle_between(truth[:3, :3], motion.T_next_last[:3, :3])) < deg, motion.words


def registered(a: Shot, b: Shot) -> CameraMotion | UnknownMotion:
    """By the images alone."""
    seen = without_camera_pose(a.observation), without_camera_pose(b.observation)
    return camera_motion(*seen, a.placed)


def test_frames_are_registered_where_no_camera_poses_are_stated() -> None:
    for with_colour in (True, False):
        frames = shots(6, with_colour)
        for a, b in pairwise(frames):
            assert_right(registered(a, b), a, b)


def test_labelled_objects_decide_where_the_rest_is_bare() -> None:
    a, b = shots(2, False)
    bare_a, bare_b = (shot([], T, k, with_colour=False) for k, T in enumerate(path(2)))
    assert isinstance(registered(bare_a, bare_b), UnknownMotion)
    assert_right(registered(a, b), a, b)


def test_an_object_that_moved_does_not_take_the_camera_along() -> None:
    there, (T_a, T_b) = things(), path(2)
    (duck, T_duck), rest = there[2], there[:2]
    after = [*rest, (duck, moved(T_duck, Z, 15.0, (30.0, 15.0, 0.0)))]
    a, b = shot(there, T_a, 0), shot(after, T_b, 1)
    assert_right(registered(a, b), a, b, mm=2.0)


def test_camera_poses_are_taken_as_they_are_and_a_jump_is_not_believed() -> None:
    a, b = shots(2)
    seen, following = a.observation, b.observation
    stated = camera_motion(seen, following, a.placed)
    assert isinstance(stated, CameraMotion)
    assert stated.source == "camera poses"
    assert np.allclose(stated.T_next_last, inverse(b.T_world_cam) @ a.T_world_cam, atol=1e-12)
    assert stated.explained > 0.9
    jumps: dict[str, Float] = {
        "along the table": transform(np.eye(3), [0.03, 0.0, 0.0]),
        "up": transform(np.eye(3), [0.0, 0.0, 0.03]),
        "far": transform(np.eye(3), [0.4, 0.2, 0.0]),
        "turned about the vertical": transform(axis_angle(Z, np.radians(6)), np.zeros(3)),
        "millimetres taken for metres": transform(np.eye(3), [25.0, 0.0, 0.0]),
    }
    for name, jump in jumps.items():
        motion = camera_motion(seen, replace(following, T_map_cam=jump @ b.T_world_cam), a.placed)
        assert_right(motion, a, b)
        assert getattr(motion, "source", "") == "registered", name


def test_a_known_rotation_leaves_the_position_to_registration() -> None:
    a, b = (with_rotation(shot) for shot in shots(2))
    motion = camera_motion(a.observation, b.observation, a.placed)
    assert_right(motion, a, b, deg=1e-6)
    wrong = with_rotation(b, axis_angle(Z, np.radians(40)))
    assert_right(camera_motion(a.observation, wrong.observation, a.placed), a, b)


def test_frames_that_do_not_belong_together_have_no_motion() -> None:
    a, b = shots(2)[0], shot(things((("can", 0.1, 0.1, 0.0),)), path(60)[-1], 1)
    assert isinstance(registered(a, b), UnknownMotion)
    nothing = replace(b.observation, depth_m=np.zeros_like(b.observation.depth_m), T_map_cam=None)
    for pair in ((a.observation, nothing), (nothing, a.observation)):
        assert isinstance(camera_motion(*pair, ()), UnknownMotion)


def with_rotation(one: Shot, wrong: Float | None = None) -> Shot:
    """A frame that states which way its camera looks, and not where it is."""
    R = one.T_world_cam[:3, :3] if wrong is None else wrong @ one.T_world_cam[:3, :3]
    seen: Observation = one.observation
    settings = SceneSettings(gravity="world")
    return replace(one, observation=observe(seen.camera, seen.depth_m, seen.rgb, [], settings, R))
