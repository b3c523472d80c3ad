"""The report in a browser without a network."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from tests.report.pages import GONE
from tests.report.runs import row, write_run
from tests.report.test_group_page import sweep
from verefine_viz.batch.index import find_runs
from verefine_viz.report.build_report import write_group_report, write_report


def test_a_comparison_of_groups_opens_offline_sorts_and_filters(chromium: Any, tmp_path: Path) -> None:
    path = tmp_path / "report.html"
    folder = sweep(tmp_path / "runs", ("rir", "sir", "pir", "refine", "even"), 2, 6, 2)
    write_group_report(find_runs(folder).runs, path)
    context = chromium.new_context(viewport={"width": 1280, "height": 800}, offline=True)
    page, errors, foreign = context.new_page(), [], []
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.on("request", lambda r: None if r.url.startswith(("file:", "data:", "blob:")) else foreign.append(r.url))
    page.goto(path.as_uri())
    page.wait_for_selector("html[data-ready=yes]", timeout=120_000)
    assert page.evaluate("document.documentElement.scrollWidth") <= 1280
    assert page.evaluate("[...document.querySelectorAll('.entry')].every((f) => f.scrollWidth <= f.clientWidth)")

    recalls = page.locator("table[aria-label=groups] tbody tr td:nth-child(3)")
    page.locator("table[aria-label=groups] th", has_text="right").click()
    page.locator("table[aria-label=groups] th", has_text="right").click()
    rising = [float(text.split()[0]) for text in recalls.all_inner_texts()]
    assert rising == sorted(rising)

    page.get_by_label("Group", exact=True).select_option("refine")
    chips = [f.locator(".chip").first.inner_text() for f in page.locator(".entry").all() if f.is_visible()]
    assert set(chips) == {"refine"}
    context.close()
    assert errors == []
    assert foreign == []


def test_the_report_opens_offline_sorts_and_filters(chromium: Any, tmp_path: Path) -> None:
    a = [row(1, 0), row(2, 0, add_s_mm=40.0, cause="pool"), row(3, 1, add_s_mm=20.0, cause="score"), row(4, 2)]
    b = [row(1, 0), row(2, 0), row(3, 1, add_s_mm=60.0), row(4, 2)]
    path = tmp_path / "report.html"
    write_report(write_run(tmp_path / "a", a, GONE), write_run(tmp_path / "b", b, GONE), path)
    context = chromium.new_context(viewport={"width": 1280, "height": 800}, offline=True)
    page, errors, foreign = context.new_page(), [], []
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.on("console", lambda said: errors.append(said.text) if said.type == "error" else None)
    page.on("request", lambda r: None if r.url.startswith(("file:", "data:", "blob:")) else foreign.append(r.url))
    page.goto(path.as_uri())
    page.wait_for_selector("html[data-ready=yes]", timeout=60_000)
    assert page.locator(".chart .main-svg").count() >= 2 * page.locator(".chart").count()
    assert page.evaluate("document.documentElement.scrollWidth") <= 1280

    names = page.locator("table[aria-label=objects] tbody tr td:nth-child(2)")
    page.locator("table[aria-label=objects] th", has_text="object").click()
    falling = names.all_inner_texts()
    page.locator("table[aria-label=objects] th", has_text="object").click()
    assert sorted([falling, names.all_inner_texts()]) == [sorted(falling), sorted(falling, reverse=True)]

    assert [h.inner_text() for h in page.locator(".entry h3").all()] == ["object 2", "object 1"]
    page.get_by_label("Cause", exact=True).select_option("score ranks a wrong pose above the ground truth")
    assert [h.inner_text() for h in page.locator(".entry h3").all() if h.is_visible()] == ["object 2"]
    page.get_by_label("Cause", exact=True).select_option("")
    page.keyboard.press("/")
    page.keyboard.type("1/3")
    assert [h.inner_text() for h in page.locator(".entry h3").all() if h.is_visible()] == ["object 2"]
    page.get_by_label("Search").fill("nothing has this")
    assert page.locator(".none-shown").is_visible()
    page.get_by_label("Search").fill("1/3")
    # A link to a card that the filter hides brings it back.
    page.locator("table[aria-label='got better'] a").click()
    assert [h.inner_text() for h in page.locator(".entry h3").all() if h.is_visible()] == ["object 2", "object 1"]
    assert page.locator(".entry:target h3").inner_text() == "object 1"

    before = page.evaluate("getComputedStyle(document.body).backgroundColor")
    page.locator("#theme").click()
    assert page.evaluate("getComputedStyle(document.body).backgroundColor") != before
    context.close()
    assert errors == []
    assert foreign == []
