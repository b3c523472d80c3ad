"""A rough pose that is snapped where nothing gives the object's mask, and what a wrong one shows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.labels.labelled import problems
from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import apply, axis_angle, transform
from verefine_viz.core.problem import Placed, Problem, Target
from verefine_viz.evaluation.pose_errors import add_s_mm
from verefine_viz.labels.placing import up_of
from verefine_viz.labels.snapping import snapped
from verefine_viz.labels.verification import label_of
from verefine_viz.run.session_file import resolve
from verefine_viz.run.toolbox import Toolbox
from verefine_viz.scenes.own_pixels import fit_reach_m, own_pixels

UP_DEG = 20.0


@pytest.fixture(scope="module")
def tools() -> Toolbox:
    return Toolbox(resolve({"physics": {"collider": "hull"}}))


@pytest.fixture(scope="module")
def frame() -> Problem:
    return problems(1)[0]


def truth(target: Target) -> Float:
    T_gt = target.instance.T_cam_obj_gt
    assert T_gt is not None
    return T_gt


def turned(frame: Problem, target: Target, deg: float) -> Placed:
    """The object turned about the vertical, 15 mm away."""
    T, up = truth(target), up_of(frame.observation)
    R, middle = axis_angle(up, np.radians(deg)), apply(truth(target), target.model.middle_m[None])[0]
    off = transform(R, middle - R @ middle + [0.01, 0.0, 0.011])
    return Placed(target.instance.instance_id, target.model, off @ T)


def others(frame: Problem, target: Target) -> list[Placed]:
    there = (one for one in frame.targets if one is not target)
    return [Placed(one.instance.instance_id, one.model, truth(one)) for one in there]


def test_own_pixels_at_the_truth_are_the_mask_and_beside_it_none_of_a_neighbour(frame: Problem) -> None:
    for target in frame.targets:
        mask, model = target.instance.mask, target.model
        own = own_pixels(frame.observation, model, truth(target), others(frame, target), fit_reach_m(model))
        assert np.count_nonzero(own & mask) > 0.9 * mask.sum()
        assert np.count_nonzero(own & ~mask) < 0.03 * mask.sum()
        far = own_pixels(frame.observation, model, transform(np.eye(3), [0, 0, -5.0]), (), 0.01)
        assert not far.any()


def test_a_rough_pose_ends_at_the_truth_and_not_at_a_neighbour(frame: Problem, tools: Toolbox) -> None:
    for target in frame.targets:
        start = turned(frame, target, UP_DEG)
        label = label_of(tools, snapped(tools, frame.observation, start, others(frame, target)))
        apart = np.linalg.norm(
            apply(label.pose, target.model.middle_m[None]) - apply(truth(target), target.model.middle_m[None])
        )
        assert apart < 0.004
        assert label.light != "red"
        assert label.fit_mm < 4
        assert label.sinks_mm < 6


def test_poses_that_look_alike_and_are_not_are_doubted(frame: Problem, tools: Toolbox) -> None:
    can = next(one for one in frame.targets if one.model.name == "can")
    plain = replace(can.model, symmetries=np.eye(4)[None])  # It says nothing of the turns that cannot be seen.
    for deg in (0.0, 180.0):
        start = replace(turned(frame, can, deg), model=plain)
        snap = snapped(tools, frame.observation, start, others(frame, can))
        assert snap.rivals[0].gain > -0.02
        assert add_s_mm(plain, snap.rivals[0].T_cam_obj, snap.refined.T_cam_obj) > 100 * plain.diameter_m
        label = label_of(tools, snap)
        assert label.light == "amber"
        assert any("fits as well" in reason for reason in label.reasons)


def test_what_cannot_be_there_is_red(frame: Problem, tools: Toolbox) -> None:
    carton = next(one for one in frame.targets if one.model.name == "carton")
    up = up_of(frame.observation)
    above = transform(np.eye(3), 0.25 * up) @ truth(carton)
    floating = Placed(carton.instance.instance_id, carton.model, above)
    label = label_of(tools, snapped(tools, frame.observation, floating, others(frame, carton)))
    assert label.light == "red"
    assert label.reasons
