"""The axes of the curves."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from verefine_viz.viewer.panels.widgets import Chart, Line
from verefine_viz.viewer.web.server import Server


@pytest.fixture
def chart(processes: None) -> Iterator[Chart]:
    server = Server(port=0)
    yield Chart(server.gui, 100, server.gui.add_folder("curves"))
    server.stop()


def y_range(chart: Chart, *curves: list[float]) -> object:
    """The ends of the axis of a chart of these curves; None where the page finds them."""
    chart.show([float(k) for k in range(len(curves[0]))], [Line(f"{k}", (0, 0, 0), v) for k, v in enumerate(curves)])
    return (chart._handle.scales or {}).get("y", {}).get("range")


def test_curves_that_are_all_0_have_an_axis_up_to_1_until_one_is_not(chart: Chart) -> None:
    assert y_range(chart, [0.0], [0.0]) == (0.0, 1.05)
    assert y_range(chart, [0.0, 0.0], [0.0, 0.0]) == (0.0, 1.05)
    assert y_range(chart, [0.0, 0.0], [0.0, 0.2]) is None
    assert y_range(chart, [0.0, 0.0], [0.0, -0.2]) is None
    assert y_range(chart, [0.0, 0.0], [0.0, 0.0]) == (0.0, 1.05)
