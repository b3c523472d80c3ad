"""An answer that only a turn makes wrong, which the model should have declared, is judged as in a batch."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import pytest

from tests.failing_scenes import broken_scene, named
from tests.fakes import OneFrame
from tests.made_runs import answer
from verefine_viz.diagnosis.causes import Cause, Diagnosis
from verefine_viz.run.session_file import load_session
from verefine_viz.run.toolbox import Toolbox
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.debugger import Debugger
from verefine_viz.viewer.panels.errors_panel import errors_words
from verefine_viz.viewer.snapshot.snapshot import Snapshot
from verefine_viz.viewer.state.batch_gallery import Entry
from verefine_viz.viewer.text.findings import findings
from verefine_viz.viewer.text.verdict import verdict

SESSIONS = Path(__file__).resolve().parents[2] / "sessions"
pytestmark = pytest.mark.usefixtures("long_run")


@pytest.fixture(scope="module")
def solved() -> tuple[Diagnosis, Debugger]:
    """What a batch says of such an object, and the page at the end of the same run."""
    broken = broken_scene(Cause.SYMMETRIC, 0)
    told, toolbox = named(broken), cast(Any, broken.toolbox)
    assert told.cause == Cause.SYMMETRIC
    toolbox.__dict__["source"] = OneFrame(broken.problem)
    return told, Debugger(toolbox.session, None, lambda _: toolbox).carry_out([c.RunUntil("end")])


def seen(debugger: Debugger, cursor: int) -> Snapshot:
    return debugger.carry_out([c.Seek(cursor)]).view(deep=False)


def test_the_page_tells_the_cause_that_a_batch_tells_and_blames_nothing_else(
    solved: tuple[Diagnosis, Debugger],
) -> None:
    told, debugger = solved
    view = seen(debugger, debugger.workspace.run.length)
    (said,) = [one for one in findings(view) if one.red]
    assert said.text == f"{told.sentence} Declare the symmetry in models_info.json if shape is all that matters."
    others = " ".join(one.text for one in findings(view) if one != said)
    assert "search missed" not in others
    assert "estimator" not in others
    assert errors_words(view).endswith(told.sentence)


def test_before_the_run_is_over_nothing_is_blamed(solved: tuple[Diagnosis, Debugger]) -> None:
    assert not [one for one in findings(seen(solved[1], 0)) if one.red]


def test_where_colours_tell_the_turn_the_page_tries_a_score_in_which_they_count() -> None:
    debugger = Debugger(load_session(SESSIONS / "failure_score_prefers_flip.toml"), None, Toolbox).carry_out(
        [c.RunUntil("end")]
    )
    first = debugger.view()
    (blamed,) = [one for one in findings(first) if one.cause == Cause.SYMMETRIC]
    assert blamed.label == "what if score.colour_weight = 0.1?"
    assert blamed.command is not None
    again = debugger.carry_out([blamed.command]).view()
    assert verdict(first).mark == "✗"
    assert verdict(again).mark == "✓"


def test_what_the_batch_told_is_not_told_twice(solved: tuple[Diagnosis, Debugger]) -> None:
    told, debugger = solved
    view = seen(debugger, debugger.workspace.run.length)
    wrong = {"add_s_mm": 50.0, "diameter_mm": 100.0, "cause": str(told.cause), "evidence": told.sentence}
    row = answer(0, 0, instance_id=0, **wrong)
    batch = Entry("run", row)
    assert sum(told.sentence in one.text for one in findings(replace(view, entry=batch))) == 1
