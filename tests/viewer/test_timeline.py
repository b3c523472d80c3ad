"""The timeline: where the cursor is, and marks whose colours are explained where they are seen."""

from __future__ import annotations

import re
from types import SimpleNamespace
from typing import Any

from tests.changing import replace
from tests.viewer.fake_tools import FakeTools
from verefine_viz.core.palette import EVENT_COLORS
from verefine_viz.core.settings import MethodSettings, Session
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.debugger import Debugger
from verefine_viz.viewer.panels.timeline_panel import legend, strip, timeline_words
from verefine_viz.viewer.snapshot.build import shown_marks
from verefine_viz.viewer.state.timeline_marks import MEANINGS, QUIET, RED, Mark, once_per_object

MARKED = {**{kind: color for kind, color in EVENT_COLORS.items() if kind not in QUIET}, "error_grew": RED}


def test_every_mark_is_explained_in_its_own_colour() -> None:
    for kind, color in MARKED.items():
        meanings = [m for m in MEANINGS if kind in m.kinds]
        assert [m.color for m in meanings] == [color], kind
        html = legend([Mark(1, kind, "", color)])
        assert f"color:rgb{color}" in html, kind
        assert len(re.findall(r"color:rgb", html)) == 1, "nothing else is explained"


def test_the_strip_explains_the_marks_that_it_shows() -> None:
    d = Debugger(Session(method=MethodSettings(iterations=2)), None, FakeTools)
    assert "legend" not in strip(d.view())
    view = d.carry_out([c.RunUntil("end")]).view()
    colors = {m.color for m in view.marks}
    assert colors, "else this shows nothing"
    assert {m.color for m in MEANINGS if f'color:rgb{m.color}"' in strip(view)} == colors


def test_what_stays_so_is_marked_once_per_object_and_says_how_often() -> None:
    d = Debugger(Session(method=MethodSettings(iterations=2)), None, FakeTools)
    made = d.carry_out([c.RunUntil("end")]).view().iterations[:5]
    iterations = [replace(made[0], index=k + 1, instance_id=owner) for k, owner in enumerate((0, 0, 1, 0, 1))]
    worse = [Mark(i.index, "physics_worse", "Worse.", RED) for i in iterations]
    fell = Mark(4, "score_fell", "Fell.", RED)
    marks = [[], [worse[1]], [worse[2]], [worse[3], fell], []]
    found = once_per_object(list(zip(iterations, marks, strict=True)))
    assert [(m.iteration, m.kind) for m in found] == [(2, "physics_worse"), (3, "physics_worse"), (4, "score_fell")]
    assert "in 2 of 3 iterations" in found[0].text
    assert [m.text for m in found[1:]] == ["Worse.", "Fell."]


def test_a_batch_marks_where_a_correct_pose_was_given_up_before_the_run_ends() -> None:
    entry: Any = SimpleNamespace(row=SimpleNamespace(cause="discarded", worst_iteration=2, evidence="given up"))
    branch: Any = SimpleNamespace(marks=lambda: (), run=SimpleNamespace(length=2))
    (mark,) = shown_marks(branch, entry)
    assert (mark.iteration, mark.text, mark.is_red) == (2, "given up", True)
    own = Mark(2, "discarded", "by the run itself", RED)
    branch.marks = lambda: (own,)
    assert shown_marks(branch, entry) == (own,) == shown_marks(branch, None)
    branch.marks, branch.run.length = tuple, 1
    assert shown_marks(branch, entry) == ()


SESSION = Session(method=MethodSettings(iterations=2))


def debugger(*commands: c.Command) -> Debugger:
    return Debugger(SESSION, None, FakeTools).carry_out(commands)


def said(d: Debugger, *red: int) -> str:
    html = timeline_words(d.view(), [Mark(k, "score_fell", "", RED) for k in red])
    return re.sub("<.*?>", "", html)


def test_before_the_first_iteration_nothing_has_run() -> None:
    assert said(debugger()) == "Iteration 0 of 6"
    assert said(debugger(c.Step(), c.Back()), 1) == "Iteration 0 of 6 · 1 made · 1 problem · next: 1"


def test_on_the_way_it_names_the_hypothesis_and_the_nearest_red_marks() -> None:
    d = debugger(*[c.Step()] * 4, c.Seek(2))
    cases: tuple[tuple[tuple[int, ...], str], ...] = (
        ((), ""),
        ((2,), " · 1 problem"),
        ((1, 2, 2), " · 2 problems, one here · previous: 1"),
        ((1, 3, 4), " · 3 problems · previous: 1 · next: 3"),
    )
    for red, marks in cases:
        assert said(d, *red) == f"Iteration 2 of 6 · 4 made{marks}"
    assert f"hypothesis {d.view().at(2).arm + 1} of 3" in timeline_words(d.view(), [])
    other = debugger(c.OpenFrame("0/2"), c.Step(), c.Focus(1))
    assert "it worked on box #0" in timeline_words(other.view(), [])


def test_the_number_of_a_red_mark_leads_there() -> None:
    d = debugger(c.RunUntil("end"), c.Seek(2))
    assert '"cursor": 4' in timeline_words(d.view(), [Mark(4, "score_fell", "", RED)]).replace("&quot;", '"')
