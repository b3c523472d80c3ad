"""The colours of the timeline's marks are explained where they are seen."""

from __future__ import annotations

import re
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

from tests.viewer.fake_tools import FakeTools
from verefine_viz.core.palette import EVENT_COLORS
from verefine_viz.core.settings import MethodSettings, Session
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.debugger import Debugger
from verefine_viz.viewer.drawing.markup import text
from verefine_viz.viewer.panels.settings_panel import NAME_PX
from verefine_viz.viewer.panels.timeline_panel import legend, strip
from verefine_viz.viewer.snapshot.build import shown_marks
from verefine_viz.viewer.state.timeline_marks import MEANINGS, QUIET, RED, Mark, once_per_object
from verefine_viz.viewer.text.display_names import shortened

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
    assert strip(view).index("</svg>") < strip(view).index('class="legend"'), "the long words above leave it no room"


def test_marks_of_one_iteration_lie_beside_each_other() -> None:
    d = Debugger(Session(method=MethodSettings(iterations=2)), None, FakeTools)
    view = d.carry_out([c.RunUntil("end")]).view()

    def tips(*kinds: str) -> list[float]:
        """Where the marks of iteration 3 point to [px]."""
        html = strip(replace(view, marks=tuple(Mark(3, kind, kind, MARKED[kind]) for kind in kinds)))
        return [float(found) for found in re.findall(r'points="[^"]* ([-\d.]+),12"', html)]

    (middle,) = tips("edited")
    red, by_hand = sorted(tips("score_fell", "edited"))
    assert by_hand - red >= 6
    assert (red + by_hand) / 2 == pytest.approx(middle)
    assert tips("score_fell", "unstable") == [middle, middle], "of one colour: one place"


def test_a_long_name_is_shortened_to_fit_its_button() -> None:
    assert shortened("003_cracker_box", NAME_PX) == "003_cra…r_box"
    assert shortened("mug", NAME_PX) == "mug"


def test_what_stays_so_is_marked_once_per_object_and_says_how_often() -> None:
    d = Debugger(Session(method=MethodSettings(iterations=2)), None, FakeTools)
    made = d.carry_out([c.RunUntil("end")]).view().iterations[:5]
    iterations = [replace(made[0], index=k + 1, instance_id=owner) for k, owner in enumerate((0, 0, 1, 0, 1))]
    worse = [Mark(i.index, "physics_worse", "Worse.", RED) for i in iterations]
    fell = Mark(4, "score_fell", "Fell.", RED)
    marks = [[], [worse[1]], [worse[2]], [worse[3], fell], []]
    found = once_per_object(list(zip(iterations, marks, strict=True)))
    assert [(m.iteration, m.kind) for m in found] == [(2, "physics_worse"), (3, "physics_worse"), (4, "score_fell")]
    assert [m.text for m in found] == ["Worse. So it is in 2 of 3 iterations of this object.", "Worse.", "Fell."]


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
