"""A Chromium that needs no screen and no graphics card, for tests and benchmarks of the page."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from playwright.sync_api import Browser, sync_playwright

from verefine_viz.commands.doctor_checks import find_chromium
from verefine_viz.core.errors import UnavailableError

FLAGS = [
    "--no-sandbox", "--disable-gpu", "--enable-unsafe-swiftshader", "--disable-dev-shm-usage",
    "--disable-background-networking", "--disable-component-update", "--no-first-run",
]  # fmt: skip
"""As on a machine without a GPU, and nothing that a browser does on its own. With ``--use-angle=swiftshader`` Chromium
takes software WebGL for a GPU and draws the words of the page with it too."""


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
