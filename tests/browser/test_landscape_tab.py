"""The score around the answer in the browser: it comes by itself at the end, and a click on it edits the pose."""

from __future__ import annotations

from tests.browser.conftest import SESSIONS, SLOW_MS, Look
from verefine_viz.viewer import commands as c


def test_the_landscape_comes_at_the_end_and_a_click_edits_the_pose(look: Look) -> None:
    screen = look(SESSIONS / "failure_score_prefers_wrong.toml")
    screen.app.send(c.RunUntil("end"))
    screen.app.wait_until_idle(240)
    screen.tab("Landscape")
    screen.text("^Answer of .*: turn about the vertical undetermined within ±5[0-9]°")
    turn = screen.page.locator('.vz svg[aria-label="turn about the vertical"]')
    turn.wait_for(timeout=SLOW_MS)
    screen.shot("landscape")

    box = turn.bounding_box()
    turn.click(position={"x": box["width"] * 0.3, "y": box["height"] / 2}, timeout=SLOW_MS)
    screen.until(lambda: screen.app.debugger.options.edited is not None)
    before = screen.app.debugger.options.edited
    screen.page.locator('.vz svg[aria-label="score over two axes"]').click(timeout=SLOW_MS)
    screen.until(lambda: screen.app.debugger.options.edited != before)
    screen.app.wait_until_idle(60)
    tab = screen.page.locator("[data-dock-region=right]").get_by_role("tab", name="Landscape", exact=True)
    assert tab.get_attribute("aria-selected") == "true", "numbers of pixels are in another tab, these are none"
    screen.shot("landscape_edited")
