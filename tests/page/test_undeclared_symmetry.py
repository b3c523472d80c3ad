"""An answer that only a turn makes wrong, which the model should have declared, is judged as in a batch."""

from __future__ import annotations

from pathlib import Path
from typing import Any, cast

import pytest

from tests.failing_scenes import broken_scene, named
from tests.fakes import OneFrame
from tests.received import received
from verefine_viz.core.causes import Cause
from verefine_viz.page import protocol as p
from verefine_viz.page.verbs import Debugger
from verefine_viz.page.views.verdict import verdict_message
from verefine_viz.page.workspace import Workspace
from verefine_viz.run.session_file import load_session
from verefine_viz.run.toolbox import Toolbox

SESSIONS = Path(__file__).resolve().parents[2] / "sessions"
pytestmark = pytest.mark.usefixtures("long_run")


def test_the_page_names_the_cause_that_a_batch_names_and_no_other():
    broken = broken_scene(Cause.SYMMETRIC, 0)
    by_batch, toolbox = named(broken), cast(Any, broken.toolbox)
    assert by_batch.main.cause == Cause.SYMMETRIC
    toolbox.source = OneFrame(broken.problem)
    d = Debugger(Workspace(toolbox.session, None, lambda _: toolbox)).carry_out([p.RunVerb()])
    (shown,) = received(verdict_message(d.space.work.first))["objects"]
    first, *others = shown["findings"]
    assert (shown["tone"], first["cause"]) == ("wrong", Cause.SYMMETRIC)
    assert first["text"].startswith(by_batch.main.text)
    assert not any(words in f["text"] for f in others for words in ("search missed", "estimator"))


def test_where_colours_tell_the_turn_a_score_in_which_they_count_is_offered():
    session = load_session(SESSIONS / "failure_score_prefers_flip.toml")
    d = Debugger(Workspace(session, None, Toolbox)).carry_out([p.RunVerb()])
    (shown,) = received(verdict_message(d.space.work.first))["objects"]
    (blamed,) = [f for f in shown["findings"] if f["cause"] == Cause.SYMMETRIC]
    assert blamed["try"] == {"score.colour_weight": 0.1}
    d.carry_out([p.Fork(0, changes=blamed["try"], run=True)])
    (again,) = received(verdict_message(d.space.branch(1)))["objects"]
    assert (shown["tone"], again["tone"]) == ("wrong", "right")
