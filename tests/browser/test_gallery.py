"""A folder of batch runs on the page: filtered, sorted, and opened where an object went wrong."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import pytest

from tests.browser.conftest import SIZE, SLOW_MS, Screen, Show, is_seen, until_true
from tests.browser.test_layout import WINDOWS, boxes_of
from tests.changing import replace
from tests.made_runs import answer, finished
from verefine_viz.batch.answer_cards import WRONG
from verefine_viz.batch.folder import RunFolder
from verefine_viz.core.settings import Session
from verefine_viz.run.record import DATA_FIRST
from verefine_viz.run.session_file import resolve
from verefine_viz.scenes.demo import demo_problem
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.app import App
from verefine_viz.viewer.state.batch_gallery import Gallery, plot_of, read_gallery

MUG, CAN = 1, 4
ERRORS_MM = {("rir", 0): (30.0, 2.0), ("rir", 1): (50.0, 20.0), ("sir", 0): (70.0, 1.0), ("sir", 1): (3.0, 90.0)}
"""By run and image: of the mug and of the can."""
EVIDENCE = "The refiner led the mug astray."


def written(folder: Path, session: Session) -> None:
    """A batch run whose answers are the first hypotheses, and whose numbers are made up."""
    run, method = RunFolder(folder, session), session.method.name
    for im_id in (0, 1):
        targets = demo_problem("clutter", session.scene, session.hypotheses, f"0/{im_id}").targets
        objects = tuple(
            answer(
                0, im_id, instance_id=t.instance.instance_id, obj_id=t.model.obj_id, name=t.model.name,
                T_cam_obj=t.instance.hypotheses[0].T_cam_obj,
                method=method, has_truth=True, status="ok", score=0.9 - 0.005 * error_mm, add_s_mm=error_mm,
                diameter_mm=1e3 * t.model.diameter_m, worst_iteration=2 + k, n_iterations=4,
                cause=("refiner", "score")[k] if error_mm > 15 else "", evidence=EVIDENCE if error_mm > 15 else "",
            )
            for k, (t, error_mm) in enumerate(zip(targets, ERRORS_MM[method, im_id], strict=True))
        )  # fmt: skip
        run.runs.save(session, finished(f"0/{im_id}", objects))
    run.write_json("run.json", {"status": "finished"})
    run.close()


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of two runs, which every test only reads."""
    folder = tmp_path_factory.mktemp("gallery")
    for name in ("rir", "sir"):
        (folder / name).mkdir()
        method = {"name": name, "iterations": 2}
        pool = {"max_per_object": 2}
        scene = {"source": "demo", "demo": "clutter", "objects": [MUG, CAN]}
        written(folder / name, resolve({"scene": scene, "method": method, "hypotheses": pool}))
    return folder


@pytest.fixture
def shown(runs: Path, show: Show, tmp_path: Path) -> tuple[Screen, Gallery]:
    """The page of two runs, as ``view DIR`` opens it."""
    gallery = read_gallery(runs)
    session = gallery.session(gallery.worst.run)
    return show(lambda port: App(session, port=port, folder=tmp_path, batch=gallery)), gallery


def names(screen: Screen) -> list[str]:
    """Object, frame and run of the tiles that are shown, in their order."""
    line = "`${e.querySelector('h3').textContent} ${e.querySelector('.where span').textContent}`"
    found = screen.page.evaluate(f"[...document.querySelectorAll('.entry:not([hidden])')].map(e => {line})")
    return [line.replace(" · ", " ") for line in found]


def at(screen: Screen) -> tuple[str, str, int]:
    """Method, frame and iteration that are open."""
    space = screen.app.debugger.workspace
    return space.tools.session.method.name, space.frame, space.run.cursor


def choose(screen: Screen, by: str, label: str) -> None:
    screen.page.get_by_label(by, exact=True).select_option(label=label, timeout=SLOW_MS)
    screen.page.wait_for_timeout(400)  # Until the program knows.
    screen.app.wait_until_idle(60)


def preset(screen: Screen) -> str:
    """The layout that is shown, once the page shows what the program has."""
    name = screen.app.debugger.options.preset
    until_true(screen.page, f"document.documentElement.dataset.preset === '{name}'")
    return name


def tile(screen: Screen, k: int) -> Any:
    return screen.page.locator(".entry:not([hidden])").nth(k)


def the_grid_fills_the_middle_of_every_window(screen: Screen) -> None:
    def fills() -> bool:
        boxes, grid = boxes_of(screen), screen.page.locator(".gallery-pane .gallery").bounding_box()
        if boxes.keys() != {"right column", "curves"}:  # Nothing else is seen.
            return False
        left, _, right, _ = boxes["right column"]
        if abs(right - width) > 1:  # Still that of the window before.
            return False
        return grid["x"] + grid["width"] <= left and grid["width"] > 0.98 * left - 10 and grid["height"] > height - 20

    for width, height in (*WINDOWS, (SIZE["width"], SIZE["height"])):
        screen.page.set_viewport_size({"width": width, "height": height})
        screen.until(fills)
        assert 160 <= tile(screen, 0).bounding_box()["width"] <= 420
        screen.shot(f"gallery_{width}x{height}")


def test_the_gallery_filters_sorts_and_opens_where_it_went_wrong(shown: tuple[Screen, Gallery]) -> None:
    screen, _ = shown
    assert preset(screen) == "gallery"
    screen.text("3 of 8 objects of 2 runs are right")
    assert names(screen) == ["can 0/1 sir", "mug 0/0 sir", "mug 0/1 rir", "mug 0/0 rir", "can 0/1 rir"]
    until_true(screen.page, "document.querySelectorAll('.entry:not([hidden]) img').length === 5")
    parts = "[...document.querySelectorAll('.entry:not([hidden]), .gallery-top')]"
    assert screen.page.evaluate(f"{parts}.every(e => e.scrollWidth <= e.clientWidth)")
    assert is_seen(screen, tile(screen, 0))
    screen.shot("gallery")
    the_grid_fills_the_middle_of_every_window(screen)

    choose(screen, "Object", "mug")
    assert names(screen) == ["mug 0/0 sir", "mug 0/1 rir", "mug 0/0 rir"]
    choose(screen, "Method", "rir")
    choose(screen, "Sort by", "frame")
    assert names(screen) == ["mug 0/0 rir", "mug 0/1 rir"]
    tile(screen, 1).click(timeout=SLOW_MS)
    screen.until(lambda: at(screen) == ("rir", "0/1", 2))
    screen.until(lambda: preset(screen) == "inspect")
    screen.why(f"Why it failed in the batch: {EVIDENCE}")
    screen.key("Escape")  # Closes what the verdict rests on.
    screen.key("Escape")
    screen.until(lambda: preset(screen) == "gallery")
    assert names(screen) == ["mug 0/0 rir", "mug 0/1 rir"], "filters stay"
    until_true(screen.page, "document.querySelector('.entry.open .where')?.textContent.includes('0/1')")

    choose(screen, "Method", "any method")
    choose(screen, "Object", "any object")
    choose(screen, "Cause", "score ranks a wrong pose above the ground truth")
    assert names(screen) == ["can 0/1 rir", "can 0/1 sir"]
    screen.key("j")
    screen.until(lambda: at(screen) == ("rir", "0/1", 3))
    screen.key("j")
    screen.until(lambda: at(screen) == ("sir", "0/1", 3))


def test_the_gallery_is_moved_through_searched_and_tagged_by_keys(runs: Path, show: Show, tmp_path: Path) -> None:
    folder = shutil.copytree(runs, tmp_path / "runs")
    gallery = read_gallery(folder)
    screen = show(lambda port: App(gallery.session("sir"), port=port, folder=tmp_path, batch=gallery))
    page, current = screen.page, ".entry.current .where"
    assert page.locator(current).inner_text().startswith("0/1 · sir")
    screen.key("ArrowRight")
    screen.key("ArrowRight")
    assert page.locator(current).inner_text().startswith("0/1 · rir")
    screen.key("ArrowLeft")
    assert page.locator(current).inner_text().startswith("0/0 · sir")
    screen.key("Enter")
    screen.until(lambda: at(screen) == ("sir", "0/0", 2) and preset(screen) == "inspect")
    screen.click("Gallery")
    screen.until(lambda: preset(screen) == "gallery")

    screen.key("/")
    page.keyboard.type("STUCK 0/1")
    until_true(page, "document.querySelectorAll('.entry:not([hidden])').length === 1")
    assert names(screen) == ["mug 0/1 rir"]
    screen.key("Escape")
    screen.key("x")
    page.get_by_label("Tag the selected").fill("handle hidden", timeout=SLOW_MS)
    screen.key("Enter")
    until_true(page, "document.querySelector('.entry:not([hidden]) .tags').textContent === 'handle hidden'")
    page.get_by_role("button", name="save", exact=True).click(timeout=SLOW_MS)
    page.get_by_label("Name of the filter").fill("mine", timeout=SLOW_MS)
    screen.key("Enter")
    page.get_by_label("Saved filters").locator("option", has_text="mine").wait_for(state="attached", timeout=SLOW_MS)
    page.get_by_label("Search").fill("", timeout=SLOW_MS)
    screen.key("Escape")
    assert len(names(screen)) == 5
    choose(screen, "Tag", "handle hidden")
    assert names(screen) == ["mug 0/1 rir"]
    choose(screen, "Tag", "any tag")
    choose(screen, "Saved filters", "mine")
    assert names(screen) == ["mug 0/1 rir"]
    assert page.get_by_label("Search").input_value() == "STUCK 0/1"
    assert "handle hidden" in (folder / "rir" / "tags.json").read_text()
    screen.shot("gallery_tagged")

    page.get_by_label("Search").fill("", timeout=SLOW_MS)
    screen.key("Escape")
    screen.key("Escape")  # The selection.
    tile(screen, 0).click(modifiers=["Control"], timeout=SLOW_MS)
    tile(screen, 2).click(modifiers=["Shift"], timeout=SLOW_MS)
    assert page.locator(".gallery-bar .chosen b").inner_text() == "3 selected"
    page.locator(".own-tags button", has_text="handle hidden").click(timeout=SLOW_MS)
    until_true(page, "!document.querySelector('.entry .tags span')")
    (folder / "sir" / "tags.json").unlink()
    (folder / "sir" / "tags.json").mkdir()
    page.get_by_label("Tag the selected").fill("x", timeout=SLOW_MS)
    screen.key("Enter")
    screen.text("cannot write .*tags.json: .* is a folder")


_BELOW_THE_WINDOW = """(() => {
    const entry = document.querySelectorAll('.entry:not([hidden])')[4];
    return !!entry && entry.getBoundingClientRect().bottom > innerHeight; })()"""
"""Of the fifth answer."""


def test_an_answer_opened_by_key_comes_into_sight_and_a_point_is_opened(
    shown: tuple[Screen, Gallery],
) -> None:
    screen, gallery = shown
    screen.page.get_by_label("Size of the tiles").fill("320", timeout=SLOW_MS)
    opened = [("sir", "0/1", 3), ("sir", "0/0", 2), ("rir", "0/1", 2), ("rir", "0/0", 2), ("rir", "0/1", 3)]
    until_true(screen.page, _BELOW_THE_WINDOW)  # Else this shows nothing.
    for place in opened:
        screen.key("j")
        screen.until(lambda place=place: at(screen) == place)
    screen.key("Escape")
    screen.until(lambda: preset(screen) == "gallery")
    assert is_seen(screen, screen.page.locator(".entry.open"), edge_px=8)
    screen.page.get_by_label("Size of the tiles").fill("200", timeout=SLOW_MS)

    screen.curve("Score/error")
    screen.text("^The score ranks a wrong answer above a right one in 0% of pairs")
    plot = screen.page.get_by_role("img", name="score over error")
    entry = next(e for e in gallery.entries if (e.run, e.row.frame, e.row.name) == ("rir", "0/1", "mug"))
    place = plot_of(gallery, {}).place(entry)
    assert place is not None
    plot.click(position={"x": place[0], "y": place[1]}, timeout=SLOW_MS)
    screen.until(lambda: at(screen) == ("rir", "0/1", 2))
    screen.shot("gallery_plot")
    plot.click(position={"x": 40, "y": 110}, timeout=SLOW_MS)
    screen.text("no object there; click nearer to a point")
    assert at(screen) == ("rir", "0/1", 2)

    screen.app.send(c.ArrangeGallery(only=(("run", "rir"), ("result", WRONG))))
    screen.until(lambda: names(screen) == ["mug 0/1 rir", "mug 0/0 rir", "can 0/1 rir"])
    assert screen.page.get_by_label("Run", exact=True).locator("option:checked").inner_text() == "rir"


def test_long_reasons_to_doubt_the_data_leave_room_for_the_answers_and_for_what_the_iteration_did(
    runs: Path, show: Show, tmp_path: Path
) -> None:
    why = ("cam_K", "depth_scale")
    indices = []
    for index in read_gallery(runs).runs.values():
        doubts = [f"{why[row.im_id]} does not fit, {'because it is off, ' * 20}as it seems." for row in index.rows]
        told = [f"{EVIDENCE} {'Astray it went. ' * 30}{DATA_FIRST} {doubt}" for doubt in doubts]
        rows = (replace(row, evidence=said) for row, said in zip(index.rows, told, strict=True))
        indices.append(replace(index, rows=tuple(rows)))
    gallery = Gallery(indices)
    screen = show(lambda port: App(gallery.session("sir"), port=port, folder=tmp_path, batch=gallery))
    box = screen.text("in 4 of 4 frames of 2 runs. In 2, such as 0/0 of rir, cam_K does not fit")
    assert box.evaluate("e => e.scrollWidth > 2 * e.clientWidth"), "else this shows nothing"
    assert is_seen(screen, tile(screen, 0), edge_px=8)
    screen.key("j")
    screen.until(lambda: preset(screen) == "inspect")
    assert is_seen(screen, screen.text(r"^Iteration \d+ · .*hypothesis "), edge_px=6)
    assert is_seen(screen, screen.text("^the data do not fit together"))
    evidence = screen.why(EVIDENCE)
    assert evidence.inner_text().count("Astray it went.") == 30
    assert "as it seems." in screen.why("^Look at the data first").inner_text()
