"""Scores of several objects are called the same everywhere, and each name says what it is."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.viewer.fake_tools import FakeTools
from verefine_viz.core.problem import DependencyGraph, Problem
from verefine_viz.core.settings import MethodSettings, Session
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.debugger import Debugger
from verefine_viz.viewer.drawing.bandit_tables import passes_table
from verefine_viz.viewer.drawing.markup import text, with_hints
from verefine_viz.viewer.panels.objects_panel import objects_html
from verefine_viz.viewer.panels.score_panel import score_html
from verefine_viz.viewer.text.display_names import TERMS
from verefine_viz.viewer.text.headline import headline


class Together(FakeTools):
    """Two boxes that are solved in passes."""

    def problem(self, frame: str) -> Problem:
        problem = super().problem(frame)
        ids = tuple(i.instance_id for i in problem.instances)
        return replace(problem, dependencies=DependencyGraph((), (ids,), (), "given"))


@pytest.fixture(scope="module")
def debugger() -> Debugger:
    session = Session(method=MethodSettings(name="vf_depth", iterations=3))
    return Debugger(session, None, Together).carry_out([c.OpenFrame("0/2"), c.RunUntil("end")])


def test_list_and_sentence_tell_the_frame_score(debugger: Debugger) -> None:
    for place in (1, 4, debugger.workspace.run.length):
        view = debugger.carry_out([c.Seek(place), c.ShowScene()]).view()
        score = view.frame_score
        assert f"{score.score:.2f}" in objects_html(view)
        assert f"{score.score:.3f}" in score_html(view)
        answers = [o.answer.T_cam_obj for o in view.scene.objects if o.answer is not None]
        targets = [o.target for o in view.scene.objects]
        judged = FakeTools(view.session).verifier.score_scene(targets, np.array(answers)[None])
        assert judged[0].score == score.score


def test_a_closed_pass_tells_its_score_and_the_incumbent(debugger: Debugger) -> None:
    closing = next(i for i in debugger.workspace.run.iterations if i.scene is not None)
    view = debugger.carry_out([c.Seek(closing.index), c.Focus(None)]).view()
    said = headline(view)
    assert f"pass score {closing.scene.score.score:.2f}" in said
    assert re.search(rf"incumbent (is now )?{closing.scene.incumbent_score:.2f}", said)
    for term in ("pass score", "incumbent"):
        assert text(TERMS[term]) in passes_table(view)


def test_no_hint_contains_another_term() -> None:
    assert not [(a, b) for a in TERMS for b in TERMS if a in TERMS[b]], "its tooltip would get a tooltip"


@given(st.text(), st.dictionaries(st.text(min_size=1), st.text(), max_size=3))
def test_hints_change_nothing_of_what_is_read_and_let_no_markup_in(said: str, hints: dict[str, str]) -> None:
    made = with_hints(said, {word: hint for word, hint in list(hints.items())[:1]})
    assert re.sub(r'<span class="term" title="[^"<>]*">|</span>', "", made) == text(said)
