"""A colour image that is displaced against the depth image shows in where the objects' colours are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tests.calibration.sizes import scene
from verefine_viz.calibration.registration import registration_doubts
from verefine_viz.core.problem import Problem
from verefine_viz.diagnosis.data_doubts import answer_doubts

CLUTTER = scene()
TRUE = [i.T_cam_obj_gt for i in CLUTTER.instances]


def displaced(right_px: int, down_px: int) -> Problem:
    rgb = CLUTTER.observation.rgb
    assert rgb is not None
    image = np.roll(rgb, (down_px, right_px), (0, 1))
    return replace(CLUTTER, observation=replace(CLUTTER.observation, rgb=image))


def test_a_displaced_colour_image_is_named_with_its_displacement() -> None:
    assert not registration_doubts(displaced(0, -2), TRUE)
    assert "4 px right" in registration_doubts(displaced(4, 0), TRUE)[0].text
    assert "3 px left and 5 px down" in registration_doubts(displaced(-3, 5), TRUE)[0].text


def test_without_colours_or_poses_nothing_can_be_said() -> None:
    beside = displaced(5, 0)
    assert not registration_doubts(replace(beside, observation=replace(beside.observation, rgb=None)), TRUE)
    assert not registration_doubts(beside, [None] * len(TRUE))
    colourless = {k: replace(m, vertex_colors=None) for k, m in beside.models.items()}
    assert not registration_doubts(replace(beside, models=colourless), TRUE)


def test_it_is_in_doubt_only_where_colour_counts() -> None:
    beside = displaced(5, 0)
    assert not answer_doubts(beside, TRUE)
    assert "not registered" in answer_doubts(beside, TRUE, colour_weight=0.1)[0].text
    blind = replace(beside, instances=tuple(replace(i, T_cam_obj_gt=None) for i in beside.instances))
    assert "not registered" in answer_doubts(blind, TRUE, colour_weight=0.1)[0].text
    assert not answer_doubts(CLUTTER, TRUE, colour_weight=0.1)
