"""A headless Chromium that looks at the page."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from verefine_viz.session.files import load_session, resolve, save_session
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.app import App

SHOTS = Path(__file__).parent / "shots"
SESSIONS = Path(__file__).resolve().parents[2] / "sessions"
SLOW_MS = 120_000
"""Software WebGL freezes the page while it compiles shaders, for over a minute where other work shares the cores."""
FLAGS = [
    "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--disable-dev-shm-usage",
    "--disable-background-networking", "--disable-component-update", "--no-first-run",
]  # fmt: skip


@pytest.fixture(scope="session")
def chromium() -> Iterator[Any]:
    found = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    if found is None:
        pytest.skip("no Chromium on this machine: apt-get install chromium")
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=found, headless=True, args=FLAGS)
        yield browser
        browser.close()


class Screen:
    """One open page and the app behind it."""

    def __init__(self, app: App, page: Any) -> None:
        self.app, self.page = app, page
        self.foreign: list[str] = []
        self.errors: list[str] = []
        page.on("request", self._requested)
        page.on("pageerror", lambda error: self.errors.append(str(error)))
        page.goto(app.url)
        page.get_by_role("button", name="Step ▶").wait_for(timeout=SLOW_MS)
        page.wait_for_function("window.__viserTestpoints?.rendererInfo?.render?.frame >= 3", timeout=SLOW_MS)

    def _requested(self, request: Any) -> None:
        if not request.url.startswith((self.app.url, "data:", "blob:", self.app.url.replace("http", "ws"))):
            self.foreign.append(request.url)

    def click(self, name: str) -> None:
        """A button, or an option of a button group."""
        self.page.get_by_role("button", name=name, exact=True).first.click(timeout=SLOW_MS)
        self.page.wait_for_timeout(120)  # viser's throttle swallows clicks within 50 ms of each other

    def tab(self, name: str) -> None:
        """A tab of the right-hand panel (the last of that name: the curves have a Score tab as well)."""
        self.page.get_by_role("tab", name=name, exact=True).last.click(timeout=SLOW_MS)

    def key(self, key: str) -> None:
        self.page.keyboard.press(key)
        self.page.wait_for_timeout(120)

    def text(self, pattern: str) -> Any:
        """Some words on the page, waited for."""
        found = self.page.get_by_text(re.compile(pattern)).first
        found.wait_for(timeout=SLOW_MS)
        return found

    def at(self, cursor: int) -> None:
        """Waits until the timeline says that this iteration is shown."""
        self.text(rf"^iteration {cursor} / ")
        self.app.wait_until_idle(60)

    def until(self, condition: Callable[[], bool]) -> None:
        """Waits until something holds in the app; a key's message takes a moment to arrive."""
        for _ in range(SLOW_MS // 50):
            if condition():
                return self.app.wait_until_idle(60)
            self.page.wait_for_timeout(50)
        raise AssertionError("it never happened")

    def shot(self, name: str) -> None:
        """Keeps what is on the screen."""
        self.app.wait_until_idle(60)
        self.page.wait_for_timeout(700)  # the last pictures reach the canvas
        SHOTS.mkdir(exist_ok=True)
        self.page.screenshot(path=str(SHOTS / f"{name}.png"), timeout=SLOW_MS)


Look = Callable[..., Screen]
"""What the fixture :func:`look` gives."""


def saved(folder: Path, **settings: Any) -> Path:
    """A session file with these settings, a dictionary per section."""
    path = folder / "session.toml"
    save_session(resolve(settings), path)
    return path


def is_seen(screen: Screen, found: Any, edge_px: float = 2) -> bool:
    """Whether the first of what was found lies on the screen whole, with nothing over it and not scrolled away.

    Its lowest and uppermost ``edge_px`` do not count.
    """
    found.first.wait_for(timeout=SLOW_MS)
    screen.page.wait_for_timeout(300)
    return found.first.evaluate(
        """(e, edge) => {const b = e.getBoundingClientRect();
        const seen = (x, y) => {const t = document.elementFromPoint(x, y); return !!t && e.contains(t);};
        return b.height > 0 && seen(b.x + b.width / 2, b.y + edge) && seen(b.x + b.width / 2, b.bottom - edge);}""",
        edge_px,
    )


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


@pytest.fixture
def look(chromium: Any, tmp_path: Path) -> Iterator[Look]:
    """Opens a session file's page at 1280×800; checks at the end that it asked nobody else for anything."""
    opened: list[Screen] = []

    def open_session(path: Path, animate: bool = False) -> Screen:
        app = App(load_session(path), path, port=0, folder=tmp_path).start()
        app.wait_until_ready(240)
        app.send(c.Animate(animate))
        screen = Screen(app, chromium.new_page(viewport={"width": 1280, "height": 800}))
        opened.append(screen)
        return screen

    yield open_session
    for screen in opened:
        screen.page.close()
        screen.app.stop()
    assert [screen.foreign for screen in opened] == [[]] * len(opened)
    assert [screen.errors for screen in opened] == [[]] * len(opened)
