"""The Breakpoints panel: shows the session's own numbers, and loses none of them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from tests.viewer.client import client, until
from tests.viewer.conftest import OpenPage
from verefine_viz.core.algorithm_settings import BreakpointSettings
from verefine_viz.core.settings import MethodSettings, Session
from verefine_viz.run.breakpoints import LABELS, UNITS, number_of
from verefine_viz.run.session_file import load_session
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.app import App
from verefine_viz.viewer.panels.view_panels import FLAGS, THRESHOLDS

BREAKPOINTS = BreakpointSettings(jump_mm=25.0, score_falls_by=0.5, unstable=True)
SESSION = Session(title="boxes", method=MethodSettings(iterations=2), breakpoints=BREAKPOINTS)


@pytest.fixture
def app(open_page: OpenPage) -> App:
    return open_page(SESSION)


def panel(app: App) -> Any:
    return app.page.layout.breakpoints


def breakpoints(app: App) -> BreakpointSettings:
    return app.debugger.workspace.breakpoints


def shown(app: App) -> dict[str, tuple[str, bool]]:
    return {name: (box.label, box.value) for name, box in panel(app).boxes.items()}


def test_every_breakpoint_has_a_box_and_every_threshold_a_number(app: App) -> None:
    assert {*THRESHOLDS, *FLAGS} == set(BreakpointSettings.model_fields) - {"waiting"} == set(panel(app).boxes)
    assert set(THRESHOLDS) == {name for name, value in BreakpointSettings() if value is None} == set(panel(app).numbers)


def test_the_sessions_own_numbers_are_shown_with_their_units(app: App) -> None:
    assert shown(app)["score_falls_by"] == ("score −0.5", True)
    assert shown(app)["jump_mm"] == ("moved 25 mm", True)
    assert shown(app)["jump_deg"] == ("turned 10°", False)
    assert {name for name, (_, is_on) in shown(app).items() if is_on} == {"score_falls_by", "jump_mm", "unstable"}
    assert panel(app).numbers["jump_mm"].value == 25.0
    assert breakpoints(app) == BREAKPOINTS, "showing changes nothing"


def test_off_and_on_again_keeps_the_number(app: App) -> None:
    with client(app.url) as browser:
        browser.set(panel(app).boxes["jump_mm"], False)
        until(app, lambda: breakpoints(app).jump_mm is None)
        until(app, lambda: shown(app)["jump_mm"] == ("moved 25 mm", False))
        browser.set(panel(app).boxes["jump_mm"], True)
        until(app, lambda: breakpoints(app).jump_mm == 25.0)
    assert breakpoints(app) == BREAKPOINTS


def test_a_number_is_set_on_the_page_saved_and_loaded(app: App, tmp_path: Path) -> None:
    with client(app.url) as browser:
        for name in THRESHOLDS:
            browser.set(panel(app).boxes[name], True)
            for typed in (0.3, 0.37, 0.375):  # as a person types: not every number on the way may be shown again
                browser.set(panel(app).numbers[name], typed)
            until(app, lambda name=name: getattr(breakpoints(app), name) == 0.375)
            until(app, lambda name=name: "0.375" in shown(app)[name][0])
            assert panel(app).numbers[name].value == 0.375, name
    app.send(c.SaveSession("kept"))
    app.wait_until_idle()
    everywhere = dict.fromkeys(THRESHOLDS, 0.375)
    assert load_session(tmp_path / "kept.toml").breakpoints == BREAKPOINTS.model_copy(update=everywhere)
    app.send(c.SetBreakpoints(tuple((name, None) for name in THRESHOLDS)))
    app.send(c.OpenSession(str(tmp_path / "kept.toml")))
    app.wait_until_idle()
    for name in THRESHOLDS:
        assert shown(app)[name][1], name
        assert panel(app).numbers[name].value == 0.375, name


def test_a_number_typed_while_it_is_off_waits_to_be_switched_on_also_in_a_saved_session(
    app: App, tmp_path: Path
) -> None:
    with client(app.url) as browser:
        browser.set(panel(app).numbers["jump_deg"], 4.0)
        until(app, lambda: shown(app)["jump_deg"] == ("turned 4°", False))
        assert breakpoints(app).jump_deg is None
        app.send(c.SaveSession("kept"))
        app.send(c.SetBreakpoints((("waiting.jump_deg", 90.0),)))
        app.send(c.OpenSession(str(tmp_path / "kept.toml")))
        until(app, lambda: shown(app)["jump_deg"] == ("turned 4°", False))
        browser.set(panel(app).boxes["jump_deg"], True)
        until(app, lambda: breakpoints(app).jump_deg == 4.0)


def test_a_wrong_number_is_refused_until_a_right_one_comes(app: App) -> None:
    with client(app.url) as browser:
        for name, wrong in (("jump_mm", -5.0), ("jump_deg", 99999999.0)):
            before, number = breakpoints(app), panel(app).numbers[name]
            shown_before = number.value
            says = f"“{LABELS[name]}” cannot be {wrong:.10g}{UNITS[name]}: give a number from 0 to "
            browser.set(number, wrong)
            until(app, lambda says=says: app.debugger.message.startswith(says))
            until(app, lambda number=number, value=shown_before: number.value == value)
            assert app.debugger.refused, name
            assert breakpoints(app) == before, name
            browser.set(number, 3.0)
            until(app, lambda name=name: number_of(breakpoints(app), name) == 3.0)
            assert not app.debugger.refused, name


def test_the_run_stops_and_says_the_value(app: App) -> None:
    with client(app.url) as browser:
        browser.set(panel(app).numbers["jump_mm"], 0.0)
        until(app, lambda: breakpoints(app).jump_mm == 0.0)
        browser.set(app.page.layout.run.runs, "Run")
        until(app, lambda: "mm, more than 0 mm" in app.debugger.message)
    assert app.debugger.message.startswith("Breakpoint at iteration 1: the pose jumped by ")
