"""How long a click takes until its result is on the screen: ``python -m bench.page [SESSION]``; needs Chromium.

The page is served by a process of its own and looked at in headless Chromium at 1280×800, which draws by software on
the same cores. Words, numbers, score maps and curves of an iteration arrive together, its first picture in 3D after
them; the clock runs, in the page itself, from the click until they are drawn.
"""

from __future__ import annotations

import argparse
import statistics
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

from playwright.sync_api import Page
from rich.console import Console

from bench.__main__ import table
from tests.headless_chromium import headless_chromium
from verefine_viz.recording.rerun_viewer import LOOPBACK, free_port

REPEATS = 12
SLOW_MS = 300_000
CALM_MS, HURRIED_MS = 3000, 1200
"""Between two clicks: the animation of a step is over, or still goes on."""
WORDS = """
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
PICTURE = """
([button]) => new Promise(resolve => {
  const clicked = performance.now();
  const viewer = window.__viserMutable, request = viewer.requestRender;
  const gl = viewer.canvas.getContext("webgl2");
  const pictures = window.__viserTestpoints.rendererInfo.render;
  const nextPicture = before => {
    if (pictures.frame === before) return requestAnimationFrame(() => nextPicture(before));
    // Waits for what was asked to be drawn. A fence would be looked at only after the pictures that follow.
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
    resolve(performance.now() - clicked);
  };
  // What the server sends for the 3D view asks for a picture; the one that is drawn each second anyway does not.
  viewer.requestRender = () => {
    viewer.requestRender = request;
    request();
    nextPicture(pictures.frame);
  };
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
        # The first steps of a page are not timed: software WebGL compiles its shaders then.
        steps = [_click(page, WORDS, "Step ▶", k, CALM_MS) for k in range(1, REPEATS + 1)][2:]
        backs = [_click(page, WORDS, "◀ Back", k, CALM_MS) for k in range(REPEATS - 1, 0, -1)]
        page.get_by_role("button", name="Restart").first.click()
        pictures = [_click(page, PICTURE, "Step ▶", k, CALM_MS) for k in range(1, REPEATS + 1)]
        page.wait_for_timeout(CALM_MS)
        page.get_by_role("button", name="Restart").first.click()
        hurried = [_click(page, WORDS, "Step ▶", k, HURRIED_MS) for k in range(1, REPEATS + 1)][2:]
    return [
        _row("an iteration forward, made anew", steps),
        _row("… its first picture in 3D", pictures),
        _row("an iteration back", backs),
        _row("an iteration forward while the last still moves", hurried),
    ]


def _click(page: Page, until: str, button: str, k: int, pause_ms: int) -> float:
    """Time until iteration k is drawn, its words or its picture [ms]."""
    page.wait_for_timeout(pause_ms)
    return page.evaluate(until, [button, f"Iteration {k} of "])


def _row(what: str, times: list[float]) -> dict[str, Any]:
    return {"what": what, "ms, median": statistics.median(times), "fastest": min(times), "slowest": max(times)}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("session", nargs="?")
    main(parser.parse_args().session)
