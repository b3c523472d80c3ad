"""The page under its Content-Security-Policy: all of it works, and nothing else runs."""

from __future__ import annotations

from typing import Any

from tests.browser.conftest import SESSIONS, SLOW_MS, Look, Screen

_WATCH = """
window.violations = [];
addEventListener("securitypolicyviolation", e => violations.push([e.effectiveDirective, e.blockedURI]));
"""


def test_the_page_needs_no_more_than_its_policy_allows_and_nothing_else_runs(look: Look) -> None:
    screen = look(SESSIONS / "mug.toml")
    with screen.page.context.browser.new_page(viewport={"width": 1280, "height": 800}) as page:
        page.add_init_script(_WATCH)
        other = Screen(screen.app, page)
        other.click("Run")
        other.finished()
        for tab in page.locator("[role=tab]:visible").all():
            tab.click(timeout=SLOW_MS)
            page.wait_for_timeout(200)
        drawn = page.evaluate("[...document.querySelectorAll('.vz.strip img')].every(i => i.naturalWidth > 0)")
        assert drawn
        # What sorts Gaussian splats, of which the page has none.
        assert [v for v in page.evaluate("violations") if v != ["script-src", "eval"]] == []
    with screen.page.context.browser.new_page() as page:
        page.goto("about:blank")
        page.evaluate(_FRAME, screen.app.url)
        frame: Any = page.frames[-1]
        assert frame.evaluate("document.querySelector('#root')") is None
        assert frame.url != f"{screen.app.url}/"
    screen.app.server.gui.add_html('<img src=x onerror="window.ran = 1"><b onclick="window.ran = 2">written</b>')
    screen.page.get_by_text("written").click(timeout=SLOW_MS)
    made = "const e = document.createElement('script'); e.textContent = 'window.ran = 3'; document.head.append(e)"
    screen.page.evaluate(made)
    assert screen.page.evaluate("window.ran") is None


_FRAME = """url => new Promise(resolve => {
  const frame = document.createElement("iframe");
  frame.src = url;
  frame.onload = resolve;
  document.body.append(frame);
})"""
