"""The View and the Settings panel say in a sentence what is drawn, what holds, and what a change will do."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.viewer.client import client, until
from tests.viewer.tools import FakeTools
from verefine_viz.core.settings import MethodSettings, PhysicsSettings, Session
from verefine_viz.session.files import load_session
from verefine_viz.viewer import commands as c
from verefine_viz.viewer import side_commands as s
from verefine_viz.viewer.app import App
from verefine_viz.viewer.debugger import Debugger
from verefine_viz.viewer.panels.layers import ROWS, WITH_BOX
from verefine_viz.viewer.settings_words import settings_words
from verefine_viz.viewer.view_words import view_words

SESSION = Session(method=MethodSettings(iterations=2))
LABELS = {
    "method.iterations": "K",
    "method.exploration": "c",
    "physics.enabled": "Physics",
    "physics.steps": "Sim steps",
}
HELD = {"method.iterations": 5, "method.exploration": 0.7, "physics.enabled": True, "physics.steps": 3}


def drawn(*commands: c.Command | s.Command) -> str:
    return view_words(Debugger(SESSION, None, FakeTools).carry_out(commands).view(), WITH_BOX)


def test_every_switch_has_a_place_in_a_row_of_two() -> None:
    assert sorted(name for row in ROWS for name in row) == sorted(WITH_BOX)


def test_what_is_drawn_and_what_is_not() -> None:
    assert drawn() == (
        "Drawn of box: current, truth. On, but not made here: simulated, refined, accepted. Off: initial, mixed, best."
    )
    assert drawn(c.Step()) == "Drawn of box: current, simulated, refined, accepted, truth. Off: initial, mixed, best."
    nothing = [c.ShowLayer(name, False) for name in ("current", "ground truth", "camera image")]
    assert drawn(*nothing).startswith("Drawn of box: no pose.")
    assert "truth" in drawn(*nothing).partition("Off:")[2]
    assert "photo" in drawn(*nothing).partition("Off:")[2]


def test_what_the_colours_of_the_cloud_are_of() -> None:
    assert drawn(c.Step(), c.ColorCloud("residual")).endswith("Cloud: observed − rendered depth for refined.")
    assert drawn(c.Step(), c.ColorCloud("class")).endswith("Cloud: class of each pixel for refined.")
    assert "Cloud" not in drawn(c.Step(), c.ColorCloud("class"), c.ShowLayer("cloud", False))


def test_two_runs_are_drawn_as_such() -> None:
    assert drawn(s.CompareRun()).startswith("Drawn: the poses of A, solid, and of B, as an outline. Off:")


def test_settings_that_are_not_the_presets_are_named() -> None:
    assert settings_words(Session(), LABELS, HELD, 0) == "All as recommended. Changes wait for Restart or Fork."
    other = Session(method=MethodSettings(iterations=3), physics=PhysicsSettings(enabled=False))
    typed = HELD | {"method.iterations": 3, "physics.enabled": False}
    assert settings_words(other, LABELS, typed, 0).startswith(
        "As recommended, but K 3, not 5; Physics off, not on. Changes"
    )


def test_a_preset_is_no_difference(tmp_path: Path) -> None:
    path = tmp_path / "published.toml"
    path.write_text('preset = "published"\n', encoding="utf-8")
    session = load_session(path)
    typed = HELD | {"method.exploration": 0.1}
    assert settings_words(session, LABELS, typed, 0).startswith("All as published.")


@pytest.mark.parametrize(
    ("cursor", "fork"), [(0, "is the same here"), (1, "keeps iteration 1"), (7, "keeps iterations 1 to 7")]
)
def test_what_was_typed_waits_and_what_will_become_of_it_is_told(cursor: int, fork: str) -> None:
    said = settings_words(Session(), LABELS, HELD | {"method.exploration": 0.4}, cursor)
    assert said == f"Not in use yet: c 0.7 → 0.4. Restart begins anew with it; Fork {fork}."


def test_of_many_changes_the_first_are_named() -> None:
    typed = {"method.iterations": 1, "method.exploration": 0.0, "physics.enabled": False, "physics.steps": 1}
    said = settings_words(Session(), LABELS, typed, 0)
    assert "K 5 → 1, c 0.7 → 0, Physics on → off and 1 more." in said


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
