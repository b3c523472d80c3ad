"""The colours of the timeline's marks are explained where they are seen."""

from __future__ import annotations

import re

import pytest

from tests.viewer.tools import FakeTools
from verefine_viz.core.palette import EVENT_COLORS
from verefine_viz.core.settings import MethodSettings, Session
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.debugger import Debugger
from verefine_viz.viewer.marks import MEANINGS, QUIET, RED, Mark
from verefine_viz.viewer.markup import text
from verefine_viz.viewer.panels.timeline import legend, strip

MARKED = {**{kind: color for kind, color in EVENT_COLORS.items() if kind not in QUIET}, "error_grew": RED}


@pytest.mark.parametrize("kind", MARKED)
def test_every_mark_is_explained_in_its_own_colour(kind: str) -> None:
    meanings = [m for m in MEANINGS if kind in m.kinds]
    assert [m.color for m in meanings] == [MARKED[kind]]
    html = legend([Mark(1, kind, "", MARKED[kind])])
    assert f"color:rgb{MARKED[kind]}" in html
    assert text(meanings[0].words) in html
    assert len(re.findall(r"color:rgb", html)) == 1, "nothing else is explained"


def test_the_strip_explains_the_marks_that_it_shows() -> None:
    d = Debugger(Session(method=MethodSettings(iterations=2)), None, FakeTools)
    assert "legend" not in strip(d.view())
    view = d.carry_out([c.RunUntil("end")]).view()
    colors = {m.color for m in view.marks}
    assert colors, "else this shows nothing"
    assert {m.color for m in MEANINGS if f'color:rgb{m.color}"' in strip(view)} == colors
