"""Waiting that a person ends: initial poses that would take minutes are looked for, and the page goes on as before."""

from __future__ import annotations

from pathlib import Path

from tests.browser.conftest import SESSIONS, SLOW_MS, Look, is_seen, saved


def test_looking_for_initial_poses_is_cancelled_and_a_step_follows(look: Look, tmp_path: Path) -> None:
    path = saved(tmp_path, scene={"demo": "duck"}, hypotheses={"source": "pcs"}, pcs={"bases": 1_000_000})
    screen = look(SESSIONS / "mug.toml")
    screen.text("^5 hypotheses, best score")
    for n_steps, how in enumerate(("link", "Escape", "Escape in a box")):
        screen.tab("Session")
        file = [box for box in screen.page.get_by_role("textbox").all() if box.is_visible()][1]
        file.fill(str(path), timeout=SLOW_MS)
        screen.until(lambda: screen.app.page.layout.session.path.value == str(path))
        screen.click("Open session file")
        screen.text("^Looking for duck in its segment by 1,000,000 bases")
        cancel = screen.page.get_by_text("Cancel", exact=True)
        assert is_seen(screen, cancel)
        assert screen.page.get_by_role("progressbar").first.is_visible()
        if how == "link":
            cancel.first.click(timeout=SLOW_MS)
        else:
            if how == "Escape in a box":
                screen.page.get_by_role("textbox").first.click(timeout=SLOW_MS)
            screen.key("Escape")
        screen.text("^Cancelled: everything is as it was before")
        screen.text(rf"^Iteration {n_steps} of ")
        assert not cancel.first.is_visible()
        screen.shot(f"cancelled_by_{how.replace(' ', '_')}")
        screen.click("Step ▶")
        screen.at(n_steps + 1)
        assert screen.app.debugger.workspace.session.scene.demo == "mug"
