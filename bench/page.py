"""How long a click takes until its result is on the screen: ``python -m bench.page [SESSION]``; needs Chromium.

The page is served by a process of its own and looked at in headless Chromium at 1280×800, whose software WebGL takes
part of the same cores. Words, numbers, score maps and curves of an iteration arrive together; the clock runs, in the
page itself, from the click until they are drawn.
"""

from __future__ import annotations

import argparse
import re
import statistics
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

from playwright.sync_api import Page
from rich.console import Console

from bench.__main__ import table
from bench.browser import headless_chromium
from verefine_viz.recording.viewer_process import LOOPBACK, free_port

REPEATS = 12
SLOW_MS = 300_000
PAUSE_MS = 1500
"""Between two clicks: the animation of a step is over."""
CLICK = """
([button, words]) => new Promise(resolve => {
  const clicked = performance.now();
  const watch = new MutationObserver(() => {
    if (document.body.textContent.includes(words)) {
      watch.disconnect();
      requestAnimationFrame(() => requestAnimationFrame(() => resolve(performance.now() - clicked)));
    }
  });
  watch.observe(document.body, {subtree: true, childList: true, characterData: true});
  [...document.querySelectorAll("button")].find(b => b.textContent.trim() === button).click();
})
"""


def main(session: str | None) -> None:
    """Serves the session, built-in if none is given, and prints the table."""
    port = free_port()
    command = [sys.executable, "app.py", *([session] if session else []), "--port", str(port), "--no-open-browser"]
    root = Path(__file__).resolve().parents[1]
    server = subprocess.Popen(command, cwd=root, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    try:
        assert server.stdout is not None
        heard = next((line for line in server.stdout if str(port) in line), None)
        if heard is None:
            raise SystemExit("the page was not served")
        started = time.perf_counter()
        rows = _measured(f"http://{LOOPBACK}:{port}/")
        Console(highlight=False).print(table("page", rows, time.perf_counter() - started))
    finally:
        server.terminate()
        server.wait()


def _measured(address: str) -> list[dict[str, Any]]:
    with headless_chromium() as browser:
        page = browser.new_page(viewport={"width": 1280, "height": 800})
        page.goto(address)
        page.get_by_role("button", name="Step ▶").wait_for(timeout=SLOW_MS)
        page.get_by_text(re.compile("^Ready")).first.wait_for(timeout=SLOW_MS)
        # The first steps of a page are not timed: software WebGL compiles its shaders then.
        steps = [_click(page, "Step ▶", k) for k in range(1, REPEATS + 1)][2:]
        backs = [_click(page, "◀ Back", k) for k in range(REPEATS - 1, 1, -1)]
    return [_row("an iteration forward, made anew", steps), _row("an iteration back", backs)]


def _click(page: Page, button: str, k: int) -> float:
    page.wait_for_timeout(PAUSE_MS)
    return page.evaluate(CLICK, [button, f"Iteration {k} of "])


def _row(what: str, times: list[float]) -> dict[str, Any]:
    return {"what": what, "ms, median": statistics.median(times), "fastest": min(times), "slowest": max(times)}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("session", nargs="?")
    main(parser.parse_args().session)
