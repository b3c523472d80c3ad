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
    """One window of the page, and the app behind it."""

    def __init__(self, app: App, page: Any, link: str = "") -> None:
        self.app, self.page = app, page
        self.errors: list[str] = []
        self.foreign: list[str] = []
        page.on("pageerror", lambda error: self.errors.append(str(error)))
        page.on("console", lambda line: line.type == "error" and self.errors.append(line.text))
        page.on("request", self._requested)
        page.goto(f"{app.url}/{link}")
        self.until("state.frame !== null && state.connection === 'open'")

    def _requested(self, request: Any) -> None:
        if not request.url.startswith((self.app.url, "data:", "blob:", self.app.url.replace("http", "ws"))):
            self.foreign.append(request.url)

    def state(self, expression: str, arg: object = None) -> Any:
        """Evaluate an expression about the page's ``state``, its ``moment`` and an ``arg``."""
        return self.page.evaluate(
            f"""async (arg) => {{
                const {{ state }} = await import("/web/store.js");
                const {{ momentOf }} = await import("/web/moment.js");
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

    def key(self, key: str) -> None:
        self.page.keyboard.press(key)

    def view(self, **patch: Any) -> None:
        """Change what the window looks at."""
        self.state("(await import('/web/store.js')).setView(arg)", patch)

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
            app.wait_until_ready(120)
            self._apps[name] = app
        return self._apps[name]

    def show(self, app: App, link: str = "", size: dict[str, int] | None = None) -> Screen:
        """Open a window of an app."""
        page = self._browser.new_page(viewport=size or SIZE)
        self._windows.append(page)
        return Screen(app, page, link)

    def close_windows(self) -> None:
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
        app.wait_until_idle(60)
        return pages.show(app, link, size)

    return opened
