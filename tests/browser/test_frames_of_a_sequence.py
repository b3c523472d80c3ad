"""Frames of a folder that no batch has solved: their strip, their cards, keys and small pictures."""

from __future__ import annotations

from tests.scenes.test_foundation_pose import write_sequence
from verefine_viz.page.app import App
from verefine_viz.run.data_folder import open_session

CELLS = "[...document.querySelectorAll('.frame-cell')].map(c => [c.innerText, c.classList.contains('current')])"
PICTURED = "[...document.querySelectorAll('.frame-cell img')].filter(i => i.naturalWidth > 0).length === arg"


def test_a_folder_of_foundation_pose_has_a_strip_of_its_frames(pages, tmp_path):
    session = open_session(write_sequence(tmp_path / "mustard", n=4), {})
    app = App(session, port=0, folder=tmp_path / "sessions").start()
    try:
        app.wait_until_ready(120)
        screen = pages.show(app)
        frames = ["0/1", "0/2", "0/3", "0/4"]
        assert screen.state("state.frame.frames") == frames
        assert screen.state(CELLS) == [[f, f == "0/1"] for f in frames]
        screen.until(PICTURED, 4)
        screen.page.locator(".frame-strip .frame-cell").nth(2).click()
        screen.until("state.frame.frame === '0/3'")
        screen.key("]")
        screen.until("state.frame.frame === '0/4'")
        assert screen.state(CELLS)[3] == ["0/4", True]
        screen.key("g")
        screen.until("document.querySelectorAll('.frame-cards .frame-cell').length === 4")
        screen.page.locator(".frame-cards .frame-cell").nth(1).click()
        screen.until("state.frame.frame === '0/2'")
        assert screen.errors == []
    finally:
        app.stop()
