"""The page through a websocket: what a browser sends, and what comes of it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from numba import njit

from tests.fakes import FakeRefiner, FakeVerifier
from tests.viewer.client import client, until
from tests.viewer.conftest import SESSION, OpenPage
from tests.viewer.fake_tools import DRAGGED, FakeTools
from verefine_viz.core.errors import InputError, VerefineError
from verefine_viz.core.problem import Problem
from verefine_viz.core.settings import MethodSettings, Session
from verefine_viz.recording.verify import first_difference
from verefine_viz.refiners.registry import REFINERS, make_refiner
from verefine_viz.run.kernel_compilation import COMPILING
from verefine_viz.viewer import commands as c
from verefine_viz.viewer import session_page
from verefine_viz.viewer.app import App
from verefine_viz.viewer.busy_status import BusyStatus
from verefine_viz.viewer.command_json import from_json, to_json
from verefine_viz.viewer.debugger import Debugger
from verefine_viz.viewer.panels.page_layout import KEYS


def command_of(app: App, label: str) -> Any:
    return app.page.layout.commands[[k[0] for k in KEYS].index(label)]


def cursor(app: App) -> int:
    return app.debugger.workspace.run.cursor


def test_buttons_and_hotkeys_of_every_browser_move_the_run(app: App) -> None:
    with client(app.url) as browser, client(app.url) as other:
        browser.set(app.page.layout.run.moves, "Step ▶")
        until(app, lambda: cursor(app) == 1)
        other.trigger(command_of(app, "Step one iteration"))
        until(app, lambda: cursor(app) == 2)
        other.trigger(command_of(app, "Back one iteration"))
        until(app, lambda: cursor(app) == 1)
        browser.trigger(command_of(app, "Run / pause"))
        until(app, lambda: cursor(app) == 6)
        browser.trigger(command_of(app, "First"))
        until(app, lambda: cursor(app) == 0)


def test_slider_seeks_and_follows(app: App) -> None:
    app.send(c.RunUntil("end"))
    app.wait_until_idle()
    assert app.page.layout.timeline.slider.value == 6
    with client(app.url) as browser:
        browser.set(app.page.layout.timeline.slider, 2)
        until(app, lambda: cursor(app) == 2)
    app.send(c.SeekEnd())
    app.wait_until_idle()
    assert app.page.layout.timeline.slider.value == 6


def test_links_carry_commands_and_nothing_else(app: App) -> None:
    app.send(c.RunUntil("end"))
    app.wait_until_idle()
    with client(app.url) as browser:
        browser.set(app.page.layout.link, '{"command": "DoEvil"} 1')
        browser.set(app.page.layout.link, "__import__('os') 2")
        browser.set(app.page.layout.link, '{"command": "Seek", "cursor": 3} 3')
        until(app, lambda: cursor(app) == 3)


def test_settings_show_a_refiner_that_only_another_program_has(open_page: OpenPage) -> None:
    app = open_page(Session(method=MethodSettings(refiner="nudge", iterations=1)))
    shown = app.page.layout.settings._fields["method.refiner"]
    assert shown.value == "nudge"
    assert {"nudge", "icp"} <= set(shown.options)


def test_what_was_clicked_can_be_repeated_without_a_page(app: App) -> None:
    for command in (c.Step(), c.SelectArm(2), c.RunUntil("end"), c.Seek(1), c.Fork((("method.exploration", 1.0),))):
        app.send(command)
    app.wait_until_idle()
    again = Debugger(SESSION, None, FakeTools).carry_out(from_json(to_json(x)) for x in app.debugger.log)
    assert again.options == app.debugger.options
    assert first_difference(again.workspace.run.iterations, app.debugger.workspace.run.iterations) is None


def test_sliding_fast_carries_out_the_latest_only(app: App) -> None:
    app.send(c.RunUntil("end"))
    app.wait_until_idle()
    with app._requests._wake:  # The worker waits for the lock: all of these are in the queue together.
        for k in (1, 2, 3, 4):
            app.send(c.Seek(k))
        assert [x.cursor for x in app._requests._queue if isinstance(x, c.Seek)] == [4]
    app.wait_until_idle()
    assert cursor(app) == 4


def test_a_command_that_fails_is_reported_and_the_page_lives_on(app: App) -> None:
    app.send(c.OpenFrame("9/9"))
    app.wait_until_idle()
    assert app.debugger.message == "unknown frame '9/9'; available: 0/1, 0/2"
    assert app.debugger.refused
    app.send(c.Fork())
    app.wait_until_idle()
    assert not app.debugger.refused
    app.send(c.Step())
    app.wait_until_idle()
    assert cursor(app) == 1


class Fresh(FakeTools):
    """Compiles when it reads a frame, and when it starts again, as after installing."""

    def problem(self, frame: str) -> Problem:
        njit(lambda: 1)()
        return super().problem(frame)

    def restarted(self, settings: dict[str, dict[str, Any]]) -> FakeTools:
        njit(lambda: 2)()
        return super().restarted(settings)


@pytest.fixture
def said(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """What the page says while nothing can be shown, as it stands there."""
    heard: list[str] = []
    say = BusyStatus.say

    def overheard(telling: BusyStatus, *what: Any) -> None:
        say(telling, *what)
        panel = telling._panel
        heard.append(telling._loading.content if panel is None else panel._words._handle.content)

    monkeypatch.setattr(BusyStatus, "say", overheard)
    return heard


@pytest.mark.usefixtures("processes")
def test_the_page_says_that_kernels_are_compiled_and_on_what_for(
    tmp_path: Path, said: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    go_on, later = session_page.Page.go_on, list[str]()

    def compiling(page: session_page.Page) -> None:
        go_on(page)
        njit(lambda: 3)()  # As the score around the answer, which redraws no words.
        later.append(page.layout.run._words._handle.content)

    monkeypatch.setattr(session_page.Page, "go_on", compiling)
    app = App(SESSION, port=0, make_tools=Fresh, folder=tmp_path).start()
    try:
        app.wait_until_idle()
        assert any(f"Reading the scene: models, pictures, initial poses. {COMPILING}" in words for words in said)
        said.clear()
        app.send(c.Restart((("method.exploration", 1.0),)))
        app.wait_until_idle()
        assert any(f">{COMPILING}<" in words for words in said), "the scene was read long ago"
        until(app, lambda: later)
        assert COMPILING in later[-1]
        until(app, lambda: COMPILING not in app.page.layout.run._words._handle.content)
    finally:
        app.stop()


@pytest.mark.usefixtures("processes")
def test_after_installing_a_step_is_tried_before_the_page_is_ready(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    refined: list[object] = []
    refine = FakeRefiner.refine
    monkeypatch.setattr(FakeRefiner, "refine", lambda *given: refined.append(given) or refine(*given))
    app = App(SESSION, port=0, make_tools=Fresh, folder=tmp_path).start()
    try:
        app.wait_until_idle()
        assert len(refined) == 1
        assert (cursor(app), app.debugger.workspace.run.length) == (0, 0)
    finally:
        app.stop()


def test_nothing_is_said_of_kernels_that_are_there(app: App, said: list[str]) -> None:
    app.send(c.Restart((("method.exploration", 1.0),)))
    app.wait_until_idle()
    assert said, "what is prepared is said"
    assert not any(COMPILING in words for words in said)


def test_a_bug_is_reported_too(app: App, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(app.debugger.workspace.run, "step", lambda: 1 / 0)
    app.send(c.RunUntil("end"))
    app.wait_until_idle()
    assert app.debugger.message == "ZeroDivisionError: division by zero (a bug: please report it with the log)"
    assert app.debugger.running.goal is None


def test_maps_that_cannot_be_made_are_named_and_not_tried_until_something_is_done(
    app: App, monkeypatch: pytest.MonkeyPatch
) -> None:
    tried: list[int] = []

    def fail(*_: object) -> None:
        tried.append(cursor(app))
        raise ValueError("no maps")

    monkeypatch.setattr(FakeVerifier, "maps", fail)
    for k, calm_s in ((1, 0.0), (2, 0.0), (3, 60.0), (4, 60.0)):
        monkeypatch.setattr(session_page, "CALM_S", calm_s)
        app.send(c.Step())
        app.wait_until_idle()
        assert app.debugger.message == "ValueError: no maps (a bug: please report it with the log)"
        assert cursor(app) == k
        assert app.page.wait_s is None
        assert tried.count(k) <= 2
    monkeypatch.undo()
    app.send(c.Back())
    app.wait_until_idle()
    assert app.debugger.message == ""


def test_what_a_refiner_of_another_program_raises_is_no_bug_of_this_one(
    app: App, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Dead:
        def refine(self, *_: object) -> None:
            raise RuntimeError("no CUDA device")

    monkeypatch.setitem(REFINERS, "mine", lambda session: Dead())
    refiner = make_refiner("mine", SESSION)
    monkeypatch.setattr(FakeRefiner, "refine", lambda _, *of: refiner.refine(*of))
    app.send(c.RunUntil("end"))
    app.wait_until_idle()
    assert app.debugger.message.startswith(f"The refiner 'mine' raised RuntimeError: no CUDA device ({__file__}:")
    assert "bug" not in app.debugger.message
    assert cursor(app) == 0


def test_every_panel_has_something_to_say_everywhere(app: App) -> None:
    for command in (
        c.Step(), c.StepStage(), c.StepStage(), c.RunUntil("end"), c.OpenFrame("0/2"), c.RunUntil("end"), c.Focus(0),
        c.SelectArm(1), c.ScrubPath(0), c.ScrubPath(2), c.PlayPath(), c.EditPose(), DRAGGED, c.ForkFromPose(),
        c.ColorCloud(), c.ColorCloud(), c.ShowMap("angle"), c.ProbePixel(40, 40), c.ScoreGroundTruth(), c.ShowBranch(0),
        c.Restart((("physics.enabled", False),)), c.Step(), c.Restart((("method.name", "pir"),)), c.Step(),
        c.Restart((("method.name", "refine"),)), c.RunUntil("end"),
    ):  # fmt: skip
        app.send(command)
        app.wait_until_idle()
        assert "a bug" not in app.debugger.message, (command, app.debugger.message)


def test_session_and_exports_are_written_inside_the_folder(app: App, tmp_path: Path) -> None:
    app.send(c.RunUntil("end"))
    app.send(c.SaveSession("kept"))
    for what in ("scene", "results", "maps", "commands"):
        app.send(c.Export(what))
    app.send(c.Export("maps"))
    app.wait_until_idle()
    written = {p.relative_to(tmp_path).as_posix() for p in tmp_path.rglob("*") if p.is_file()}
    stem = "runs/exports/test_0_1_rir"
    assert written == {
        "kept.toml", f"{stem}.html", f"{stem}.csv", f"{stem}_maps.png", f"{stem}_maps-2.png", f"{stem}_commands.jsonl"
    }  # fmt: skip
    html = (tmp_path / f"{stem}.html").read_text()
    assert "<html" in html
    assert "RunTo" in (tmp_path / f"{stem}_commands.jsonl").read_text()


def test_a_session_cannot_be_written_elsewhere(app: App, tmp_path: Path) -> None:
    for name in ("../evil", "/tmp/evil", "a/b", "", " ", "..", "a\\b", "x\ny"):
        app.send(c.SaveSession(name))
        app.wait_until_idle()
        assert "is no name for a session" in app.debugger.message, repr(name)
    assert list(tmp_path.rglob("*.toml")) == []


def test_hostile_names_are_shown_as_text(open_page: OpenPage) -> None:
    evil = "<img src=x onerror=alert(1)>\"'&"

    class Evil(FakeTools):
        def problem(self, frame: str) -> Problem:
            problem = super().problem(frame)
            models = {k: replace(m, name=evil) for k, m in problem.models.items()}
            hypotheses = tuple(replace(h, source=evil) for h in problem.instances[0].hypotheses)
            instances = (replace(problem.instances[0], hypotheses=hypotheses), *problem.instances[1:])
            return replace(problem, models=models, instances=instances, notes=(evil,), title=evil)

    app = open_page(Session(title=evil), Evil)
    for command in (c.OpenFrame("0/2"), c.RunUntil("end"), c.SeekEvent(-1), c.Fork()):
        app.send(command)
    app.wait_until_idle()
    pages = [str(getattr(m, "props", "")) + str(getattr(m, "updates", "")) for m in messages(app)]
    html = [p for p in pages if "content" in p]
    assert html
    assert not any("<img src=x" in p for p in html)
    assert any("&lt;img src=x" in p for p in html)


def messages(app: App) -> list[Any]:
    """Everything a browser that connects now would be sent."""
    buffer = app.server._websock_server._broadcast_buffer
    return list(buffer.message_from_id.values())


@pytest.mark.usefixtures("processes")
def test_a_session_that_cannot_be_opened_says_why(tmp_path: Path) -> None:
    class Broken(FakeTools):
        def problem(self, frame: str) -> Problem:
            raise InputError("scene_gt.json is missing")

    class Empty(FakeTools):
        frames = ()

    for tools, said in ((Broken, r"scene_gt\.json is missing"), (Empty, "names no frame")):
        running = App(SESSION, port=0, make_tools=tools, folder=tmp_path).start()
        try:
            with pytest.raises(VerefineError, match=said):
                running.wait_until_ready(20)
        finally:
            running.stop()


def test_only_what_can_be_done_with_a_pose_can_be_pressed(app: App) -> None:
    physics = app.page.layout.physics
    for command, is_edited in ((c.Step(), False), (c.EditPose(), True), (DRAGGED, True), (c.ForkFromPose(), False)):
        app.send(command)
        app.wait_until_idle()
        assert (physics.go_on.visible, physics.edit.visible) == (is_edited, not is_edited), command
    app.send(c.EditPose())
    app.send(c.EditPose(False))
    app.wait_until_idle()
    assert (physics.go_on.visible, physics.edit.visible) == (False, True)
