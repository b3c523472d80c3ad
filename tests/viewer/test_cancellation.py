"""Cancel on the page: ends what takes long, and everything is as it was before, in every browser."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path
from time import sleep

import pytest

from tests.viewer.client import client, until
from tests.viewer.conftest import SESSION, OpenPage
from tests.viewer.fake_tools import FakeTools
from tests.viewer.test_app import command_of, cursor
from verefine_viz.core.problem import Problem
from verefine_viz.core.progress_token import ProgressToken
from verefine_viz.physics.decomposition import PARTS_OF
from verefine_viz.run.session_file import save_session
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.app import App
from verefine_viz.viewer.command_json import to_json
from verefine_viz.viewer.debugger import Debugger, RequestQueue
from verefine_viz.viewer.panels.run_panel import USE_HULLS
from verefine_viz.viewer.session_page import CANCELLED

SLOW = "0/2"


class Slow(FakeTools):
    """Reads its second frame, and what has other initial poses, until nobody waits any more or it is enough."""

    progress: ProgressToken
    reading: threading.Event
    enough = False

    def problem(self, frame: str) -> Problem:
        while (frame == SLOW or self.session.hypotheses.seed) and not self.enough:
            self.progress.checkpoint("Reading for ever.", 0.25)
            self.reading.set()
            sleep(0.01)
        return super().problem(frame)


@pytest.fixture
def app(open_page: OpenPage) -> App:
    class Tools(Slow):
        reading = threading.Event()

    app = open_page(SESSION, Tools)
    Tools.progress = app._progress
    return app


def begin(app: App, command: c.Command) -> None:
    """Sends a command that takes for ever, and waits until it is under way."""
    reading = app.debugger.workspace.tools.reading  # type: ignore[attr-defined]
    reading.clear()
    app.send(command)
    assert reading.wait(20)


def wait_for(condition: Callable[[], bool]) -> None:
    for _ in range(2000):
        if condition():
            return
        sleep(0.01)
    raise AssertionError("it never happened")


def words(app: App) -> str:
    return app.page.layout.run._words._handle.content


def opening(app: App) -> c.Command:
    hypotheses = SESSION.hypotheses.model_copy(update={"seed": 1})
    path = app._folder / "other.toml"
    save_session(SESSION.model_copy(update={"hypotheses": hypotheses, "title": "other"}), path)
    return c.OpenSession(str(path))


LONG = {
    "another frame": lambda app: c.OpenFrame(SLOW),
    "new initial poses": lambda app: c.Restart((("hypotheses.seed", 1),)),
    "another session": opening,
    "B of a comparison": lambda app: c.CompareRun((("hypotheses.seed", 1),)),
}


def state_of(app: App) -> tuple[object, ...]:
    space = app.debugger.workspace
    run, work = space.run, space.work
    return space.session, space.path, space.frame, run, run.length, work.comparison, work.branches


def test_what_is_cancelled_leaves_everything_as_it_was_and_a_step_works(app: App) -> None:
    for command in (c.Step(), c.Step(), c.Back()):
        app.send(command)
    app.wait_until_idle()
    for what in LONG:
        before, log = state_of(app), list(app.debugger.log)
        begin(app, LONG[what](app))
        app.send(c.Cancel())
        app.wait_until_idle()
        assert state_of(app) == before, what
        assert app.debugger.log == log, f"{what}: what was not done is not repeated"
        assert (app.debugger.message, app.debugger.refused) == (CANCELLED, False), what
        assert CANCELLED in words(app), what
        at = cursor(app)
        app.send(c.Step())
        app.wait_until_idle()
        assert cursor(app) == at + 1, what
        assert CANCELLED not in words(app), what


def test_cancel_does_not_wait_for_its_turn_and_what_waited_goes_with_it(app: App) -> None:
    for how in ("link", "key or palette"):
        with client(app.url) as one, client(app.url):
            begin(app, c.OpenFrame(SLOW))
            for _ in range(3):
                app.send(c.Step())
            if how == "link":
                one.set(app.page.layout.link, f"{to_json(c.Cancel())} 1")
            else:
                one.trigger(command_of(app, "Cancel what is being done"))
            until(app, lambda: app.debugger.message == CANCELLED)
            assert cursor(app) == 0, "the steps were meant for the other frame"
            assert app.page.layout.run.frame.value == "0/1", how
        app.send(c.ColorCloud())
        app.wait_until_idle()
        assert app.debugger.message == "", how


def test_people_look_around_while_something_else_is_read(app: App) -> None:
    for _ in range(3):
        app.send(c.Step())
    app.wait_until_idle()
    begin(app, c.OpenFrame(SLOW))
    app.send(c.Seek(1))
    app.send(c.SelectArm(2))
    app.send(c.SeekStage(9, "refined"))  # There is no such iteration: told, and no reason to end what is read.
    app.send(c.ColorCloud("class"))
    wait_for(lambda: app.debugger.options.cloud == "class")
    assert cursor(app) == 1
    assert app.debugger.options.arm == 2
    wait_for(lambda: app.page.layout.timeline.slider.value == 1)
    wait_for(lambda: "Reading for ever." in words(app) and "&quot;Cancel&quot;" in words(app))
    progress = app.page.layout.run._progress
    wait_for(lambda: (progress.visible, progress.value) == (True, 25.0))
    app.send(c.Cancel())
    app.wait_until_idle()
    assert not progress.visible
    assert "&quot;Cancel&quot;" not in words(app)
    assert (cursor(app), app.debugger.options.cloud) == (1, "class")
    assert app.debugger.message == CANCELLED


def test_what_computes_waits_until_something_else_is_read(app: App) -> None:
    begin(app, c.OpenFrame(SLOW))
    app.send(c.Step())
    app.send(c.Seek(0))
    reading = app.debugger.workspace.tools.reading  # type: ignore[attr-defined]
    for _ in range(3):
        reading.clear()
        assert reading.wait(20)
    assert [type(command) for command in app._requests._queue] == [c.Step, c.Seek]
    app.send(c.Cancel())
    app.wait_until_idle()
    assert app.debugger.workspace.run.length == 0


@pytest.mark.parametrize("what", LONG)
def test_what_is_read_to_its_end_is_open_though_people_looked_around(app: App, what: str) -> None:
    app.send(c.Step())
    app.wait_until_idle()
    begin(app, LONG[what](app))
    app.send(c.Seek(0))
    wait_for(lambda: cursor(app) == 0)
    tools = type(app.debugger.workspace.tools)
    tools.enough = True  # type: ignore[attr-defined]
    app.wait_until_idle()
    space = app.debugger.workspace
    assert "bug" not in app.debugger.message
    opened = {
        "another frame": space.frame == SLOW,
        "new initial poses": space.session.title == "test" and space.session.hypotheses.seed == 1,
        "another session": space.session.title == "other",
        "B of a comparison": space.work.comparison is not None,
    }
    assert opened == {name: name == what for name in opened}
    assert "Reading for ever." not in words(app)
    app.send(c.Step())
    app.wait_until_idle()
    assert cursor(app) == 1


def test_cancel_while_nothing_takes_long_does_nothing(app: App) -> None:
    app.send(c.Step())
    app.wait_until_idle()
    said = words(app)
    app.send(c.Cancel())
    app.wait_until_idle()
    assert words(app) == said
    app.send(c.Step())
    app.wait_until_idle()
    assert cursor(app) == 2
    assert [type(command) for command in app.debugger.log] == [c.Step, c.Step]


def test_what_is_worked_out_aside_gives_way_to_whatever_is_asked_for(app: App, monkeypatch: pytest.MonkeyPatch) -> None:
    """Score maps and what physics says of the scene are worked out while nobody asks for anything."""
    asking = threading.Event()

    def for_ever() -> None:
        while True:
            asking.set()
            app._progress.checkpoint()
            sleep(0.01)

    monkeypatch.setattr(app.page, "go_on", for_ever)
    for k in (1, 2):
        asking.clear()
        app.send(c.Step())
        wait_for(lambda k=k: cursor(app) == k)
        assert asking.wait(20)
    assert app.debugger.message == ""


def test_the_program_ends_though_something_takes_for_ever(app: App) -> None:
    begin(app, c.OpenFrame(SLOW))
    app.stop()
    assert not app._worker.is_alive()


@pytest.mark.usefixtures("processes")
def test_the_program_ends_though_its_session_takes_for_ever_to_open(tmp_path: Path) -> None:
    class Tools(Slow):
        reading = threading.Event()

    session = SESSION.model_copy(update={"hypotheses": SESSION.hypotheses.model_copy(update={"seed": 1})})
    running = App(session, port=0, make_tools=Tools, folder=tmp_path)
    Tools.progress = running._progress
    running.start()
    assert Tools.reading.wait(20)
    running.send(c.Cancel())  # There is nothing to go back to.
    running.stop()
    assert not running._worker.is_alive()


def test_that_it_has_to_end_first_is_said_before_it_is_cancelled() -> None:
    said: list[bool] = []
    requests = RequestQueue(lambda: said.append(requests.is_wanted()))
    requests.send(c.Cancel())
    assert (said, requests.is_wanted()) == ([], True)
    with requests.cancellable():
        requests.send(c.Cancel())
        requests.send(c.Cancel())
        assert (said, requests.is_wanted()) == ([True], False)
    assert requests.is_wanted()
    debugger = Debugger(SESSION, None, FakeTools).carry_out([c.Step(), c.Cancel(), c.Step()])
    assert debugger.workspace.run.cursor == 2, "a list of commands may hold it"


class Decomposing(FakeTools):
    """Its second frame takes for ever until physics takes every model for its hull."""

    progress: ProgressToken
    waits_for = SLOW

    def problem(self, frame: str) -> Problem:
        while frame == self.waits_for and self.session.physics.collider == "decomposition":
            self.progress.checkpoint(f"Preparing {PARTS_OF} object 1 (mug) for physics.")
            sleep(0.01)
        return super().problem(frame)


def decomposing(tmp_path: Path, frame: str) -> App:
    class Tools(Decomposing):
        waits_for = frame

    running = App(SESSION, port=0, make_tools=Tools, folder=tmp_path)
    Tools.progress = running._progress
    return running.start()


@pytest.mark.usefixtures("processes")
def test_a_frame_is_opened_with_hulls_at_once_where_the_user_does_not_wait_and_the_page_says_so(tmp_path: Path) -> None:
    running = decomposing(tmp_path, SLOW)
    try:
        running.wait_until_idle()
        running.send(c.UseHulls())  # Nothing is being opened.
        running.send(c.OpenFrame(SLOW))
        wait_for(lambda: USE_HULLS in words(running))
        running.send(c.UseHulls())
        running.wait_until_idle()
        assert running.debugger.workspace.frame == SLOW
        assert running.debugger.workspace.session.physics.collider == "hull"
        assert [command for command in running.debugger.log if isinstance(command, c.OpenFrame)] == [
            c.OpenFrame(SLOW, hulls=True)
        ]
        assert USE_HULLS not in words(running)
        assert "takes every model for its convex hull" in running.page.layout.verdict._bar._handle.content
        running.send(c.OpenFrame("0/1"))
        running.wait_until_idle()
        assert running.debugger.workspace.session.physics.collider == "decomposition", "it was open before"
    finally:
        running.stop()


@pytest.mark.usefixtures("processes")
def test_the_program_opens_its_session_with_hulls_at_once_where_the_user_does_not_wait(tmp_path: Path) -> None:
    running = decomposing(tmp_path, "0/1")
    try:
        wait_for(lambda: hasattr(running, "_busy") and running._busy._hulls.visible)
        running.send(c.UseHulls())
        running.wait_until_idle()
        assert running.debugger.workspace.session.physics.collider == "hull"
    finally:
        running.stop()


def test_hulls_are_no_choice_where_nothing_is_opened_and_none_that_is_kept() -> None:
    requests = RequestQueue()
    requests.send(c.UseHulls())
    assert requests.is_wanted()
    with requests.opening():
        requests.send(c.UseHulls())
        assert not requests.is_wanted()
    assert requests.is_wanted()
    with requests.opening():
        assert requests.is_wanted()
