"""Links: the page opens what its address says, the address follows what is shown, a button copies it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from tests.browser.conftest import QUERY, Screen, Show, until_true
from verefine_viz.run.session_file import resolve
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.app import App

SESSION = resolve(
    {
        "scene": {"source": "demo", "demo": "clutter", "objects": [1, 4]},
        "method": {"name": "pir", "iterations": 3},
        "physics": {"enabled": False},
    }
)


def address(screen: Screen, link: str) -> None:
    """Waits until the address is this."""
    until_true(screen.page, "link => location.hash === `#${link}`", link)


def at(screen: Screen) -> tuple[str, int | None, int]:
    debugger = screen.app.debugger
    return debugger.workspace.frame, debugger.options.focus, debugger.run.cursor


def test_an_address_opens_what_it_says_and_follows_what_is_shown(show: Show, chromium: Any, tmp_path: Path) -> None:
    screen = show(lambda port: App(SESSION, port=port, folder=tmp_path))
    address(screen, "frame=0/0&iteration=0")
    screen.page.evaluate("location.hash = 'frame=0/1&object=4&iteration=2'")
    screen.until(lambda: at(screen)[0] == "0/1")
    screen.at(2)
    focus = at(screen)[1]
    assert {i.instance_id: i.obj_id for i in screen.app.debugger.workspace.work.problem.instances}[focus or 0] == 4
    screen.key("n")
    screen.at(3)
    address(screen, "frame=0/1&object=4&iteration=3")
    screen.page.evaluate("location.hash = 'frame=0/7'")
    screen.text("unknown frame '0/7'; available: 0/0, 0/1, 0/2")
    screen.shot("link-unknown")
    screen.app.send(c.OpenFrame("0/2"))
    address(screen, "frame=0/2&iteration=0")

    # The button copies the link, and a new page opens it.
    screen.app.send(c.OpenLink("frame=0/1&iteration=2"))
    screen.at(2)
    screen.page.context.grant_permissions(["clipboard-read", "clipboard-write"])
    screen.page.locator(".copy-link").click()
    until_true(screen.page, "document.body.classList.contains('copied')")
    copied = screen.page.evaluate("navigator.clipboard.readText()")
    assert copied == f"{screen.app.url}/{QUERY}#frame=0/1&iteration=2"
    screen.app.send(c.OpenFrame("0/0"))
    screen.until(lambda: at(screen)[0] == "0/0")
    page = chromium.new_page()
    try:
        page.goto(copied)
        screen.until(lambda: at(screen) == ("0/1", None, 2))
        address(screen, "frame=0/1&iteration=2")
        # Loaded again, it leaves the program where that is by now.
        screen.app.send(c.OpenFrame("0/2"))
        until_true(page, "location.hash === '#frame=0/2&iteration=0'")
        screen.app.send(c.Step())
        page.reload()
        until_true(page, "location.hash === '#frame=0/2&iteration=1'")
        assert at(screen) == ("0/2", None, 1)
    finally:
        page.close()
