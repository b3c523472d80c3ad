"""Edges of depth, colour and masks show which of the three lies beside the two others, or is mirrored."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.calibration.sizes import real, scene
from verefine_viz.calibration.edges import edge_doubts
from verefine_viz.core.problem import Problem

REAL = ("0/1", "0/3")


def displaced(array: NDArray, right: int, down: int = 0) -> NDArray:
    return np.ascontiguousarray(np.roll(array, (down, right), (0, 1)))


def with_depth_beside(p: Problem, right: int) -> Problem:
    return replace(p, observation=replace(p.observation, depth_m=displaced(p.observation.depth_m, right)))


def rgb_of(p: Problem) -> NDArray[np.uint8]:
    assert p.observation.rgb is not None
    return p.observation.rgb


def with_rgb(p: Problem, rgb: NDArray[np.uint8] | None) -> Problem:
    return replace(p, observation=replace(p.observation, rgb=rgb))


def test_displaced_depth_is_named_with_its_direction_with_colour_and_without() -> None:
    clutter = scene("clutter", "0/0")
    assert edge_doubts(clutter) == ()
    (note,) = edge_doubts(with_depth_beside(clutter, 25))
    assert note.text.startswith("depth lies about 2")
    assert "to the right" in note.text
    assert "colour and masks" in note.text
    (note,) = edge_doubts(with_rgb(with_depth_beside(clutter, -25), None))
    assert "to the left" in note.text
    assert "where the masks are" in note.text
    assert edge_doubts(with_rgb(clutter, None)) == ()


def test_objects_that_fill_the_image_and_small_shifts_show_nothing() -> None:
    clutter = scene("clutter", "0/0")
    assert edge_doubts(with_depth_beside(clutter, 6)) == ()
    full = np.ones_like(clutter.observation.object_mask)
    beside = with_depth_beside(clutter, 25)
    assert edge_doubts(replace(beside, observation=replace(beside.observation, object_mask=full))) == ()


@pytest.mark.parametrize("frame", REAL)
def test_real_frames_show_what_is_displaced_or_mirrored(shared_data: Path, frame: str) -> None:
    problem = real(shared_data / "ycbv", frame)
    assert edge_doubts(problem) == ()
    (note,) = edge_doubts(with_depth_beside(problem, 25))
    assert note.text.startswith("depth lies about")
    (note,) = edge_doubts(with_rgb(problem, np.ascontiguousarray(rgb_of(problem)[:, ::-1])))
    assert "mirrored left to right" in note.text
    masks = tuple(replace(i, mask=displaced(i.mask, -30)) for i in problem.instances)
    (note,) = edge_doubts(replace(problem, instances=masks))
    assert note.text.startswith("masks lie about")
