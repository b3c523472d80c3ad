"""A Chromium that needs no screen and no graphics card, for tests and benchmarks of the page."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from playwright.sync_api import Browser, sync_playwright

from verefine_viz.commands.chromium import find_chromium
from verefine_viz.core.errors import UnavailableError

FLAGS = [
    "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--disable-dev-shm-usage",
    "--disable-background-networking", "--disable-component-update", "--no-first-run",
]  # fmt: skip
"""Software WebGL, and nothing that a browser does on its own."""


@contextmanager
def headless_chromium() -> Iterator[Browser]:
    """The browser, closed at the end.

    Raises:
        UnavailableError: it is not installed.
    """
    found = find_chromium()
    if found is None:
        raise UnavailableError("no Chromium on this machine: apt-get install chromium")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=found, headless=True, args=FLAGS)
        yield browser
        browser.close()
