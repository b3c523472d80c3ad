"""The View and the Settings panel say in a sentence what is drawn, what holds, and what a change will do."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from tests.viewer.client import client, until
from tests.viewer.fake_tools import FakeTools
from verefine_viz.core.settings import MethodSettings, PhysicsSettings, Session
from verefine_viz.session.files import load_session
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.app import App
from verefine_viz.viewer.debugger import Debugger
from verefine_viz.viewer.panels.bandit_panel import chosen
from verefine_viz.viewer.panels.session_panel import opened
from verefine_viz.viewer.panels.settings_panel import settings_words
from verefine_viz.viewer.panels.view_panels import ROWS, WITH_BOX, view_words
from verefine_viz.viewer.text.pose_words import compared

SESSION = Session(method=MethodSettings(iterations=2))
LABELS = {
    "method.iterations": "K",
    "method.exploration": "c",
    "physics.enabled": "Physics",
    "physics.steps": "Steps",
}
HELD = {"method.iterations": 5, "method.exploration": 0.7, "physics.enabled": True, "physics.steps": 3}


def drawn(*commands: c.Command | c.Command) -> str:
    return view_words(Debugger(SESSION, None, FakeTools).carry_out(commands).view())


def test_every_switch_has_a_place_in_a_row_of_two() -> None:
    assert sorted(name for row in ROWS for name in row) == sorted(WITH_BOX)


def test_what_the_colours_of_the_cloud_are_of() -> None:
    assert drawn(c.Step(), c.ColorCloud("residual")).endswith("Cloud: observed − rendered depth, refined.")
    assert drawn(c.Step(), c.ColorCloud("class")).endswith("Cloud: class of each pixel, refined.")
    assert "Cloud" not in drawn(c.Step(), c.ColorCloud("class"), c.ShowLayer("cloud", False))


def test_two_runs_are_drawn_as_such() -> None:
    assert drawn(c.CompareRun()) == "A solid, B as an outline."


def test_settings_that_are_not_the_presets_are_named() -> None:
    assert settings_words(Session(), LABELS, HELD, 0) == "All as recommended."
    other = Session(method=MethodSettings(iterations=3), physics=PhysicsSettings(enabled=False))
    typed = HELD | {"method.iterations": 3, "physics.enabled": False}
    assert settings_words(other, LABELS, typed, 0).startswith("As recommended, but K 3, not 5; Physics off, not on.")


def test_a_preset_is_no_difference(tmp_path: Path) -> None:
    path = tmp_path / "published.toml"
    path.write_text('preset = "published"\n', encoding="utf-8")
    session = load_session(path)
    typed = HELD | {"method.exploration": 0.1}
    assert settings_words(session, LABELS, typed, 0).startswith("All as published.")


@pytest.mark.parametrize(
    ("cursor", "fork"), [(0, "is the same here"), (1, "keeps iteration 1"), (7, "keeps iterations 1 to 7")]
)
def test_what_was_typed_waits_and_what_will_become_of_it_is_reported(cursor: int, fork: str) -> None:
    said = settings_words(Session(), LABELS, HELD | {"method.exploration": 0.4}, cursor)
    assert said == f"Not in use yet: c 0.7 → 0.4. Restart starts again with it; Fork {fork}."


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        ("method.iterations", -3, "K = -3: input should be greater than or equal to 1"),
        ("method.iterations", 10**18, "K = 1000000000000000000: input should be less than or equal to 10000"),
        ("method.iterations", float("nan"), "K = nan: input should be a finite number"),
        ("physics.steps", 1e12, "Steps = 1000000000000.0: input should be less than or equal to 10000"),
        ("method.exploration", -0.5, "c = -0.5: input should be greater than or equal to 0"),
    ],
)
def test_a_number_that_no_run_can_have_is_refused_while_it_is_typed(name: str, value: float, said: str) -> None:
    words = settings_words(Session(), LABELS, HELD | {name: value}, 0)
    assert words == f"{said}. Restart and Fork would refuse it."


def test_of_many_changes_the_first_are_named() -> None:
    typed = {"method.iterations": 1, "method.exploration": 0.0, "physics.enabled": False, "physics.steps": 1}
    said = settings_words(Session(), LABELS, typed, 0)
    assert "K 5 → 1, c 0.7 → 0, Physics on → off and 1 more." in said


@pytest.mark.usefixtures("processes")
def test_the_sentence_follows_what_is_typed(tmp_path: Path) -> None:
    app = App(SESSION, port=0, make_tools=FakeTools, folder=tmp_path).start()
    try:
        app.wait_until_idle()
        panel = app.page.layout.settings
        assert "K 2, not 5" in panel._words._handle.content
        with client(app.url) as browser:
            browser.set(panel._fields["method.iterations"], 4)
            until(app, lambda: "Not in use yet: K 2 → 4." in panel._words._handle.content)
            browser.set(panel._fields["method.iterations"], 2)
            until(app, lambda: "K 2, not 5" in panel._words._handle.content)
    finally:
        app.stop()


@pytest.mark.parametrize(
    ("method", "said"),
    [
        ("rir", "First comes hypothesis "),
        ("even", "Nothing was chosen yet."),
        ("pir", "PIR works on hypothesis 1 alone."),
    ],
)
def test_before_the_first_choice_it_says_what_comes(method: str, said: str) -> None:
    d = Debugger(Session(method=MethodSettings(name=method)), None, FakeTools)
    told = chosen(d.view())
    assert told.startswith(said)
    if method == "rir":
        arm = d.carry_out([c.Step()]).view().at(1).arm
        assert f"First comes hypothesis {arm + 1}:" in told


def test_a_pose_that_a_method_never_makes_is_not_still_to_come() -> None:
    d = Debugger(Session(method=MethodSettings(name="refine")), None, FakeTools)
    assert compared(d.view()).startswith("No simulated and no refined pose yet: ")
    assert compared(d.carry_out([c.Step()]).view()).startswith("No simulated pose: ")


def test_what_was_read_from_a_recording_is_called_so() -> None:
    view = Debugger(SESSION, None, FakeTools).view()
    assert ", built-in scene “mug”, not from a file: frame " in opened(view)
    assert ", read from the recording run/a.rrd: frame" in opened(replace(view, recording=Path("run/a.rrd")))
