"""A window that is too small for the panels says so and what to do; the usual one does not."""

from __future__ import annotations

from tests.browser.conftest import SESSIONS, Look, Screen
from verefine_viz.viewer.web.viser_internals import SMALL_WINDOW


def test_a_zoomed_page_says_what_to_do_and_keeps_its_right_column_free(look: Look) -> None:
    screen = look(SESSIONS / "mug.toml")
    said = screen.page.get_by_text(SMALL_WINDOW)
    assert not said.is_visible()
    screen.page.set_viewport_size({"width": 1024, "height": 640})  # 1280 × 800 at 125 %
    said.wait_for()
    # The page places its windows anew in one of the next frames it draws.
    screen.until(lambda: column_is_free(screen))


def column_is_free(screen: Screen) -> bool:
    column = screen.page.locator("[data-dock-region=right]").first.bounding_box()
    boxes = [window.bounding_box() for window in screen.page.locator("[data-floating-window]:visible").all()]
    return column is not None and all(box is not None and box["x"] + box["width"] <= column["x"] + 1 for box in boxes)
