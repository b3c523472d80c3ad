"""Exports arrive in the browser's download folder as they are on disk, and the 3D scene says what it shows offline."""

from __future__ import annotations

from pathlib import Path

from tests.browser.conftest import SESSIONS, SIZE, SLOW_MS, Look, Screen


def downloaded(screen: Screen, label: str, into: Path) -> Path:
    """The file that the browser has after a click on one of the exports, which is that on the server's disk."""
    with screen.page.expect_download(timeout=SLOW_MS) as download:
        screen.click(label)
    path = into / download.value.suggested_filename
    download.value.save_as(path)
    written = screen.app.debugger.written[0].path
    assert path.name == written.name
    assert path.read_bytes() == written.read_bytes()
    return path


def test_the_browser_gets_what_was_exported(look: Look, tmp_path: Path) -> None:
    screen = look(SESSIONS / "mug.toml")
    screen.key("n")
    screen.at(1)
    screen.tab("Session")
    into = tmp_path / "downloads"
    for label in ("Recording", "Results CSV"):
        assert downloaded(screen, label, into).stat().st_size > 100
        screen.text("; your browser downloads it too$")
    scene = downloaded(screen, "3D scene", into)
    screen.shot("exported")
    offline(screen, scene)


def offline(screen: Screen, scene: Path) -> None:
    """Opens the exported scene from disk: it is drawn, named, and asks nobody for anything."""
    context = screen.page.context.browser.new_context(viewport=SIZE, offline=True)
    try:
        page = context.new_page()
        asked: list[str] = []
        page.on("request", lambda r: asked.append(r.url) if not r.url.startswith(("file:", "data:", "blob:")) else None)
        page.goto(scene.as_uri())
        page.locator("canvas").first.wait_for(timeout=SLOW_MS)
        legend = page.locator("#legend")
        assert legend.is_visible()
        for words in ("A mug on a table", "iteration 1 of 25", "simulated", "after physics", "ground truth"):
            assert words in legend.inner_text()
        assert page.title().startswith("A mug on a table")
        assert asked == []
    finally:
        context.close()
