"""The report as a file, opened from the disk without a network."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.browser.conftest import SESSIONS, Pages, Screen
from tests.made_runs import because
from tests.report.pages import GONE
from tests.report.runs import row, write_run
from tests.report.sections import NO_ANSWER, WRONG
from tests.report.test_written import made, sweep
from verefine_viz.batch.index import read_batch
from verefine_viz.cli import main


def cards(screen: Screen) -> list[str]:
    """The names on the cards that are shown, in their order."""
    screen.page.wait_for_timeout(200)
    return screen.page.locator(".card .line b").all_inner_texts()


def column(screen: Screen, table: str, title: str) -> list[str]:
    """What a column of a table shows, without its intervals."""
    head = screen.page.locator(f"[data-table='{table}'] th")
    at = [text.rstrip(" ↑↓") for text in head.all_inner_texts()].index(title)
    cells = screen.page.locator(f"[data-table='{table}'] tbody tr td:nth-child({at + 1})")
    return [text.split("\n")[0] for text in cells.all_inner_texts()]


def fits(screen: Screen) -> bool:
    return screen.page.evaluate("document.querySelector('.report-all').scrollWidth <= innerWidth")


@pytest.fixture(scope="module")
def scenes(tmp_path_factory: pytest.TempPathFactory, chromium) -> Path:
    """The report of a scene that fails, and of one that does not."""
    folder = tmp_path_factory.mktemp("batch") / "runs"
    sessions = [str(SESSIONS / f"{name}.toml") for name in ("failure_icp_slides", "mug")]
    assert main(["batch", *sessions, "--out", str(folder), "--workers", "1", "--recording.keep", "none"]) in (0, 1)
    return made(folder)


def test_a_failure_opens_at_its_iteration_and_leads_back(pages: Pages, scenes: Path):
    screen = pages.open_file(scenes)
    screen.text("2 runs on 2 sets of data").wait_for()
    assert screen.page.locator(".data > .name").all_inner_texts() == [
        "the built-in scene failure_icp_slides What went wrong? "
        + read_batch(scenes.parent / "failure_icp_slides").session.title.removeprefix("What went wrong? "),
        f"the built-in scene mug {read_batch(scenes.parent / 'mug').session.title}",
    ]
    assert fits(screen)
    screen.shot("report_scenes")
    # Good answers have pictures too.
    screen.page.locator(".card img").first.wait_for()
    screen.page.get_by_role("button", name="All", exact=True).click()
    screen.until("document.querySelectorAll('.card img').length === 2")
    screen.page.locator(".card img").last.scroll_into_view_if_needed()
    screen.until("[...document.querySelectorAll('.card img')].every((i) => i.naturalWidth === 320)")

    wrong = next(r for r in screen.state("state.answers.rows") if r["tone"] == "wrong")
    screen.page.locator(".report .next .link").click()
    screen.until("state.view.preset === 'inspect' && state.view.k === arg && moment", wrong["k"])
    assert screen.state("state.frame.title") == read_batch(scenes.parent / "failure_icp_slides").session.title
    screen.until("document.querySelector('.maps canvas') && document.querySelector('.verdict .wrong')")
    assert screen.page.locator(".failures").inner_text().strip() == "1 / 1"
    screen.key("ArrowLeft")
    screen.until("moment.k === arg", max(wrong["k"] - 1, 0))
    screen.shot("report_failure")
    screen.key("r")
    screen.text("2 runs on 2 sets of data").wait_for()
    # What is not in the file opens by a command.
    screen.page.locator(".card.right").click()
    screen.text("verefine-viz view mug/runs/000000_000000.vfrun").wait_for()
    assert screen.state("state.view.preset") == "report"
    assert screen.errors == []
    assert screen.foreign == []


def test_a_failure_beside_the_report_is_a_file_of_its_own(pages: Pages, scenes: Path, tmp_path: Path):
    path = tmp_path / "r.html"
    assert main(["report", str(scenes.parent), "--embed", "0", "--beside", "1", "--out", str(path)]) == 0
    screen = pages.open_file(path)
    wrong = next(r for r in screen.state("state.answers.rows") if r["tone"] == "wrong")
    assert [r["file"] for r in screen.state("state.answers.rows")].count(None) == 1
    screen.page.locator(".report .next .link").click()
    screen.page.wait_for_url("**/r-frames/*.html*")
    screen.until("state.frame && moment && state.view.k === arg", wrong["k"])
    assert screen.state("moment.obj") == wrong["obj"]
    screen.until("document.querySelector('.maps canvas')")
    assert screen.errors == []


def test_a_sweep_sorts_filters_and_searches(pages: Pages, tmp_path: Path):
    screen = pages.open_file(made(sweep(tmp_path / "runs", ("rir", "sir", "pir", "refine"), 2, 6, 2)))
    screen.text("rir gets").wait_for()
    assert fits(screen)
    screen.shot("report_sweep")
    recalls = [float(text) for text in column(screen, "groups", "right [%]")]
    assert recalls == sorted(recalls, reverse=True)
    screen.page.locator("[data-table=groups] th", has_text="group").first.click()
    screen.page.locator("[data-table=groups] .sort", has_text="group").click()
    names = column(screen, "groups", "group")
    assert sorted(names) in (names, names[::-1])
    screen.page.locator("[data-table=groups] .sort", has_text="right").first.click()
    screen.page.locator("[data-table=groups] .sort", has_text="right").first.click()
    assert [float(text) for text in column(screen, "groups", "right [%]")] == sorted(recalls)

    # A cause of a group shows its answers.
    wrong = [r for r in screen.state("state.answers.rows") if r["cause"]]
    assert len(cards(screen)) > 0
    screen.page.locator(".bars .stack i.clickable").first.click()
    only = screen.state("state.gallery.only")
    assert only["cause"] == ["no good hypothesis in the pool"]
    first = screen.state("state.report.sections[0].groups[0]")
    shown = [r for r in wrong if r["run"] in first["runs"]]
    screen.text(f"{len(shown)} of 96 shown").wait_for()
    screen.page.get_by_label("search").or_(screen.page.locator(".search input")).first.fill("nothing has this")
    screen.text("No answer passes the filters.").wait_for()
    screen.page.get_by_role("button", name="Show all").click()
    screen.text("96 of 96 shown").wait_for()
    # Keys of the gallery are those of the report only while the pointer is over it.
    screen.page.locator(".cards").hover()
    screen.key("ArrowRight")
    assert screen.state("state.gallery.at") is not None

    # The curve says what is below the limit under the pointer.
    drawing = screen.page.locator(".drawing svg").first
    drawing.scroll_into_view_if_needed()
    box = drawing.bounding_box()
    screen.page.mouse.move(box["x"] + 0.4 * box["width"], box["y"] + 20)
    screen.text("below 20.0 %:").wait_for()
    before = screen.page.evaluate("getComputedStyle(document.body).backgroundColor")
    screen.key("d")
    screen.page.wait_for_timeout(100)
    assert screen.page.evaluate("getComputedStyle(document.body).backgroundColor") != before
    assert screen.errors == []


def test_two_runs_lead_to_what_changed(pages: Pages, tmp_path: Path):
    a = [
        row(1, 0),
        row(2, 0, add_s_mm=40.0, findings=because("pool")),
        row(3, 1, add_s_mm=20.0, findings=because("score")),
        row(4, 2),
    ]
    b = [row(1, 0), row(2, 0), row(3, 1, add_s_mm=60.0), row(4, 2, **NO_ANSWER)]
    path = made(write_run(tmp_path / "a", a, GONE), write_run(tmp_path / "b", b, GONE))
    screen = pages.open_file(path)
    assert fits(screen)
    screen.shot("report_pair")
    assert column(screen, "Got better", "object") == ["object 1"]
    assert column(screen, "Got worse", "object") == ["object 3", "object 2"]
    assert column(screen, "Got worse", "B [%]") == ["none", "60.0"]
    assert screen.page.locator(".drawing .point").count() == 3
    screen.page.locator("button.link", has_text="only B: b wrong").click()
    assert cards(screen) == ["object 3", "object 3"]
    screen.page.locator("[data-table='Got worse'] .link", has_text="1/3").click()
    screen.text("verefine-viz view b/runs/000001_000003.vfrun").wait_for()
    assert screen.errors == []


def test_names_of_data_are_text(pages: Pages, tmp_path: Path):
    evil = "</script><img src=x onerror=\"document.title='broken'\">"
    rows = [row(1, name=evil, findings=because("odd", evil), message=evil, **WRONG), row(2, name=evil)]
    screen = pages.open_file(made(write_run(tmp_path / "a", rows, GONE | {"title": evil})))
    screen.text(evil).wait_for()
    assert screen.page.locator("img[src=x]").count() == 0
    assert "broken" not in screen.page.title()
    assert screen.errors == []
