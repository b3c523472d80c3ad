"""Names that are longer than their place: what tells them apart stays on the screen, and all of it in a tooltip."""

from __future__ import annotations

import pytest

from verefine_viz.viewer.drawing.markup import cut, fitted
from verefine_viz.viewer.text.display_names import shortened, without_common_start

TWINS = ("005_tomato_soup_can #1", "005_tomato_soup_can #12")


def test_a_number_that_tells_twins_apart_is_no_part_of_what_is_cut() -> None:
    for name in TWINS:
        stem, _, number = name.partition(" ")
        for shown in (cut(name), fitted(name)):
            assert f'title="{name}"' in shown
            assert f"<span>{stem}</span>&nbsp;{number}" in shown
    assert [shortened(name, 85) for name in TWINS] == ["005_tomat…#1", "005_toma…#12"]


def test_names_are_text() -> None:
    for name in ("<b>x</b>", "<b>x</b> #1"):
        assert "<b>" not in cut(name) + fitted(name)


@pytest.mark.parametrize(
    ("names", "shown"),
    [
        (["estimator, 160° off", "estimator, 150° off"], ["…160° off", "…150° off"]),
        (["estimator A, left", "estimator B, left"], ["…A, left", "…B, left"]),
        (["cosypose", "posecnn rss"], ["cosypose", "posecnn rss"]),
        (["net", "net two"], ["net", "net two"]),
        (["net one"], ["net one"]),
        ([], []),
    ],
)
def test_what_all_begin_with_is_left_out(names: list[str], shown: list[str]) -> None:
    assert without_common_start(names) == shown
