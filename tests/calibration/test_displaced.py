"""Edges and colours show which of depth, colour and masks lies beside the two others, or is mirrored."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.calibration.sizes import real, with_instances
from tests.calibration.spoiled import CLUTTER, displaced, with_depth_beside, with_rgb
from verefine_viz.calibration.edges import edge_doubts
from verefine_viz.calibration.registration import registration_doubts
from verefine_viz.core.doubt import DoubtKind
from verefine_viz.core.problem import Problem
from verefine_viz.diagnosis.data_doubts import answer_doubts

TRUE = [i.T_cam_obj_gt for i in CLUTTER.instances]


def rgb_of(p: Problem) -> NDArray[np.uint8]:
    assert p.observation.rgb is not None
    return p.observation.rgb


def with_colour_beside(right: int, down: int) -> Problem:
    return with_rgb(CLUTTER, displaced(rgb_of(CLUTTER), right, down))


@pytest.mark.parametrize("right", [25, -25])
def test_displaced_depth_is_named_with_its_shift_with_colour_and_without(right: int) -> None:
    for right_data in (CLUTTER, with_rgb(CLUTTER, None)):
        assert edge_doubts(right_data) == ()
        (doubt,) = edge_doubts(with_depth_beside(right_data, right))
        assert doubt.kind == DoubtKind.DEPTH_SHIFT
        assert doubt.remedy is not None
        np.testing.assert_allclose(doubt.remedy.depth_shift_px, (right, 0), atol=4)


def test_objects_that_fill_the_image_and_small_shifts_show_nothing() -> None:
    assert edge_doubts(with_depth_beside(CLUTTER, 6)) == ()
    beside = with_depth_beside(CLUTTER, 25)
    full = np.ones_like(CLUTTER.observation.object_mask)
    assert edge_doubts(replace(beside, observation=replace(beside.observation, object_mask=full))) == ()


@pytest.mark.parametrize("frame", ["0/1", "0/3"])
def test_real_frames_show_what_is_displaced_or_mirrored(shared_data: Path, frame: str) -> None:
    problem = real(shared_data / "ycbv", frame)
    spoiled = {
        DoubtKind.DEPTH_SHIFT: with_depth_beside(problem, 25),
        DoubtKind.COLOUR: with_rgb(problem, np.ascontiguousarray(rgb_of(problem)[:, ::-1])),
        DoubtKind.MASK: with_instances(problem, lambda i: replace(i, mask=displaced(i.mask, -30))),
    }
    assert edge_doubts(problem) == ()
    assert [doubt.kind for one in spoiled.values() for doubt in edge_doubts(one)] == [*spoiled]


@pytest.mark.parametrize(("right", "down"), [(4, 0), (-3, 5)])
def test_a_displaced_colour_image_is_named_with_its_displacement(right: int, down: int) -> None:
    (doubt,) = registration_doubts(with_colour_beside(right, down), TRUE)
    assert (doubt.kind, doubt.numbers["right_px"], doubt.numbers["down_px"]) == (DoubtKind.COLOUR, right, down)


def test_without_colours_or_poses_or_far_enough_nothing_can_be_said() -> None:
    beside = with_colour_beside(5, 0)
    assert not registration_doubts(with_colour_beside(0, -2), TRUE)
    assert not registration_doubts(with_rgb(beside, None), TRUE)
    assert not registration_doubts(beside, [None] * len(TRUE))
    colourless = {k: replace(m, vertex_colors=None) for k, m in beside.models.items()}
    assert not registration_doubts(replace(beside, models=colourless), TRUE)


def test_colour_is_in_doubt_only_where_it_counts() -> None:
    beside = with_colour_beside(5, 0)
    without_truth = with_instances(beside, lambda i: replace(i, T_cam_obj_gt=None))
    assert not answer_doubts(beside, TRUE)
    assert not answer_doubts(CLUTTER, TRUE, colour_weight=0.1)
    for problem in (beside, without_truth):
        assert DoubtKind.COLOUR in {doubt.kind for doubt in answer_doubts(problem, TRUE, colour_weight=0.1)}
