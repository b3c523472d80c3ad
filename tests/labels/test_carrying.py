"""Labels carried over frames of a moving camera: right, followed, hidden, or stopping for a person."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from tests.labels.moving_camera_frames import Shot, path, shot, things, true_labels, without_camera_pose
from tests.made_up_frames import Z, moved
from verefine_viz.core.geometry import angle_between, apply, transform
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.observation import Observation
from verefine_viz.core.settings import HypothesesSettings, SceneSettings
from verefine_viz.labels.camera_motion import CameraMotion, UnknownMotion
from verefine_viz.labels.carrying import CarriedFrame, carried_on
from verefine_viz.run.session_file import resolve
from verefine_viz.run.toolbox import Toolbox
from verefine_viz.scenes.labels import Label
from verefine_viz.scenes.source import open_scene
from verefine_viz.scenes.unlabelled_frames import unlabelled_frames

pytestmark = pytest.mark.usefixtures("long_run")
DUCK, BOTTLE = 2, 1
MOST_MM, MOST_DEG = 3.0, 5.0
"""A label that is further from the truth is wrong."""


@dataclass(frozen=True)
class MadeUp:
    """Shots as the frames of a folder."""

    shots: Sequence[Shot]
    with_camera_poses: bool = True
    title: str = "made up"

    @property
    def frames(self) -> tuple[str, ...]:
        return tuple(f"0/{k}" for k in range(len(self.shots)))

    @property
    def models(self) -> MadeUp:
        return self

    @property
    def ids(self) -> tuple[int, ...]:
        return tuple(one.model.obj_id for one in self.shots[0].placed)

    def name(self, obj_id: int) -> str:
        return self.get(obj_id).name

    def get(self, obj_id: int) -> ObjectModel:
        return next(one.model for one in self.shots[0].placed if one.model.obj_id == obj_id)

    def notes(self, obj_id: int) -> tuple[str, ...]:
        return ()

    def observation(self, frame: str, masks: Sequence[object] = ()) -> tuple[Observation, tuple[str, ...]]:
        seen = self.shots[self.frames.index(frame)].observation
        return (seen if self.with_camera_poses else without_camera_pose(seen)), ()


@cache
def tools() -> Toolbox:
    """Solids as hulls: nothing here is hollow."""
    return Toolbox(resolve({"physics": {"collider": "hull"}}))


def is_right(label: Label, shot: Shot) -> bool:
    """Whether a label is next to the truth, up to symmetries."""
    one = next(one for one in shot.placed if one.instance_id == label.instance)
    middles = [apply(T, one.model.middle_m[None]) for T in (one.T_cam_obj, label.pose)]
    turns = [angle_between(label.pose[:3, :3], (one.T_cam_obj @ S)[:3, :3]) for S in one.model.symmetries]
    return bool(1e3 * np.linalg.norm(middles[1] - middles[0]) < MOST_MM and np.degrees(min(turns)) < MOST_DEG)


def carried_over(shots: Sequence[Shot], with_camera_poses: bool = True) -> list[CarriedFrame]:
    """From the first of them, up to a stop."""
    frames = MadeUp(shots, with_camera_poses)
    return [*carried_on(tools(), frames, frames.frames, true_labels(shots[0]))]


def test_twenty_frames_of_a_moving_camera_are_labelled_with_two_stops_at_most() -> None:
    there = things()
    shots = [shot(there, T, k) for k, T in enumerate(path(20))]
    frames, labels, stops, done = MadeUp(shots, with_camera_poses=False), true_labels(shots[0]), 0, 0
    while done < len(shots) - 1:
        for step in carried_on(tools(), frames, frames.frames[done:], labels):
            done += 1
            assert step.frame == frames.frames[done]
            assert len(step.labels) == len(there), step.notes
            wrong = [label for label in step.labels if not is_right(label, shots[done])]
            assert all(label.light == "red" for label in wrong), (step.frame, wrong)
            if step.stops:
                stops, labels = stops + 1, true_labels(shots[done])
    assert stops <= 2


def test_a_jump_of_the_camera_poses_is_not_believed() -> None:
    there, Ts = things(), path(3)
    a, b, c = (shot(there, T, k) for k, T in enumerate(Ts))
    jumped = transform(np.eye(3), [0.06, 0.02, 0.0]) @ Ts[1]
    steps = carried_over([a, replace(b, observation=replace(b.observation, T_map_cam=jumped)), c])
    sources = [step.motion.source for step in steps if isinstance(step.motion, CameraMotion)]
    assert sources == ["registered", "registered"]  # To the jump, and back.
    for step, seen in zip(steps, (b, c), strict=True):
        assert all(is_right(label, seen) for label in step.labels), step.frame


def test_an_object_that_moved_is_followed_and_one_that_is_gone_stops() -> None:
    (*rest, (duck, T_duck)), Ts = things(), path(2)
    a = shot([*rest, (duck, T_duck)], Ts[0], 0)
    b = shot([*rest, (duck, moved(T_duck, Z, 12.0, (25.0, -10.0, 0.0)))], Ts[1], 1)
    (step,) = carried_over([a, b])
    assert all(is_right(label, b) for label in step.labels)
    (step,) = carried_over([a, shot(rest, Ts[1], 1)])
    assert step.stops
    assert step.labels[DUCK].state == "proposed"


def test_a_hidden_object_is_carried_unseen_and_labelled_again() -> None:
    there, Ts = things(), path(3)
    shots = [shot(there, T, k) for k, T in enumerate(Ts)]
    front = np.zeros(shots[1].observation.camera.shape, np.bool_)
    bottle = shots[1].placed[BOTTLE]
    u, v = np.rint(shots[1].observation.camera.project(apply(bottle.T_cam_obj, bottle.model.points))).astype(int).T
    front[v.min() - 4 : v.max() + 5, u.min() - 4 : u.max() + 5] = True
    shots[1] = shot(there, Ts[1], 1, front)
    hidden, again = carried_over(shots)
    assert [label.instance for label in hidden.unseen] == [BOTTLE]
    assert BOTTLE not in [label.instance for label in hidden.labels]
    assert not again.unseen
    assert all(is_right(label, shots[2]) for label in again.labels)


def test_frames_of_another_place_stop_at_once() -> None:
    a, b = shot(things(), path(1)[0], 0), shot(things((("can", 0.1, 0.1, 0.0),)), path(60)[-1], 1)
    steps = carried_over([a, b, a], with_camera_poses=False)
    assert len(steps) == 1
    assert isinstance(steps[0].motion, UnknownMotion)


def test_real_frames_are_labelled_from_the_first(shared_data: Path) -> None:
    folder = str(shared_data / "ycbv")
    source = open_scene(SceneSettings(source="bop", dataset=folder), HypothesesSettings())
    problems = [source.problem(f"0/{k}") for k in (1, 3, 5)]
    labels = [
        Label(i.instance_id, i.obj_id, "", tuple(i.T_cam_obj_gt.ravel().tolist()), "green", state="accepted")
        for i in problems[0].instances
        if i.T_cam_obj_gt is not None
    ]
    bare = unlabelled_frames(SceneSettings(dataset=folder))
    steps = [*carried_on(tools(), bare, [one.frame for one in problems], labels)]
    for step, problem in zip(steps, problems[1:], strict=True):
        assert isinstance(step.motion, CameraMotion)
        assert step.motion.source == "camera poses"
        assert not step.stops
        for label in step.labels:
            T_true = problem.target(label.instance).instance.T_cam_obj_gt
            assert T_true is not None
            middle = problem.target(label.instance).model.middle_m[None]
            off_mm = 1e3 * np.linalg.norm(apply(T_true, middle) - apply(label.pose, middle))
            assert off_mm < MOST_MM, (step.frame, label)
