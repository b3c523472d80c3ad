"""A tree search on the page: its answer at the end, its last iteration when asked for, and a tree that can be read."""

from __future__ import annotations

import re
from pathlib import Path

from tests.browser.conftest import SESSIONS, SLOW_MS, Look, is_seen, saved
from verefine_viz.viewer import commands as c


def test_the_answer_of_a_search_and_its_tree(look: Look, tmp_path: Path) -> None:
    search = {"method": {"name": "physim_mcts"}, "mcts": {"expansions": 20}}
    screen = look(saved(tmp_path, scene={"demo": "stack"}, hypotheses={"max_per_object": 4}, **search))
    screen.app.send(c.RunUntil("end"))
    screen.app.wait_until_idle(240)
    n = screen.app.debugger.workspace.run.length
    screen.text("^Answer$")
    assert screen.page.locator(".vz.objects td", has_text="working").count() == 0
    assert screen.page.locator(".vz.objects tr td:last-child .sw").count() == 3, "the hypothesis that won, each"
    screen.tab("Bandit")
    folds = screen.page.locator(".vz svg g[data-cmd]", has_text="+")
    folds.first.wait_for(timeout=SLOW_MS)
    boxes = screen.page.locator(".vz svg g[data-cmd] rect[height='26']").all()
    assert min(b.bounding_box()["width"] for b in boxes) > 20
    screen.shot("search_answer")

    screen.page.locator("[data-dock-region=right] .vz a", has_text=f"iteration {n}").last.click(timeout=SLOW_MS)
    screen.text("^Last iteration · ")
    screen.page.locator(".vz.objects td b", has_text="working").wait_for(timeout=SLOW_MS)
    screen.shot("search_last_iteration")
    screen.page.locator(".vz a", has_text=re.compile("^answer$")).click(timeout=SLOW_MS)
    screen.text("^Answer$")

    folds.last.click(timeout=SLOW_MS)
    screen.until(lambda: 0 < screen.app.debugger.workspace.run.cursor < n)


def test_tables_and_settings_fit_on_a_small_screen(look: Look) -> None:
    screen = look(SESSIONS / "mug.toml")
    screen.app.send(c.RunUntil("end"))
    screen.app.send(c.CompareRun((("method.name", "sir"),)))
    screen.app.wait_until_idle(240)
    screen.tab("A/B")
    assert is_seen(screen, screen.page.locator(".vz p", has_text="computing time"))
    screen.app.send(c.StopComparing())
    screen.app.send(c.ProbePixel(330, 250))
    screen.app.wait_until_idle(60)
    screen.page.get_by_role("tab", name="Score", exact=True).first.click(timeout=SLOW_MS)
    assert is_seen(screen, screen.page.locator(".vz tr", has_text="adds"))
    assert is_seen(screen, screen.page.locator(".vz tr", has_text="normal f_n"))
    screen.tab("Settings")
    assert is_seen(screen, screen.page.get_by_label("Seed", exact=True))
    assert is_seen(screen, screen.page.get_by_role("button", name="Fork here", exact=True))
    screen.tab("Breakpoints")
    assert is_seen(screen, screen.page.get_by_label("error +2 mm", exact=True))
    # Panels follow a window that gets wider.
    for width, height in ((1600, 1000), (1280, 800), (1440, 900)):
        screen.page.set_viewport_size({"width": width, "height": height})
        physics = screen.page.get_by_role("tab", name="Physics", exact=True)
        screen.until(lambda physics=physics, width=width: width - 376 < physics.bounding_box()["x"] < width)
        for name in ("Step ▶", "◀ Back"):
            assert is_seen(screen, screen.page.get_by_role("button", name=name, exact=True))
    screen.shot("wider")


def test_tables_and_settings_of_several_objects_fit_on_a_small_screen(look: Look, tmp_path: Path) -> None:
    method = {"name": "vf_depth", "iterations": 1}
    screen = look(saved(tmp_path, scene={"demo": "clutter"}, hypotheses={"max_per_object": 2}, method=method))
    screen.app.send(c.RunUntil("end"))
    screen.app.send(c.CompareRun((("method.name", "rir"),)))
    screen.app.send(c.ShowLayout("compare"))
    screen.app.wait_until_idle(240)
    assert is_seen(screen, screen.page.locator(".vz p", has_text="computing time"))
    screen.shot("several_compared")
    screen.app.send(c.ShowLayout("inspect"))
    column = screen.page.locator("[data-dock-region=right]")
    # The layout opens its tab on the page, a moment after it is chosen.
    column.get_by_role("tab", name="Score", exact=True, selected=True).wait_for(timeout=SLOW_MS)
    screen.tab("Settings")
    for label in ("Order by", "Seed", "Estimator"):
        assert is_seen(screen, screen.page.get_by_label(label, exact=True))
    assert is_seen(screen, screen.page.get_by_role("button", name=re.compile("^Estimate .* here$")))
    screen.shot("several_settings")
