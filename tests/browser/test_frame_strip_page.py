"""The strip of a sequence on the page: a click opens a frame, and so does moving over it with the button held."""

from __future__ import annotations

from pathlib import Path

from tests.browser.conftest import Screen, Show, until_true
from tests.scenes.test_pose_sequence import write_sequence
from verefine_viz.run.data_folder import open_session
from verefine_viz.viewer.app import App

STRIP = ".vz svg.frames"
MARK_CENTRE = (
    "(() => { const s = document.querySelector('.vz svg.frames'), m = s.querySelector('.open').getBoundingClientRect();"
    " return (m.x + m.width / 2 - s.getBoundingClientRect().x) / s.getBoundingClientRect().width; })()"
)


def frame(screen: Screen) -> str:
    return screen.app.debugger.workspace.frame


def test_a_click_and_a_drag_open_frames_and_the_mark_follows(show: Show, tmp_path: Path) -> None:
    session = open_session(write_sequence(tmp_path / "box", n=6), {"physics": {"enabled": False}})
    screen = show(lambda port: App(session, port=port, folder=tmp_path))
    strip = screen.page.locator(STRIP)
    strip.wait_for()
    box = strip.bounding_box()
    assert box is not None
    at = [(box["x"] + (k + 0.5) / 6 * box["width"], box["y"] + box["height"] / 2) for k in range(6)]
    screen.page.mouse.click(*at[2])
    screen.until(lambda: frame(screen) == "0/3")
    until_true(screen.page, f"Math.abs({MARK_CENTRE} - 2.5 / 6) < 0.02")
    screen.page.mouse.move(*at[2])
    screen.page.mouse.down()
    for k in (3, 4, 5):
        screen.page.mouse.move(*at[k], steps=3)
    screen.page.mouse.up()
    screen.until(lambda: frame(screen) == "0/6")
    until_true(screen.page, f"Math.abs({MARK_CENTRE} - 5.5 / 6) < 0.02")
    screen.page.mouse.move(*at[0])  # The button is up: nothing follows the mouse any more.
    screen.page.wait_for_timeout(500)
    assert frame(screen) == "0/6"
    screen.key("o")
    screen.until(lambda: frame(screen) == "0/5")
    screen.shot("frame-strip")
