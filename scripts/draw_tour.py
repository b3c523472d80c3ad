"""The pictures of README, docs/guide.md and docs/causes.md: the page itself, in a headless Chromium (make tour)."""

from __future__ import annotations

import io
import re
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from msgspec import structs
from PIL import Image

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from scripts.cause_scenes import SCENES, commands, session_of  # noqa: E402
from tests.browser.conftest import SESSIONS, Screen  # noqa: E402
from tests.headless_chromium import headless_chromium  # noqa: E402
from verefine_viz import cli  # noqa: E402
from verefine_viz.core.algorithm_settings import BreakpointSettings  # noqa: E402
from verefine_viz.core.causes import CAUSES, Cause  # noqa: E402
from verefine_viz.page.app import App  # noqa: E402
from verefine_viz.page.openable import read_openable  # noqa: E402

DOCS = ROOT / "docs"
SIZE = {"width": 1280, "height": 760}
WIDTH_PX = 960
"""Width of the pictures of README and docs/guide.md."""
STILL_MS, LAST_MS = 1100, 4000
IMAGE = ".pane.image .stage"
PANES = {Cause.SIMULATION: ".pane.scene", Cause.PLANE: ".pane.scene", Cause.ARM_STARVED: ".timeline"}
"""Where the page shows a cause, if not in the image."""
SHOWN_BY = {
    cause: known.command.removeprefix("view ")
    for cause, known in CAUSES.items()
    if re.fullmatch(r"view \w+", known.command)
}
"""The built-in session that shows a cause."""


@contextmanager
def window_of(browser: Any, app: App, **size: int) -> Iterator[Screen]:
    """Open a window of the page, whose server is stopped at the end."""
    app.start()
    try:
        app.wait_until_ready(300)
        page = browser.new_page(viewport=SIZE | size, color_scheme="dark")
        yield Screen(page, app.url, app)
        page.close()
    finally:
        app.stop()


@contextmanager
def shown(browser: Any, path: Path, **size: int) -> Iterator[Screen]:
    """Open what lies at a path in a window of the page."""
    there = read_openable(path)
    session = structs.replace(there.session, breakpoints=BreakpointSettings())
    with window_of(browser, App(session, there.session_path, port=0, gallery=there.gallery), **size) as screen:
        yield screen


def picture(screen: Screen, where: str = "") -> Image.Image:
    """Return what is on the screen, once 3D and maps are drawn; of a part, where one is named."""
    screen.page.wait_for_timeout(2500)
    what = screen.page.locator(where).first if where else screen.page
    return Image.open(io.BytesIO(what.screenshot())).convert("RGB")


def save(image: Image.Image, path: Path, width_px: int = WIDTH_PX) -> None:
    """Write a picture with a palette of its own, no wider than that."""
    path.parent.mkdir(exist_ok=True)
    if image.width > width_px:
        image = image.resize((width_px, round(image.height * width_px / image.width)), Image.Resampling.LANCZOS)
    image.quantize(192, dither=Image.Dither.NONE).save(path, optimize=True)


def strip(browser: Any) -> None:
    """A run in pictures, as ``verefine-viz film`` writes it."""
    if cli.main(["film", str(SESSIONS / "failure_simulation_topples.toml"), "--out", str(DOCS / "tour" / "film.png")]):
        raise SystemExit("no film")


def film(browser: Any) -> None:
    """Step, run, verdict: the mug, whose fourth hypothesis wins."""
    with shown(browser, SESSIONS / "mug.toml") as screen:
        stills = [picture(screen)]
        for k in (1, 2, 3):
            screen.click("Step")
            screen.until("state.view.k === arg", k)
            stills.append(picture(screen))
        screen.finish()
        end = picture(screen)
        best = (
            screen.state("moment.run.rows.findIndex((row) => row.best.k === row.k && row.best.score > 0.9) + 1") or 16
        )
        for k in (best - 1, best):
            screen.view(k=k, stage=None)
            screen.until("state.view.k === arg", k)
            stills.append(picture(screen))
        stills.append(end)
    small = [
        still.resize((WIDTH_PX, round(still.height * WIDTH_PX / still.width)), Image.Resampling.LANCZOS)
        for still in stills
    ]
    frames = [still.quantize(160, dither=Image.Dither.NONE) for still in small]
    times = [STILL_MS] * (len(frames) - 1) + [LAST_MS]
    frames[0].save(
        DOCS / "tour" / "tour.gif", save_all=True, append_images=frames[1:], duration=times, loop=0, optimize=True
    )


def tour(browser: Any) -> None:
    """The three pictures of docs/guide.md."""
    with shown(browser, SESSIONS / "failure_score_prefers_wrong.toml") as screen:
        screen.finish()
        save(picture(screen), DOCS / "tour" / "verdict.png")
        screen.click("Maps")
        save(picture(screen), DOCS / "tour" / "maps.png")
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "runs"
        sessions = [str(SESSIONS / f"{name}.toml") for name in (*SHOWN_BY.values(), "clutter")]
        if cli.main(["batch", *sessions, "--out", str(out), "--workers", "2"]):
            raise SystemExit("the batch failed")
        with shown(browser, out) as screen:
            screen.click("Gallery")
            screen.page.wait_for_timeout(20_000)  # Thumbnails are drawn one after the other.
            save(picture(screen), DOCS / "tour" / "gallery.png")


def causes(browser: Any) -> None:
    """A picture of each cause that a built-in session shows."""
    for cause, session in SHOWN_BY.items():
        where = PANES.get(cause, IMAGE)
        with shown(browser, SESSIONS / f"{session}.toml", width=1440, height=860) as screen:
            screen.finish()
            screen.app.wait_until_idle(60)
            save(picture(screen, where), DOCS / "causes" / f"{cause}.png", 720 if where == ".timeline" else 480)


def spoilt(browser: Any) -> None:
    """A picture of each cause that takes options, or a frame of its own."""
    for cause in map(Cause, (*SCENES, *commands())):
        with tempfile.TemporaryDirectory() as folder:
            session = session_of(cause, Path(folder))
            with window_of(browser, App(session, port=0, folder=Path(folder)), width=1440, height=860) as screen:
                if cause != Cause.NO_HYPOTHESIS:  # There nothing is run.
                    screen.finish()
                # Of several objects the last one is meant: it was placed after the one that is to blame.
                screen.view(obj=screen.state("Math.max(...state.frame.objects.map((o) => o.id))"))
                if cause == Cause.DEPTH:
                    screen.click("Depth")
                save(picture(screen, IMAGE), DOCS / "causes" / f"{cause}.png", 480)


if __name__ == "__main__":
    (DOCS / "tour").mkdir(exist_ok=True)
    with headless_chromium() as chromium:
        for each in (strip, film, tour, causes, spoilt):
            if len(sys.argv) == 1 or each.__name__ in sys.argv[1:]:
                each(chromium)
