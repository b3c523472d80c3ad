"""The View and the Settings panel say in a sentence what is drawn, what holds, and what a change will do."""

from __future__ import annotations

from pathlib import Path

from tests.viewer.client import client, until
from tests.viewer.fake_tools import FakeTools
from verefine_viz.core.settings import MethodSettings, PhysicsSettings, Session
from verefine_viz.run.session_file import load_session
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.app import App
from verefine_viz.viewer.debugger import Debugger
from verefine_viz.viewer.panels.bandit_panel import chosen
from verefine_viz.viewer.panels.settings_panel import settings_words
from verefine_viz.viewer.panels.view_panels import ROWS, WITH_BOX

SESSION = Session(method=MethodSettings(iterations=2))
LABELS = {
    "method.iterations": "K",
    "method.exploration": "c",
    "physics.enabled": "Physics",
    "physics.steps": "Steps",
}
HELD = {"method.iterations": 5, "method.exploration": 0.7, "physics.enabled": True, "physics.steps": 3}


def test_every_switch_has_a_place_in_a_row_of_two() -> None:
    assert sorted(name for row in ROWS for name in row) == sorted(WITH_BOX)


def test_settings_that_are_not_the_presets_are_named(tmp_path: Path) -> None:
    assert settings_words(Session(), LABELS, HELD, 0) == "All as recommended."
    other = Session(method=MethodSettings(iterations=3), physics=PhysicsSettings(enabled=False))
    typed = HELD | {"method.iterations": 3, "physics.enabled": False}
    assert "K 3, not 5; Physics off, not on" in settings_words(other, LABELS, typed, 0)
    path = tmp_path / "published.toml"
    path.write_text('preset = "published"\n', encoding="utf-8")
    published = settings_words(load_session(path), LABELS, HELD | {"method.exploration": 0.1}, 0)
    assert published.startswith("All as published.")


def test_what_was_typed_waits_and_what_will_become_of_it_is_reported() -> None:
    for cursor, fork in ((0, "is the same here"), (1, "keeps iteration 1"), (7, "keeps iterations 1 to 7")):
        said = settings_words(Session(), LABELS, HELD | {"method.exploration": 0.4}, cursor)
        assert said.startswith("Not in use yet: c 0.7 → 0.4."), cursor
        assert f"Fork {fork}" in said, cursor
    typed = {"method.iterations": 1, "method.exploration": 0.0, "physics.enabled": False, "physics.steps": 1}
    assert "K 5 → 1, c 0.7 → 0, Physics on → off and 1 more" in settings_words(Session(), LABELS, typed, 0)


def test_a_number_that_no_run_can_have_is_refused_while_it_is_typed() -> None:
    for name, value, said in (
        ("method.iterations", -3, "K = -3: input should be greater than or equal to 1"),
        ("method.iterations", 10**18, "input should be less than or equal to 10000"),
        ("method.iterations", float("nan"), "K = nan: input should be a finite number"),
        ("physics.steps", 1e12, "Steps = 1000000000000.0: "),
        ("method.exploration", -0.5, "c = -0.5: "),
    ):
        words = settings_words(Session(), LABELS, HELD | {name: value}, 0)
        assert said in words
        assert "would refuse it" in words, name


def test_the_sentence_follows_what_is_typed(app: App) -> None:
    panel = app.page.layout.settings
    assert "K 2, not 5" in panel._words._handle.content
    with client(app.url) as browser:
        browser.set(panel._fields["method.iterations"], 4)
        until(app, lambda: "Not in use yet: K 2 → 4." in panel._words._handle.content)
        browser.set(panel._fields["method.iterations"], 2)
        until(app, lambda: "K 2, not 5" in panel._words._handle.content)


def test_before_the_first_choice_it_says_what_comes() -> None:
    for method, said in (("even", "Nothing was chosen yet"), ("pir", "hypothesis 1 alone")):
        assert said in chosen(Debugger(Session(method=MethodSettings(name=method)), None, FakeTools).view())
    d = Debugger(SESSION, None, FakeTools)
    told = chosen(d.view())
    assert f"First comes hypothesis {d.carry_out([c.Step()]).view().at(1).arm + 1}:" in told
