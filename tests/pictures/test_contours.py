"""Contours: of known silhouettes, in the right pixels, and nowhere else."""

from __future__ import annotations

import re

import numpy as np
import pytest

from tests.fakes import box_problem
from verefine_viz.pictures.contours import contour_lines, draw_contours

PROBLEM = box_problem()
TARGET = PROBLEM.targets[0]
CAMERA = PROBLEM.observation.camera


def points_of(path: str) -> np.ndarray:
    """All points of an SVG path of closed relative lines."""
    points = []
    for start, way in re.findall(r"M([^l]+)l([^z]*)z", path):
        first = np.array([float(x) for x in start.split()])
        steps = np.array([float(x) for x in way.split()]).reshape(-1, 2)
        points.append(first + np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)]))
    return np.concatenate(points)


def test_the_contour_of_a_rectangle_runs_half_a_pixel_around_it() -> None:
    mask = np.zeros((20, 30), bool)
    mask[5:10, 8:20] = True
    (line,) = contour_lines(mask)
    assert line.min(axis=0) == pytest.approx((7.5, 4.5))
    assert line.max(axis=0) == pytest.approx((19.5, 9.5))
    assert np.array_equal(line[0], line[-1])


def test_a_hole_has_a_contour_of_its_own_and_the_border_of_the_image_closes_one() -> None:
    mask = np.ones((20, 30), bool)
    mask[8:12, 10:14] = False
    assert len(contour_lines(mask)) == 2
    assert contour_lines(np.zeros((20, 30), bool)) == []


def test_what_is_drawn_is_the_line_and_its_dark_rim() -> None:
    image, mask = np.full((40, 40, 3), 200, np.uint8), np.zeros((40, 40), bool)
    mask[10:30, 10:30] = True
    drawn = draw_contours(image, mask, (255, 0, 0))
    line, rim = (drawn == (255, 0, 0)).all(axis=2), (drawn == 70).all(axis=2)
    changed = (drawn != image).any(axis=2)
    assert np.array_equal(changed, line | rim)
    assert 2 * 4 * 18 < line.sum() < 2 * 4 * 23
    assert not changed[14:26, 14:26].any()
    assert not changed[:7].any()
