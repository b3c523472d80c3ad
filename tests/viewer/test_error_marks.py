"""What is right, what is wrong and what it is unknown are told apart where objects are listed."""

from __future__ import annotations

from dataclasses import replace

import pytest

from tests.viewer.fake_tools import FakeTools
from tests.viewer.test_words import off
from verefine_viz.core.settings import MethodSettings, Session
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.debugger import Debugger
from verefine_viz.viewer.panels.objects_panel import objects_html
from verefine_viz.viewer.text.display_names import verdict_mark


@pytest.mark.parametrize(("relative", "mark"), [(0.02, "✓"), (0.0999, "✓"), (0.1, "✗"), (2.0, "✗")])
def test_a_tenth_of_the_diameter_decides(relative: float, mark: str) -> None:
    assert verdict_mark(off(1.0, 1.0, relative)) == mark


def test_without_ground_truth_there_is_no_mark() -> None:
    assert verdict_mark(None) == ""


def test_the_list_marks_the_wrong_ones_alone() -> None:
    session = Session(method=MethodSettings(name="rir", iterations=2))
    view = Debugger(session, None, FakeTools).carry_out([c.OpenFrame("0/2"), c.RunUntil("end")]).view()
    assert "✗<" not in objects_html(view)
    right, wrong = view.scene.objects
    objects = (right, replace(wrong, errors=off(40.0, 30.0, 0.3)))
    html = objects_html(replace(view, scene=replace(view.scene, objects=objects)))
    assert html.count("✗<") == 1
    assert "<td>30.0 ✗</td>" in html
    assert "1/2 ✓" in html
