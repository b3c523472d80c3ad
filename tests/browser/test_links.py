"""Links, reloads, a program that is started again, and two windows."""

from __future__ import annotations

from tests.browser.conftest import SESSIONS
from verefine_viz.page.app import App
from verefine_viz.run.session_file import load_session

PLACE = "[state.view.k, moment.obj]"


def go(screen, k, obj=None):
    """Take a window to iteration k, and an object by its row in the list."""
    while screen.state("state.view.k") < k:
        known = screen.state("state.view.k")
        screen.key("ArrowRight")
        screen.until("state.view.k === arg", known + 1)
    if obj is not None:
        screen.page.locator(".objects tbody tr").nth(obj).click()
        screen.until("state.view.obj !== null")
    return screen.state(PLACE)


def test_link_opens_at_frame_object_and_iteration_and_a_reload_stays(show, pages):
    screen = show("clutter")
    place = go(screen, 3, obj=4)
    screen.page.context.grant_permissions(["clipboard-read", "clipboard-write"])
    screen.page.get_by_title("Copy a link").click()
    screen.text("The link is in the clipboard")
    link = screen.page.evaluate("navigator.clipboard.readText()")
    assert "frame=0/0" in link
    assert link.endswith("iteration=3")
    other = pages.show(screen.app, link.removeprefix(f"{screen.app.url}/"))
    other.until(f"String({PLACE}) === String(arg)", place)
    other.until("state.runs.get(state.view.branch)?.over")  # The whole run is there, the window stays.
    assert other.state(PLACE) == place
    other.shot("link_opened")
    other.page.reload()
    other.until("state.frame !== null")
    other.until(f"String({PLACE}) === String(arg)", place)
    assert [other.errors, other.foreign, screen.errors, screen.foreign] == [[], [], [], []]


def test_two_windows_look_at_what_they_want_and_say_which_one_3d_follows(show, pages):
    one = show()
    go(one, 3)
    two = pages.show(one.app)
    two.until("state.runs.get(state.view.branch)?.rows.length === 3")
    two.key("Home")
    two.key("ArrowRight")
    two.until("state.view.k === 1")
    assert one.state("state.view.k") == 3
    elsewhere = one.page.locator(".elsewhere")
    elsewhere.wait_for(timeout=60_000)
    assert two.page.locator(".elsewhere").count() == 0
    one.shot("two_windows")
    elsewhere.click()
    one.until("state.scene3d === state.window")
    two.page.locator(".elsewhere").wait_for(timeout=60_000)
    two.key("End")
    two.key("ArrowRight")  # One more iteration: both know it, each stays at its own.
    two.until("state.view.k === 4")
    one.until("state.runs.get(state.view.branch).rows.length === 4")
    assert one.app.debugger.look is not None


def test_program_that_is_started_again_goes_on_where_the_window_was(pages, tmp_path):
    path = SESSIONS / "mug.toml"
    app = App(load_session(path), path, port=0, folder=tmp_path).start()
    app.wait_until_ready(120)
    screen = pages.show(app)
    go(screen, 5)
    screen.key("ArrowLeft")
    screen.until("state.view.k === 4 && location.hash.includes('iteration=4')")
    app.stop()
    screen.until("state.connection === 'lost'")
    screen.text("The server does not answer")
    screen.shot("connection_lost")
    again = App(load_session(path), path, port=app.server.port, folder=tmp_path).start()
    try:
        again.wait_until_ready(120)
        screen.until("state.connection === 'open' && state.view.k === 4")
        # A view at the end of what is computed follows it.
        screen.until("state.runs.get(state.view.branch).over && moment.row.k === 4")
        assert screen.page.locator(".status.lost").count() == 0
        screen.key("ArrowRight")
        screen.until("state.view.k === 5")
    finally:
        again.stop()
