"""A headless Chromium that looks at the page."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.headless_chromium import headless_chromium
from verefine_viz.commands.doctor_checks import find_chromium
from verefine_viz.page.app import App
from verefine_viz.page.protocol import AnyVerb
from verefine_viz.run.session_file import load_session

SHOTS = Path(__file__).parent / "shots"
TAKES_SHOTS = bool(os.environ.get("SHOTS"))
"""Whether a picture of every task is written for a person to look at: ``SHOTS=1 pytest -m browser``."""
SIZE = {"width": 1280, "height": 800}
SESSIONS = Path(__file__).resolve().parents[2] / "sessions"
SLOW_MS = 60_000
"""Software WebGL freezes the page while it compiles shaders."""


@pytest.fixture(scope="session")
def chromium() -> Iterator[Any]:
    if find_chromium() is None:
        pytest.skip("no Chromium on this machine: apt-get install chromium")
    with headless_chromium() as browser:
        yield browser


class Screen:
    """One window of the page.

    Args:
        page: the browser's.
        address: of the page, a server's or a file's.
        app: what serves it; None = it is a file.
        link: part of the address.
    """

    def __init__(self, page: Any, address: str, app: App | None = None, link: str = "") -> None:
        self.page, self._app, self._address = page, app, address
        self._modules = "/web/" if app is not None else "web/"
        self.errors: list[str] = []
        self.foreign: list[str] = []
        page.set_default_timeout(SLOW_MS)
        page.on("pageerror", lambda error: self.errors.append(str(error)))
        page.on("console", lambda line: line.type == "error" and self.errors.append(line.text))
        page.on("request", self._requested)
        page.goto(f"{address}{link}")
        self.until("(state.frame !== null || state.report) && state.connection === 'open'")

    @property
    def app(self) -> App:
        """What serves the page."""
        assert self._app is not None
        return self._app

    def _requested(self, request: Any) -> None:
        own = (self._address, self._address.replace("http", "ws"), "data:", "blob:", "about:srcdoc")
        if not request.url.startswith(own):
            self.foreign.append(request.url)

    def state(self, expression: str, arg: object = None) -> Any:
        """Evaluate an expression about the page's ``state``, its ``moment`` and an ``arg``."""
        return self.page.evaluate(
            f"""async (arg) => {{
                const {{ state }} = await import("{self._modules}store.js");
                const {{ momentOf }} = await import("{self._modules}moment.js");
                const moment = momentOf(state);
                return {expression};
            }}""",
            arg,
        )

    def until(self, expression: str, arg: object = None) -> None:
        """Wait until an expression about the page's state holds, and is drawn."""
        for _ in range(SLOW_MS // 50):
            if self.state(expression, arg):
                self.page.evaluate("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")
                return
            self.page.wait_for_timeout(50)
        raise AssertionError(f"it never held: {expression}; the view is {self.state('state.view')}")

    def wait(self, holds: Callable[[], bool]) -> None:
        """Wait until a condition in Python holds."""
        for _ in range(SLOW_MS // 50):
            if holds():
                return
            self.page.wait_for_timeout(50)
        raise AssertionError("it never held")

    def settled(self, expression: str) -> Any:
        """The value of an expression once nothing is computed any more and it has stayed for 300 ms."""
        if self.app is not None:
            self.app.wait_until_idle()
        seen = self.state(expression)
        for _ in range(SLOW_MS // 300):
            self.page.wait_for_timeout(300)
            before, seen = seen, self.state(expression)
            if seen == before:
                return seen
        raise AssertionError(f"it never settled: {expression}")

    def key(self, key: str) -> None:
        self.page.keyboard.press(key)

    def view(self, **patch: Any) -> None:
        """Change what the window looks at."""
        self.state(f"(await import('{self._modules}store.js')).setView(arg)", patch)

    def finish(self) -> Screen:
        """Run to the end, where the answer is shown; return the screen."""
        self.key(" ")
        self.until("moment.isAnswer")
        return self

    def drag(self, start: tuple[float, float], by: tuple[float, float]) -> None:
        """Press the mouse at a place of the screen, move it, and let go."""
        self.page.mouse.move(*start)
        self.page.mouse.down()
        self.page.mouse.move(start[0] + by[0], start[1] + by[1], steps=6)
        self.page.mouse.up()

    def click(self, name: str) -> None:
        """Click the button of that name."""
        self.page.get_by_role("button", name=name, exact=True).first.click(timeout=SLOW_MS)

    def tab(self, name: str) -> None:
        """Show a tab of the inspector."""
        self.view(tab=name)
        self.page.wait_for_timeout(100)

    def text(self, words: str) -> Any:
        """Return the first element with these words, once it is seen."""
        found = self.page.get_by_text(words).filter(visible=True).first
        found.wait_for(timeout=SLOW_MS)
        return found

    def shot(self, name: str) -> None:
        """Write what is on the screen, where a person wants to look at it."""
        if TAKES_SHOTS:
            SHOTS.mkdir(exist_ok=True)
            self.page.wait_for_timeout(1500)
            self.page.screenshot(path=str(SHOTS / f"{name}.png"), timeout=SLOW_MS)


class Pages:
    """Apps and windows of one module; an app per session, a fresh window per test."""

    def __init__(self, browser: Any, folder: Path) -> None:
        self._browser, self._folder = browser, folder
        self._apps: dict[str, App] = {}
        self._windows: list[Any] = []

    def app(self, session: str = "mug", *first: AnyVerb, **given: Any) -> App:
        """Return the app of a session, started if need be."""
        name = f"{session} {first} {given}"
        if name not in self._apps:
            path = SESSIONS / f"{session}.toml"
            app = App(load_session(path), path, port=0, folder=self._folder, first=first, **given).start()
            app.wait_until_ready(240)
            self._apps[name] = app
        return self._apps[name]

    def show(self, app: App, link: str = "", size: dict[str, int] | None = None) -> Screen:
        """Open a window of an app."""
        page = self._browser.new_page(viewport=size or SIZE)
        self._windows.append(page)
        return Screen(page, f"{app.url}/", app, link)

    def open_file(self, path: Path, link: str = "", size: dict[str, int] | None = None) -> Screen:
        """Open a page that is a file, without a network."""
        context = self._browser.new_context(viewport=size or SIZE, offline=True)
        self._windows.append(context)
        return Screen(context.new_page(), path.as_uri(), None, link)

    def close_windows(self) -> None:
        """Close every window that is open."""
        for page in self._windows:
            page.close()
        self._windows.clear()

    def stop(self) -> None:
        self.close_windows()
        for app in self._apps.values():
            app.stop()


@pytest.fixture(scope="module")
def module_pages(chromium: Any, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Pages]:
    pages = Pages(chromium, tmp_path_factory.mktemp("sessions"))
    yield pages
    pages.stop()


@pytest.fixture
def pages(module_pages: Pages) -> Iterator[Pages]:
    yield module_pages
    module_pages.close_windows()


@pytest.fixture
def show(pages: Pages) -> Callable[..., Screen]:
    """Open a window of a session's app, at its start: branches of earlier tests are discarded."""
    from verefine_viz.page.protocol import Restart

    def opened(session: str = "mug", link: str = "", size: dict[str, int] | None = None) -> Screen:
        app = pages.app(session)
        app.send(Restart(min(app.debugger.space.branches), discard=True))
        app.wait_until_idle(180)
        return pages.show(app, link, size)

    return opened
