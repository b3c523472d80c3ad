"""The name of the object in focus stands out in 3D; the others are smaller, so that they do not hide each other."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.viewer.client import until
from tests.viewer.fake_tools import FakeTools
from verefine_viz.core.settings import MethodSettings, Session
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.app import App
from verefine_viz.viewer.scene3d.object_nodes import lifts_px


@pytest.mark.usefixtures("processes")
def test_the_name_in_focus_is_the_largest(tmp_path: Path) -> None:
    app = App(Session(method=MethodSettings(iterations=1)), port=0, make_tools=FakeTools, folder=tmp_path).start()
    try:
        app.wait_until_idle()
        for focus in (0, 1):
            app.send(c.OpenFrame("0/2"))
            app.send(c.Focus(focus))
            until(app, lambda focus=focus: _largest(app) == [focus])
    finally:
        app.stop()


def _largest(app: App) -> list[int]:
    """instance_ids of the largest names."""
    assert app.page.scene._others is not None
    sizes = {k: nodes.label.font_screen_scale for k, nodes in app.page.scene._others._nodes.items()}
    return [k for k, size in sizes.items() if size == max(sizes.values())]


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
