"""Page, share file, gallery and report on a phone, a laptop and a large screen; what the gallery shows."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import pytest

from tests.browser.conftest import SESSIONS, Pages, Screen
from tests.made_runs import because
from tests.report.pages import GONE
from tests.report.runs import row, write_run
from tests.report.test_written import made, sweep
from verefine_viz.page.share import share
from verefine_viz.run.record import Answer

SIZES = [(390, 844), (1440, 900), (2560, 1440)]
PHONE = 390
WIDE = """() => [document.documentElement,
    ...document.querySelectorAll(".page, .page > *, .report-all, .block, .gallery-bar, .cards")]
    .filter((e) => e.checkVisibility({ visibilityProperty: true }) && !e.matches(".toasts, .splitter"))
    .filter((e) => (e.clientWidth && e.scrollWidth > e.clientWidth + 1)
        || e.getBoundingClientRect().right > innerWidth + 1)
    .map((e) => `${e.className || e.tagName} ${e.scrollWidth} in ${e.clientWidth}`)"""
"""What is wider than its place."""
CUT_TABLES = """() => [...document.querySelectorAll("[data-table]")].filter((e) => e.scrollWidth > e.clientWidth + 1)
    .map((e) => e.dataset.table)"""
PARTS = """() => [...document.querySelectorAll(".page > :is(.pane, .timeline, .inspector)")]
    .filter((e) => e.checkVisibility({ visibilityProperty: true })).map((e) => e.getBoundingClientRect())
    .map((r) => [r.width, r.top, r.bottom])"""
PICTURES = """() => [...document.querySelectorAll(".pane.image, .pane.maps")].map((e) => e.getBoundingClientRect())
    .reduce((area, r) => area + r.width * r.height, 0) / (innerWidth * innerHeight)"""
NUMBER = {"error": ".error", "score": ".line:nth-child(3) span:last-child"}
NUMBER |= {"time": NUMBER["score"], "undetermined": NUMBER["score"]}
"""The number of a card by which an order sorts."""


def answers() -> list[Answer]:
    """Fifty of one run; of those that are wrong, every other is right as far as the image shows."""
    rows = []
    for k in range(50):
        error = 1.5 * (k * 7 % 50)
        more = {"undetermined_mm": 1.0, "undetermined_deg": float(k * 11 % 50), "ms_total": 1000.0 * (k * 13 % 50)}
        if error < 10:
            seen = {"error_seen_mm": error, "right_seen": True}
        else:
            seen = {"error_seen_mm": 3.0 if k % 2 else error, "right_seen": bool(k % 2), "findings": because("pool")}
        rows.append(row(k // 5, k % 5, add_s_mm=error, score=1 - error / 100, **more, **seen))
    return rows


def fits_everywhere(screen: Screen, name: str) -> None:
    for width, height in SIZES:
        screen.page.set_viewport_size({"width": width, "height": height})
        screen.page.wait_for_timeout(400)
        for _ in range(20):  # Canvases follow the window, on a loaded machine after seconds.
            if screen.page.evaluate(WIDE) == []:
                break
            screen.page.wait_for_timeout(250)
        assert screen.page.evaluate(WIDE) == [], width
        if width > PHONE:
            assert screen.page.evaluate(CUT_TABLES) == [], width
        else:
            parts = screen.page.evaluate(PARTS)
            assert all(wide > 0.95 * width for wide, _, _ in parts)
            tops = sorted((top, bottom) for _, top, bottom in parts)
            assert all(bottom <= top + 1 for (_, bottom), (top, _) in pairwise(tops))
        screen.shot(f"{name}_{width}")


def test_the_page_is_one_column_on_a_phone_and_pictures_use_a_large_screen(show):
    screen = show("clutter")
    screen.until("document.querySelector('.maps canvas')")
    fits_everywhere(screen, "page")
    assert screen.page.evaluate(PICTURES) > 0.39


def test_a_share_file_fits(pages: Pages, tmp_path: Path):
    share(SESSIONS / "mug.toml", tmp_path / "mug.html")
    screen = pages.open_file(tmp_path / "mug.html")
    screen.until("moment.isAnswer && document.querySelector('.maps canvas')")
    fits_everywhere(screen, "share")
    assert screen.errors == []


@pytest.mark.parametrize("kind", ["one", "two", "sweep"])
def test_a_report_and_its_gallery_fit(pages: Pages, tmp_path: Path, kind: str):
    one = lambda name: write_run(tmp_path / name, answers(), GONE)  # noqa: E731
    made_of = {"one": lambda: [one("a")], "two": lambda: [one("a"), one("b")]}
    made_of["sweep"] = lambda: [sweep(tmp_path / "runs", ("rir", "sir", "pir", "refine"), 2, 6, 2)]
    screen = pages.open_file(made(*made_of[kind]()))
    fits_everywhere(screen, f"report_{kind}")
    screen.click("Gallery")
    screen.until("state.view.preset === 'gallery'")
    fits_everywhere(screen, f"gallery_{kind}")
    assert screen.errors == []


def test_cards_show_the_number_that_sorts_them_and_those_ahead_are_there(pages: Pages, tmp_path: Path):
    screen = pages.open_file(made(write_run(tmp_path / "a", answers(), GONE)))
    screen.click("Gallery")
    screen.click("All")
    for order, place in NUMBER.items():
        screen.state("(await import('web/answers.js')).choose({ order: arg })", order)
        screen.page.wait_for_timeout(200)
        shown = screen.page.locator(f".card {place}").all_inner_texts()
        numbers = [float(text.removeprefix("±").strip().split()[0].rstrip("°")) for text in shown]
        assert len(numbers) > 10
        assert numbers == sorted(numbers, reverse=order != "score"), order
    in_sight = """[...document.querySelectorAll('.card')].filter((c) =>
        c.getBoundingClientRect().top < document.querySelector('.cards').getBoundingClientRect().bottom).length"""
    assert screen.page.locator(".card").count() > 1.5 * screen.page.evaluate(in_sight)
    rows = screen.state("state.answers.rows")
    n_seen = [r["tone"] for r in rows].count("seen")
    assert n_seen > 0
    screen.page.locator(".facet", has_text="right as far as the image shows").click()
    screen.until("document.querySelectorAll('.card').length && !document.querySelector('.card:not(.seen)')")
    screen.text(f"{n_seen} of 50 shown").wait_for()
    assert f"{sum(r['tone'] in ('right', 'seen') for r in rows)} as far as the image shows" in screen.state(
        "state.report.sections[0].headline"
    )


def test_a_batch_is_opened_where_none_was(show, tmp_path: Path):
    screen = show()
    only = row(0, screen.state("state.frame.objects[0].id"), scene_id=0, add_s_mm=40.0)
    folder = write_run(tmp_path / "a b", [only], {"scene": {"demo": "mug"}})
    screen.key("?")
    screen.until("document.querySelector('.keys')")
    assert "R" not in screen.page.locator(".keys kbd").all_inner_texts()
    screen.key("Escape")
    screen.key("g")
    screen.page.get_by_placeholder("its folder").fill(str(folder))
    screen.page.keyboard.press("Enter")
    screen.until("state.answers?.rows.length === 1")
    assert screen.state("state.frame.run") == "a b"
    if screen.state("state.view.preset") != "gallery":
        screen.key("g")
    screen.until("document.querySelector('.card img')?.naturalWidth === 320")
    assert screen.errors == []
