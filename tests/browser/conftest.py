"""A headless Chromium that looks at the page."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.headless_chromium import headless_chromium
from verefine_viz.commands.doctor_checks import find_chromium
from verefine_viz.core.errors import UnavailableError
from verefine_viz.run.session_file import load_session, resolve, save_session
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.app import App
from verefine_viz.viewer.web import client_messages

SHOTS = Path(__file__).parent / "shots"
TAKES_SHOTS = bool(os.environ.get("SHOTS"))
"""Whether pictures of every test are kept for a person to look at; each takes seconds."""
QUERY = "" if TAKES_SHOTS else "?fixedDpr=0.5"
"""Without pictures 3D is drawn at half the width and height: the time of software WebGL goes with the pixels."""
SIZE = {"width": 1280, "height": 800}
FAILED = pytest.StashKey[bool]()
SESSIONS = Path(__file__).resolve().parents[2] / "sessions"
SLOW_MS = 120_000
"""Software WebGL freezes the page while it compiles shaders, for over a minute where other work shares the cores."""


@pytest.fixture(scope="session")
def chromium() -> Iterator[Any]:
    if find_chromium() is None:
        pytest.skip("no Chromium on this machine: apt-get install chromium")
    with headless_chromium() as browser:
        yield browser


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Iterator[None]:
    """Remembers which test failed: it is unknown what it left on its page."""
    report = yield
    item.stash[FAILED] = item.stash.get(FAILED, False) or report.failed
    return report


def until_true(page: Any, expression: str, arg: object = None) -> None:
    """Waits until an expression holds on the page; Playwright's own wait evaluates it there, which is forbidden."""
    for _ in range(SLOW_MS // 50):
        if page.evaluate(expression, arg):
            return
        page.wait_for_timeout(50)
    raise AssertionError(f"it never held: {expression}")


class Screen:
    """One page and the app behind it; a page that already looks at the app's address connects again by itself."""

    def __init__(self, app: App, page: Any) -> None:
        self.app, self.page = app, page
        self.foreign: list[str] = []
        self.errors: list[str] = []
        page.on("request", self._requested)
        page.on("pageerror", self._failed)
        frame = 0
        if page.url.startswith(app.url):
            frame = page.evaluate("window.__viserTestpoints.rendererInfo.render.frame")
            self.until(lambda: len(app.server.get_clients()) == 1)
            self._as_at_the_start()
        else:
            page.goto(f"{app.url}/{QUERY}")
        page.get_by_role("button", name="Step ▶").wait_for(timeout=SLOW_MS)
        drawn = f"window.__viserTestpoints?.rendererInfo?.render?.frame >= {frame + 3}"
        until_true(page, drawn)

    def _as_at_the_start(self) -> None:
        """The mouse away from everything, and the camera where a new page has it."""
        self.page.mouse.move(1, 1)
        first = self.app.server.initial_camera
        assert first.up is not None
        for client in self.app.server.get_clients().values():
            client.camera.up_direction = first.up
            client.camera.position, client.camera.look_at = first.position, first.look_at

    def leave(self) -> None:
        """Listens to the page no longer."""
        self.page.remove_listener("request", self._requested)
        self.page.remove_listener("pageerror", self._failed)

    def _failed(self, error: Any) -> None:
        self.errors.append(str(error))

    def _requested(self, request: Any) -> None:
        if not request.url.startswith((self.app.url, "data:", "blob:", self.app.url.replace("http", "ws"))):
            self.foreign.append(request.url)

    def click(self, name: str) -> None:
        """A button, or an option of a button group."""
        self.page.get_by_role("button", name=name, exact=True).first.click(timeout=SLOW_MS)
        self.page.wait_for_timeout(120)  # viser's throttle swallows clicks within 50 ms of each other

    def tab(self, name: str) -> None:
        """A tab of the right column; below it the curves and the list of objects have tabs of their own."""
        column = self.page.locator("[data-dock-region=right]")
        column.get_by_role("tab", name=name, exact=True).click(timeout=SLOW_MS)

    def curve(self, name: str) -> None:
        """A tab of the curves and the list of objects."""
        corner = self.page.locator("[data-floating-window]:has(.curves, .objects)")
        corner.get_by_role("tab", name=name, exact=True).click(timeout=SLOW_MS)

    def key(self, key: str) -> None:
        self.page.keyboard.press(key)
        self.page.wait_for_timeout(120)

    def text(self, pattern: str) -> Any:
        """Some words on the page, waited for."""
        found = self.page.get_by_text(re.compile(pattern)).filter(visible=True).first
        found.wait_for(timeout=SLOW_MS)
        return found

    def finished(self) -> str:
        """The verdict's cause, waited for until the run is over."""
        self.page.locator(".vz.verdict .bar-line:not(.going)").wait_for(timeout=SLOW_MS)
        return self.page.locator(".vz.verdict .cause").inner_text()

    def why(self, pattern: str) -> Any:
        """Some words of what the verdict rests on, opened and waited for."""
        if not self.page.evaluate("document.body.classList.contains('why')"):
            self.page.locator(".vz.verdict button.why").click(timeout=SLOW_MS)
        found = self.page.locator(".vz.verdict .because").get_by_text(re.compile(pattern)).first
        found.wait_for(timeout=SLOW_MS)
        return found

    def at(self, cursor: int) -> None:
        """Waits until the timeline says that this iteration is shown."""
        self.text(rf"^Iteration {cursor} of ")
        self.app.wait_until_idle(60)

    def until(self, condition: Callable[[], bool]) -> None:
        """Waits until something holds in the app; a key's message takes a moment to arrive."""
        for _ in range(SLOW_MS // 50):
            if condition():
                return self.app.wait_until_idle(60)
            self.page.wait_for_timeout(50)
        raise AssertionError("it never happened")

    def shot(self, name: str) -> None:
        """Keeps what is on the screen, where a person wants to look at it: ``SHOTS=1 pytest -m browser``."""
        self.app.wait_until_idle(60)
        if TAKES_SHOTS:
            self.picture(name)

    def picture(self, name: str) -> Path:
        """Keeps what is on the screen in any case."""
        self.app.wait_until_idle(60)
        self.page.wait_for_timeout(700)  # the last pictures reach the canvas
        SHOTS.mkdir(exist_ok=True)
        path = SHOTS / f"{name}.png"
        self.page.screenshot(path=str(path), timeout=SLOW_MS)
        return path

    def table(self, *headers: str) -> list[list[str]]:
        """The cells below the headers of the first table on the screen whose header row has these."""
        self.app.wait_until_idle(60)
        tables = """() => [...document.querySelectorAll('.vz table')].filter(t => t.offsetParent)
            .map(t => [...t.rows].map(r => [...r.cells].map(c => c.innerText.trim())))"""
        for _ in range(SLOW_MS // 100):
            for first, *rows in self.page.evaluate(tables):
                if set(headers) <= set(first):
                    return rows
            self.page.wait_for_timeout(100)
        raise AssertionError(f"no table with {headers} is shown")


Show = Callable[[Callable[[int], App]], Screen]
"""What the fixture :func:`show` gives."""
Look = Callable[..., Screen]
"""What the fixture :func:`look` gives."""


def saved(folder: Path, **settings: Any) -> Path:
    """A session file with these settings, a dictionary per section."""
    path = folder / "session.toml"
    save_session(resolve(settings), path)
    return path


_IS_SEEN = """(e, edge) => {
    const b = e.getBoundingClientRect();
    const seen = (x, y) => {const t = document.elementFromPoint(x, y); return !!t && e.contains(t);};
    if (b.height > 0 && seen(b.x + b.width / 2, b.y + edge) && seen(b.x + b.width / 2, b.bottom - edge))
        return [b.x, b.y, b.width, b.height];
}"""


def is_seen(screen: Screen, found: Any, edge_px: float = 2) -> bool:
    """Whether the first of what was found lies on the screen whole, with nothing over it and not scrolled away.

    Its lowest and uppermost ``edge_px`` do not count.
    """
    found.first.wait_for(timeout=SLOW_MS)
    seen = []  # A page that was just opened may still be moving: it has to stay at its place.
    for _ in range(45):
        seen.append(found.first.evaluate(_IS_SEEN, edge_px))
        if seen[-1] is not None and seen[-3:] == 3 * seen[-1:]:
            return True
        screen.page.wait_for_timeout(100)
    return False


@pytest.fixture
def real_session(shared_data: Path, tmp_path: Path) -> Path:
    """A session of one YCB-Video frame with the poses of several estimators."""
    estimates = sorted((shared_data / "ycbv" / "pose_estimates").glob("*.csv"))
    files = ", ".join(f'"{p}"' for p in estimates if "icp" not in p.name)
    path = tmp_path / "real.toml"
    path.write_text(
        f'title = "YCB-Video 50/1"\n[scene]\nsource = "bop"\ndataset = "{shared_data / "ycbv"}"\nframes = ["50/1"]\n'
        f'[hypotheses]\nsource = "results"\nfiles = [{files}]\n'
    )
    return path


class Tab:
    """The page that stays open from test to test: software WebGL takes most of a test's time to set up a new one.

    The next test's app listens where the last one did, and the page goes over to it as it does when a person starts
    the program again: panels and scene are cleared when it connects. What a test may have left besides (an error)
    is not cleaned up: then the next test gets a new page.
    """

    def __init__(self, chromium: Any) -> None:
        self._chromium = chromium
        self._page: Any = None
        self._port = 0

    def show(self, app_at: Callable[[int], App]) -> Screen:
        """Starts an app at the port that it is given, and shows it once it is ready."""
        try:
            app = app_at(self._port).start()
        except UnavailableError:  # Another program was faster.
            self.drop()
            app = app_at(0).start()
        app.wait_until_ready(240)
        if self._page is None:
            self._page, self._port = self._chromium.new_page(viewport=SIZE), app.server.get_port()
        return Screen(app, self._page)

    def drop(self) -> None:
        """The next test gets a new page."""
        if self._page is not None:
            self._page.close()
        self._page, self._port = None, 0

    def end(self, screen: Screen, failed: bool) -> None:
        """Stops a test's app; the page stays if nothing is wrong with it."""
        screen.leave()
        if failed or screen.foreign or screen.errors:
            self.drop()
        elif screen.page.viewport_size != SIZE:
            screen.page.set_viewport_size(SIZE)
        screen.app.stop()


@pytest.fixture(scope="session")
def tab(chromium: Any) -> Iterator[Tab]:
    tab = Tab(chromium)
    yield tab
    tab.drop()


@pytest.fixture
def show(tab: Tab, request: pytest.FixtureRequest, caplog: pytest.LogCaptureFixture) -> Iterator[Show]:
    """Shows an app at 1280×800; checks at the end that its page asked nobody else for anything, and that all it sent
    was well formed.
    """
    shown: list[Screen] = []

    def show_app(app_at: Callable[[int], App]) -> Screen:
        assert not shown, "there is one page"
        shown.append(tab.show(app_at))
        return shown[0]

    yield show_app
    for screen in shown:
        tab.end(screen, request.node.stash.get(FAILED, True))
    assert [screen.foreign for screen in shown] == [[]] * len(shown)
    assert [screen.errors for screen in shown] == [[]] * len(shown)
    assert [r.getMessage() for r in caplog.get_records("call") if r.name == client_messages.__name__] == []


@pytest.fixture
def look(show: Show, tmp_path: Path) -> Look:
    """Opens a session file's page."""

    def open_session(path: Path, animate: bool = False) -> Screen:
        first = (c.Animate(animate),)
        return show(lambda port: App(load_session(path), path, port=port, folder=tmp_path, first=first))

    return open_session
