"""The page of a folder in which frames arrive: each is a tile at once, is solved, and can be opened."""

from __future__ import annotations

from pathlib import Path

from tests.browser.conftest import Show, until_true
from tests.fakes import box_problem
from tests.run.kept_frames import box_mesh, found, kept
from verefine_viz.batch.watch import Watch
from verefine_viz.run.session_file import resolve
from verefine_viz.viewer.app import App

QUICK = resolve({"method": {"name": "refine", "iterations": 2}, "physics": {"enabled": False}})
PROBLEM = box_problem(n_hypotheses=2)
TILES = """([n, waiting]) => {
    const numbers = [...document.querySelectorAll('.entry .number')].map(e => e.textContent);
    return numbers.length === n && numbers.filter(text => text === 'waiting').length <= waiting;
}"""


def test_frames_come_into_the_gallery_while_it_is_searched_and_open(show: Show, tmp_path: Path) -> None:
    mesh, frames = box_mesh(tmp_path / "box.stl"), tmp_path / "frames"
    kept(frames, PROBLEM, [found(PROBLEM, mesh)])
    watch = Watch(frames, tmp_path / "runs", QUICK)
    screen = show(lambda port: App(QUICK, port=port, folder=tmp_path, watch=watch))
    until_true(screen.page, TILES, [1, 0])
    screen.page.locator(".entry").click(modifiers=["Control"])
    screen.page.locator(".gallery-bar .search").click()
    screen.page.keyboard.type("bo")
    kept(frames, PROBLEM, [found(PROBLEM, mesh)])
    until_true(screen.page, TILES, [2, 2])
    screen.page.keyboard.type("x")
    assert screen.page.locator(".gallery-bar .search").input_value() == "box"
    until_true(screen.page, TILES, [2, 0])
    until_true(screen.page, "document.querySelectorAll('.entry.chosen').length === 1")
    screen.shot("watched")
    screen.page.locator(".entry").filter(has_text="1/2").click()
    screen.until(lambda: screen.app.debugger.workspace.frame == "1/2")
    until_true(screen.page, "location.hash.startsWith('#frame=1/2')")
    assert screen.app.debugger.workspace.frames == ("1/1", "1/2")
