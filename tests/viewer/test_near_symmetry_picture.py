"""The picture of a model's near-symmetries: an axis where its turns leave the drawn model in place, and few words."""

from __future__ import annotations

import re

import numpy as np

from tests.fakes import box_model
from tests.made_up_frames import model
from verefine_viz.core.geometry import apply, axis_angle, transform
from verefine_viz.evaluation.near_symmetry import NearSymmetry, sought
from verefine_viz.viewer.drawing.near_symmetry_picture import by_axis, near_symmetries_html, turns_in_words


def turn(axis: list[float], deg: float, mm: float, is_continuous: bool = False) -> NearSymmetry:
    return NearSymmetry(transform(axis_angle(axis, np.radians(deg)), [0, 0, 0]), mm * 1e-3, is_continuous)


def lines_of(html: str) -> np.ndarray:
    """(n, 4) ends of the axes."""
    ends = re.findall(r'<line x1="(-?\d+)" y1="(-?\d+)" x2="(-?\d+)" y2="(-?\d+)"', html)
    return np.array(ends, int)


def test_turns_about_one_axis_are_one_line_of_words_and_one_of_the_picture() -> None:
    both = [turn([0, 0, 1], a, mm) for a, mm in ((90, 1.04), (-90, 1.2), (180, 0.5))]
    others = [turn([1, 0, 0], 180, 2.0), turn([0, 1, 0], 180, 3.0)]
    axes = by_axis([*others, *both])
    assert [len(axis) for axis in axes] == [3, 1, 1]
    assert turns_in_words(axes) == ["90°: 1.2 mm apart", "180° about 2 axes: 2.0 to 3.0 mm apart"]
    assert turns_in_words(by_axis([turn([0, 1, 0], 180, 0.3, True)])) == ["any angle: 0.3 mm apart"]
    assert len(lines_of(near_symmetries_html(box_model(), [*others, *both]))) == 3
    assert "No turn" in near_symmetries_html(box_model(), ())


def test_the_axes_go_through_the_drawn_model() -> None:
    m = model("can")
    found = sought(m)
    html = near_symmetries_html(m, found)
    lines = lines_of(html)
    assert len(lines) == len(by_axis(found))
    assert lines.min() >= 0
    assert lines.max() <= 216
    for one in found:
        # What lies on the axis stays where it is.
        on_axis = one.centre_m + np.outer([-0.1, 0.0, 0.1], one.axis)
        np.testing.assert_allclose(apply(one.T_obj_obj, on_axis), on_axis, atol=0.02 * m.diameter_m)
