"""How fast the page answers: ``python -m bench.page [SESSION] [--before CHECKOUT]``; needs Chromium.

The page is served by a process of its own and looked at in headless Chromium at 1280×800, which draws by software on
the same cores. With a checkout of the version before the two take turns, and the table has the ratio of their medians.
"""

from __future__ import annotations

import argparse
import statistics
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import psutil
from playwright.sync_api import Browser, Page
from rich.console import Console
from rich.table import Table

from tests.headless_chromium import headless_chromium
from verefine_viz.recording.rerun_viewer import LOOPBACK, free_port

ROUNDS, STEPS, CALM_MS, SLOW_MS = 3, 8, 700, 300_000
ROOT = Path(__file__).resolve().parents[1]
_PAGE = """async () => {
  const { state } = await import("/web/store.js");
  const { momentOf } = await import("/web/moment.js");
  const { sidesOf } = await import("/web/sides.js");
  window.bench = {
    k: () => state.view.k,
    mapped: () => {
      const s = sidesOf(momentOf(state));
      return Boolean(s.a?.arrays && !s.a.stale && (s.same || (s.b && !s.b.stale)));
    },
  };
}"""
# Draws as often as the page does; the clock stops in the second animation frame after a condition holds.
_UNTIL = """(clicked, holds) => new Promise((resolve) => {
  const done = () => resolve(performance.now() - clicked);
  const look = () => requestAnimationFrame(holds() ? () => requestAnimationFrame(done) : look);
  look();
})"""
_STEP = f"""async (k) => {{
  const until = {_UNTIL};
  const clicked = performance.now();
  [...document.querySelectorAll("button")].find((b) => b.textContent.trim() === "Step").click();
  const words = until(clicked, () => window.bench.k() === k);
  const maps = until(clicked, () => window.bench.k() === k && window.bench.mapped());
  return [await words, await maps];
}}"""
_USEFUL = """() => document.querySelectorAll(".maps canvas").length > 0 && window.bench?.mapped()"""
# Every animation frame takes the cursor to another iteration that is known; the 3D view, which draws by software, is
# taken away.
_SCRUB = """async (n) => {
  document.querySelector("iframe").remove();
  const { setView } = await import("/web/store.js");
  const began = performance.now();
  let frames = 0;
  await new Promise((resolve) => {
    const next = () => {
      setView({ k: 1 + (frames % n), stage: null });
      frames += 1;
      if (performance.now() - began < 3000) requestAnimationFrame(next);
      else resolve();
    };
    requestAnimationFrame(next);
  });
  return (1000 * frames) / (performance.now() - began);
}"""


@contextmanager
def served(checkout: Path, session: str) -> Iterator[tuple[str, subprocess.Popen[str], tuple[float, float]]]:
    """Serve a session by the version of a checkout; give its address, its process, and when both began [s]."""
    port = free_port()
    command = [sys.executable, "app.py", session, "--port", str(port), "--no-open-browser"]
    began = time.perf_counter()
    server = subprocess.Popen(command, cwd=checkout, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    try:
        assert server.stdout is not None
        if next((line for line in server.stdout if str(port) in line), None) is None:
            raise SystemExit("the page was not served")
        yield f"http://{LOOPBACK}:{port}/", server, (began, time.perf_counter())
    finally:
        server.terminate()
        server.wait()


def measured(browser: Browser, checkout: Path, session: str) -> dict[str, list[float]]:
    """Open the page, step through it and scrub it once."""
    times: dict[str, list[float]] = {}
    with served(checkout, session) as (address, server, began):
        page = browser.new_page(viewport={"width": 1280, "height": 800})
        page.goto(address)
        page.evaluate(_PAGE)
        _wait(page, _USEFUL)
        seen, (started, heard) = time.perf_counter(), began
        times["program to the first useful picture [ms]"] = [1e3 * (seen - started)]
        times["address to the first useful picture [ms]"] = [1e3 * (seen - heard)]
        for k in range(1, STEPS + 1):
            page.wait_for_timeout(CALM_MS)
            words, maps = page.evaluate(_STEP, k)
            if k > 2:  # The first steps are not timed: software WebGL compiles its shaders then.
                times.setdefault("step to words [ms]", []).append(words)
                times.setdefault("step to score maps [ms]", []).append(maps)
        page.wait_for_timeout(2000)
        times["scrubbing, 3D aside [pictures/s]"] = [page.evaluate(_SCRUB, STEPS)]
        times["memory of the server [MB]"] = [psutil.Process(server.pid).memory_info().rss / 1e6]
        page.close()
    return times


def _wait(page: Page, expression: str) -> None:
    for _ in range(SLOW_MS // 20):
        if page.evaluate(expression):
            return
        page.wait_for_timeout(20)
    raise SystemExit("the page showed no score maps")


def memory(session: str, n_verbs: int) -> list[float]:
    """Measure the server's memory [MB] after each tenth of many verbs."""
    import json

    from websockets.sync.client import connect

    with served(ROOT, session) as (address, server, _):
        process, sizes = psutil.Process(server.pid), []
        with connect(f"{address.replace('http', 'ws')}ws", max_size=None) as window:
            while (frame := json.loads(window.recv()))["t"] != "frame":
                pass
            first = next(one for one in frame["objects"] if one["arms"])
            obj, poses = first["id"], [arm["T"] for arm in first["arms"]]
            for k in range(n_verbs):
                T = poses[k % len(poses)]
                look = {"verb": "look", "branch": 0, "obj": obj, "draw": [[obj, T, "initial", 0.9]]}
                of = {"what": "physics", "branch": 0, "obj": obj, "stands": [[obj, T]], "poses": [["initial", T]]}
                want = {"verb": "want", "id": str(k), "of": of}
                for verb in (look, want, {"verb": "seek", "branch": 0, "k": 5}):
                    window.send(json.dumps(verb))
                while json.loads(window.recv())["t"] != "answer":
                    pass
                if (k + 1) % (n_verbs // 10) == 0:
                    sizes.append(process.memory_info().rss / 1e6)
        return sizes


def main() -> None:
    """Measure and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("session", nargs="?", default="sessions/mug.toml")
    parser.add_argument("--before", type=Path, help="a checkout of the version to compare with")
    parser.add_argument("--verbs", type=int, default=0, help="also: memory over so many verbs")
    given = parser.parse_args()
    session = str(Path(given.session).resolve())
    now: dict[str, list[float]] = {}
    before: dict[str, list[float]] = {}
    with headless_chromium() as browser:
        for _ in range(ROUNDS):
            _add(now, measured(browser, ROOT, session))
            if given.before is not None:
                _add(before, measured(browser, given.before, session))
    table = Table("what", "now", "range", "before", "range", "ratio", title=Path(session).stem)
    for what, times in now.items():
        table.add_row(what, *_cells(times), *_cells(before.get(what)), _ratio(times, before.get(what)))
    Console(width=130, highlight=False).print(table)
    if given.verbs:
        print("memory [MB]:", *(f"{size:.0f}" for size in memory(session, given.verbs)))


def _add(all_times: dict[str, list[float]], times: dict[str, list[float]]) -> None:
    for what, some in times.items():
        all_times.setdefault(what, []).extend(some)


def _cells(times: list[float] | None) -> tuple[str, str]:
    if not times:
        return "", ""
    return f"{statistics.median(times):.0f}", f"{min(times):.0f} to {max(times):.0f}"


def _ratio(times: list[float], others: list[float] | None) -> str:
    return f"{statistics.median(times) / statistics.median(others):.2f}" if others else ""


if __name__ == "__main__":
    main()
