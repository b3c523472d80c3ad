"""Tracking: which answers of earlier frames a frame begins with, whoever solved them."""

from __future__ import annotations

import tomllib
from dataclasses import replace

import numpy as np
import pytest

from tests.fakes import box_problem
from verefine_viz.core.errors import Cancelled, InputError
from verefine_viz.core.geometry import axis_angle, inverse, transform
from verefine_viz.core.problem import Problem, RecordedStep
from verefine_viz.core.progress_token import NEVER_CANCELLED, ProgressToken
from verefine_viz.core.settings import Session
from verefine_viz.run.session_file import resolve, session_toml
from verefine_viz.run.track import EarlierPose, Track, tracked_poses, with_its_tracked, with_tracked

FRAMES = ("1/4", "1/2", "2/1", "1/3", "2/2", "1/1")
"""In any order, as the page lists them."""


def at(x: float) -> np.ndarray:
    return transform(np.eye(3), [x, 0, 0.5])


def answer(
    frame: str, x: float = 0.0, obj_id: int = 1, instance_id: int = 0, camera: np.ndarray | None = None
) -> EarlierPose:
    return EarlierPose(frame, obj_id, instance_id, at(x), camera)


class Solved:
    """Frames that were solved, each with one answer; some fail."""

    def __init__(self, failing: tuple[str, ...] = ()) -> None:
        self.frames: list[str] = []
        self.failing = failing

    def __call__(self, frame: str) -> tuple[EarlierPose, ...]:
        self.frames.append(frame)
        if frame in self.failing:
            raise InputError("no depth")
        return (answer(frame, x=int(frame[-1])),)


def problem(n: int = 1, frame: int = 9, camera: np.ndarray | None = None) -> Problem:
    made = box_problem(n_instances=n)
    return replace(made, scene_id=1, im_id=frame, observation=replace(made.observation, T_map_cam=camera))


def test_frames_of_the_scene_are_solved_in_order_and_once() -> None:
    solve = Solved()
    track = Track(FRAMES, solve, NEVER_CANCELLED)
    assert track.before("1/1") == track.before("2/1") == {}
    (latest,) = track.before("1/4").values()
    assert (latest.frame, solve.frames) == ("1/3", ["1/1", "1/2", "1/3"])
    (latest,) = track.before("1/3").values()
    assert (latest.frame, len(solve.frames)) == ("1/2", 3)
    assert track.before("7/1") == {}


def test_what_was_solved_elsewhere_is_not_solved_again() -> None:
    solve = Solved()
    track = Track(FRAMES, solve, NEVER_CANCELLED)
    track.recall = lambda frame: None if frame == "1/2" else (answer(frame),)
    assert [a.frame for a in track.before("1/4").values()] == ["1/3"]
    assert solve.frames == ["1/2"]


def test_a_frame_without_an_answer_leaves_the_one_before() -> None:
    track = Track(FRAMES, Solved(failing=("1/2", "1/3")), NEVER_CANCELLED)
    assert [a.frame for a in track.before("1/4").values()] == ["1/1"]


def test_solving_earlier_frames_can_be_cancelled() -> None:
    solve, said = Solved(), list[str]()
    progress = ProgressToken(report=lambda doing, share: said.append(doing), is_wanted=lambda: len(solve.frames) < 2)
    with pytest.raises(Cancelled):
        Track(FRAMES, solve, progress).before("1/4")
    assert solve.frames == ["1/1", "1/2"]
    assert said[0] == "Tracking: frame 1/4 begins with earlier answers; solving 1/1."


def test_the_tracked_pose_comes_first_and_says_where_it_is_from() -> None:
    before = problem()
    recorded = RecordedStep(0, at(0.1))
    instance = replace(before.instances[0], recorded=(recorded,), recorded_scores=(0.5, None))
    before = replace(before, instances=(instance,))
    poses = tracked_poses(before, {(1, 0): answer("1/8", 0.3)})
    after = with_tracked(before, poses).instances[0]
    first, *others = after.hypotheses
    assert np.array_equal(first.T_cam_obj, at(0.3))
    assert first.source == "tracked, the answer of frame 1/8"
    assert [*others] == [*instance.hypotheses]
    assert first.confidence >= max(h.confidence for h in others)
    assert ([s.hypothesis for s in after.recorded], after.recorded_scores) == ([1], (None, 0.5, None))
    assert with_tracked(before, ()) is before


def test_an_object_alone_is_followed_by_its_model_and_one_of_several_by_its_number() -> None:
    alone = tracked_poses(problem(), {(1, 4): answer("1/7", 0.1, instance_id=4), (1, 3): answer("1/8", 0.2)})
    assert [(p.instance, p.answered_in) for p in alone] == [(0, "1/8")]
    two = replace(problem(2), instances=tuple(replace(i, obj_id=1) for i in problem(2).instances))
    known = {(1, 1): answer("1/8", 0.1, instance_id=1)}
    assert [(p.instance, p.T_cam_obj[3]) for p in tracked_poses(two, known)] == [(1, 0.1)]
    assert tracked_poses(problem(), {(9, 0): answer("1/8", obj_id=9)}) == ()


def test_a_pose_moves_along_with_a_camera_that_is_known() -> None:
    first, second = (
        transform(axis_angle([0, 0, 1], 0.1), [0.1, 0, 0]),
        transform(axis_angle([0, 1, 0], 0.2), [0, 0.1, 0]),
    )
    (pose,) = tracked_poses(problem(camera=second), {(1, 0): answer("1/8", 0.3, camera=first)})
    T = np.reshape(pose.T_cam_obj, (4, 4))
    assert np.allclose(second @ T, first @ at(0.3))
    (pose,) = tracked_poses(problem(), {(1, 0): answer("1/8", 0.3, camera=first)})
    assert np.array_equal(np.reshape(pose.T_cam_obj, (4, 4)), at(0.3))
    assert not np.allclose(T, inverse(second))


def test_a_session_states_what_a_frame_began_with_to_the_last_bit() -> None:
    poses = tracked_poses(problem(), {(1, 0): answer("1/8", 0.1 + 1e-17 + 1 / 3)})
    session = with_its_tracked(Session(), with_tracked(problem(), poses))
    assert session.tracked == poses
    assert resolve(tomllib.loads(session_toml(session))).tracked == poses
    assert with_its_tracked(session, problem()).tracked == ()
    other = problem(frame=10)
    assert with_its_tracked(session, other).tracked == poses
