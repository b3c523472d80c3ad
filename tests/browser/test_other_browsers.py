"""The page, a share file and a report in Firefox and WebKit; what a browser shows in which the page cannot start."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.browser.conftest import SESSIONS
from tests.browser.web_drivers import Driver, firefox, webkit
from tests.report.pages import GONE
from tests.report.runs import row, write_run
from tests.report.test_written import made
from verefine_viz.page.app import App
from verefine_viz.page.share import share
from verefine_viz.run.session_file import load_session

MUG = SESSIONS / "mug.toml"
PICTURE = """
    const canvas = document.querySelector(".pane.image canvas");
    if (!canvas?.width || !document.querySelector(".map-tile canvas")) return false;
    const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
    return new Set(new Uint32Array(data.buffer)).size > 100;"""
"""Whether the photo is drawn, and maps are there."""
NO_3D = """return Boolean(document.createElement("canvas").getContext("webgl2"))
    !== Boolean(document.querySelector(".pane.scene .content > .empty"));"""
"""Whether the 3D pane says that there is no 3D where there is none, and only there."""
SOUND = """return !document.querySelector(".cannot-start, .pane .empty > p, .toast.error");"""


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A share file and a report."""
    folder = tmp_path_factory.mktemp("files")
    share(MUG, folder / "mug.html")
    return folder / "mug.html", made(write_run(folder / "run", [row(1), row(2, add_s_mm=40.0)], GONE))


@pytest.fixture(scope="module")
def app(tmp_path_factory: pytest.TempPathFactory) -> Iterator[App]:
    app = App(load_session(MUG), MUG, port=0, folder=tmp_path_factory.mktemp("sessions")).start()
    app.wait_until_ready(120)
    yield app
    app.stop()


def opens_all(browser: Driver, app: App, files: tuple[Path, Path]) -> None:
    """The page, the share file and the report are drawn, and nothing in them fails."""
    shared, report = files
    for address in (f"{app.url}/", shared.as_uri()):
        browser.open(address)
        for holds in (PICTURE, NO_3D, SOUND):
            browser.until(holds)
    browser.open(report.as_uri())
    browser.until("return document.querySelectorAll('.report .card').length > 0")
    browser.until(SOUND)


def test_firefox_opens_page_file_and_report(app: App, files: tuple[Path, Path], tmp_path: Path):
    with firefox(tmp_path) as browser:
        opens_all(browser, app, files)


def test_webkit_opens_page_file_and_report_where_the_system_has_no_language(
    app: App, files: tuple[Path, Path], tmp_path: Path
):
    with webkit(tmp_path) as browser:
        opens_all(browser, app, files)


def test_a_page_that_cannot_start_says_why(chromium, app: App):
    page = chromium.new_page()
    page.route("**/web/pose.js", lambda route: route.fulfill(body="syntax error", content_type="text/javascript"))
    page.goto(f"{app.url}/")
    words = page.locator(".cannot-start").inner_text()
    assert "SyntaxError" in words
    assert "pose.js" in words
    page.close()
