"""Names that are longer than their place, or stand beside each other in 3D."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from verefine_viz.viewer.drawing.markup import cut, fitted
from verefine_viz.viewer.scene3d.object_nodes import lifts_px
from verefine_viz.viewer.text.display_names import shortened, without_common_start

TWINS = ("005_tomato_soup_can #1", "005_tomato_soup_can #12")


def test_a_number_that_tells_twins_apart_is_no_part_of_what_is_cut() -> None:
    for name in TWINS:
        stem, _, number = name.partition(" ")
        for shown in (cut(name), fitted(name)):
            assert f'title="{name}"' in shown
            assert f"<span>{stem}</span>&nbsp;{number}" in shown
    assert [shortened(name, 85) for name in TWINS] == ["005_tomat…#1", "005_toma…#12"]
    for name in ("<b>x</b>", "<b>x</b> #1"):
        assert "<b>" not in cut(name) + fitted(name), "names are text"


def test_what_all_begin_with_is_left_out() -> None:
    assert without_common_start(["net, 160° off", "net, 150° off"]) == ["…160° off", "…150° off"]
    for names in (["cosypose", "posecnn rss"], ["net", "net two"], ["net one"], []):
        assert without_common_start(names) == names


@given(st.lists(st.tuples(st.floats(0, 300), st.floats(0, 100), st.floats(20, 120), st.floats(8, 20)), max_size=8))
def test_no_name_covers_another(labels: list[tuple[float, float, float, float]]) -> None:
    boxes = np.array(labels).reshape(-1, 4)
    lifts = lifts_px(boxes[:, :2], boxes[:, 2:])
    assert (lifts >= 0).all()
    for k in range(len(boxes)):
        for j in range(k):
            (x, y, width, height), (x_j, y_j, width_j, height_j) = boxes[k], boxes[j]
            beside = abs(x - x_j) >= (width + width_j) / 2
            low, low_j = y + lifts[k], y_j + lifts[j]
            assert beside or low >= low_j + height_j - 1e-6 or low_j >= low + height - 1e-6


def test_names_that_stand_apart_stay_where_they_are() -> None:
    places, sizes = np.array([[0.0, 0.0], [200.0, 0.0], [0.0, 50.0]]), np.full((3, 2), (80.0, 12.0))
    assert not lifts_px(places, sizes).any()
