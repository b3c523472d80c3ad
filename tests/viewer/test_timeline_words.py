"""The timeline says where the cursor is, and where to look for trouble."""

from __future__ import annotations

import re

import pytest

from tests.viewer.fake_tools import FakeTools
from verefine_viz.core.settings import MethodSettings, Session
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.debugger import Debugger
from verefine_viz.viewer.panels.timeline_panel import strip, timeline_words
from verefine_viz.viewer.state.timeline_marks import RED, Mark

SESSION = Session(method=MethodSettings(iterations=2))


def debugger(*commands: c.Command) -> Debugger:
    return Debugger(SESSION, None, FakeTools).carry_out(commands)


def said(d: Debugger, *red: int) -> str:
    html = timeline_words(d.view(), [Mark(k, "score_fell", "", RED) for k in red])
    return re.sub("<.*?>", "", html)


def test_before_the_first_iteration_nothing_has_run() -> None:
    assert said(debugger()) == "Iteration 0 of 6"
    assert said(debugger(c.Step(), c.Back()), 1) == "Iteration 0 of 6 · 1 made · 1 problem · next: 1"


@pytest.mark.parametrize(
    ("red", "marks"),
    [
        ((), ""),
        ((2,), "1 problem"),
        ((1, 2, 2), "2 problems, one here · previous: 1"),
        ((1, 3, 4), "3 problems · previous: 1 · next: 3"),
        ((3,), "1 problem · next: 3"),
    ],
)
def test_on_the_way_it_names_the_hypothesis_and_the_nearest_red_marks(red: tuple[int, ...], marks: str) -> None:
    d = debugger(*[c.Step()] * 4, c.Seek(2))
    arm = d.view().at(2).arm + 1
    assert said(d, *red) == f"Iteration 2 of 6 · 4 made{' · ' * bool(marks)}{marks}"
    assert f'title="box, hypothesis {arm} of 3"' in timeline_words(d.view(), [])


def test_an_iteration_of_another_object_is_named_too() -> None:
    d = debugger(c.OpenFrame("0/2"), c.Step(), c.Focus(1))
    assert 'title="it worked on box #0, hypothesis ' in timeline_words(d.view(), [])


def test_the_number_of_a_red_mark_leads_there() -> None:
    d = debugger(c.RunUntil("end"), c.Seek(2))
    assert '"cursor": 4' in timeline_words(d.view(), [Mark(4, "score_fell", "", RED)]).replace("&quot;", '"')
    assert timeline_words(d.view(), d.view().marks) in strip(d.view())
