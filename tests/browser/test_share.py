"""A run as one file, opened from the disk without a network: looked at like the page; what needs the engine is grey."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from msgspec import structs

from tests.browser.conftest import Pages, Screen
from tests.browser.test_image import PICTURE, changes, to_pixel
from verefine_viz.page.protocol import RunVerb
from verefine_viz.page.share import opened, share
from verefine_viz.page.views.rows import run_message

MUG = Path(__file__).resolve().parents[2] / "sessions" / "mug.toml"
LACKS = "does not hold|holds the maps|no 3D view"


@pytest.fixture(scope="module")
def mug(tmp_path_factory: pytest.TempPathFactory, chromium) -> Path:
    path = tmp_path_factory.mktemp("share") / "mug.html"
    share(MUG, path)
    return path


def words(screen: Screen) -> str:
    return screen.page.inner_text(".page")


def test_the_mug_takes_five_megabytes_and_opens_at_its_end_with_all_its_iterations(pages: Pages, mug: Path):
    screen = pages.open_file(mug)
    screen.until("moment.isAnswer && document.querySelector('.maps canvas')")
    branch = opened(MUG).space.work.first
    poses = [[[*stage.T] for stage in row.stages] for row in run_message(branch, 0, branch).rows]
    shown = screen.state("state.runs.get(state.view.branch).rows")
    assert [[stage["T"] for stage in row["stages"]] for row in shown] == poses
    assert "Right" in words(screen)
    frame = screen.page.frame_locator("iframe")
    frame.locator("canvas").first.wait_for(timeout=60_000)
    screen.page.wait_for_timeout(2000)
    screen.shot("share_mug")
    assert screen.errors == []
    assert screen.foreign == []
    text = mug.read_text("utf-8")
    at = text.index('id="scene3d"')
    assert len(text) - (text.index("</script>", at) - at) < 5e6


def test_a_file_is_moved_through_by_keys_and_its_maps_have_numbers(pages: Pages, mug: Path):
    screen = pages.open_file(mug)
    screen.until("moment.isAnswer && document.querySelector('.maps canvas')")
    marked = {mark["k"] for mark in screen.state("moment.run.marks") if mark["tone"] != "switched"}
    n = screen.state("moment.run.rows.length")
    for k in range(n - 1, 0, -1):
        screen.key("ArrowLeft")
        screen.until("moment.k === arg && moment.stage === null", k)
        if k in marked:
            screen.until(
                "document.querySelectorAll('.map-tile canvas').length > 8 && !document.querySelector('.waiting')"
            )
    screen.view(k=n)
    u0, v0, u1, v1 = screen.state("moment.object.box")
    screen.key("o")
    screen.until("state.view.zoom === 'image'")
    to_pixel(screen, [(u0 + u1) // 2, (v0 + v1) // 2])
    row = ".pixel-numbers .rendered i"
    screen.until("/[0-9]/.test(document.querySelectorAll(arg)[0]?.textContent)", row)
    shown = screen.page.locator(row).nth(0).inner_text()
    T, obj = screen.state("moment.best.T"), screen.state("moment.obj")
    branch = opened(MUG).space.work.first
    depth = branch.final_evaluator.maps(branch.run.problem.target(obj), pose(T)).rendered_m
    assert float(shown.split()[0]) == pytest.approx(depth[(v0 + v1) // 2, (u0 + u1) // 2], abs=1e-4)


def pose(T: list[float]):
    from verefine_viz.page.protocol import pose_matrix

    return pose_matrix(tuple(T))


def test_every_tab_has_what_it_shows_and_what_needs_the_engine_is_grey(pages: Pages, mug: Path):
    screen = pages.open_file(mug)
    screen.until("moment.isAnswer && document.querySelector('.maps canvas')")
    titles = screen.state("(await import('web/tabs/all.js')).tabs.map(t => t.title)")
    assert len(titles) > 9
    for title in titles:
        screen.view(tab=title.lower())
        screen.page.wait_for_timeout(150)
        assert not screen.page.locator(".tab-content").get_by_text("does not hold").count(), title
    screen.view(tab="settings")
    restart = screen.page.get_by_role("button", name="Restart")
    assert restart.first.get_attribute("aria-disabled") == "true"
    restart.first.click(force=True)
    screen.text("It needs the program")
    assert "verefine-viz view mug.toml" in (restart.first.get_attribute("title") or "")
    screen.key("p")
    assert screen.state("state.view.edited") is None
    assert screen.errors == []


def test_wipe_and_blink_work_in_a_file(pages: Pages, mug: Path):
    screen = pages.open_file(mug)
    screen.until("moment.isAnswer && document.querySelector('.maps canvas')")
    assert changes(screen, lambda: screen.view(layers={"over": "shaded", "side": "b", "opacity": 1}))
    assert changes(screen, lambda: screen.view(layers={"over": "shaded", "wipe": "photo", "at": 0.5}))
    assert changes(screen, lambda: screen.view(layers={"blink": "b"}))
    assert screen.page.evaluate(PICTURE)


def test_an_iteration_without_maps_says_so_and_leads_to_one_that_has_them(pages: Pages, mug: Path):
    screen = pages.open_file(mug, "#iteration=20")
    screen.until("moment?.k === 20")
    screen.text("The file holds the maps of").wait_for()
    screen.page.locator(".maps-area button").last.click()
    screen.until("moment.isAnswer && document.querySelector('.maps canvas')")


def test_names_of_data_are_text_in_a_file(pages: Pages, tmp_path: Path):
    from verefine_viz.run.session_file import load_session, save_session

    evil = "</script><img src=x onerror=\"document.title='broken'\"><script>document.title='broken'</script>"
    session = structs.replace(load_session(MUG), title=evil)
    save_session(session, tmp_path / "evil.toml")
    share(tmp_path / "evil.toml", tmp_path / "evil.html", with_scene=False)
    screen = pages.open_file(tmp_path / "evil.html")
    screen.until("moment.isAnswer")
    assert "<img src=x" in screen.page.inner_text(".opener")
    assert screen.page.locator("img[src=x]").count() == 0
    assert "broken" not in screen.page.title().replace(evil, "")
    assert screen.page.locator(".pane.scene").is_hidden()
    image = screen.page.locator(".pane.image").bounding_box()
    maps = screen.page.locator(".pane.maps").bounding_box()
    assert image["width"] == maps["width"]  # It takes the room of the 3D view.
    assert screen.errors == []


def test_the_page_shares_itself(pages: Pages, tmp_path: Path):
    app = pages.app()
    screen = pages.show(app)
    app.send(RunVerb(min(app.debugger.space.branches)))
    screen.until("moment.isAnswer")
    screen.page.get_by_title("Share: this page").click()
    screen.until("state.written.length > 0")
    written = screen.state("state.written[0]")
    assert written["name"].endswith(".html")
    body = screen.page.request.get(f"{app.url}{written['url']}").body()
    (tmp_path / "own.html").write_bytes(body)
    file = pages.open_file(tmp_path / "own.html")
    file.until("moment.isAnswer && document.querySelector('.maps canvas')")
    rows = "JSON.stringify(state.runs.get(state.view.branch).rows)"
    assert json.loads(file.state(rows)) == json.loads(screen.state(rows))
