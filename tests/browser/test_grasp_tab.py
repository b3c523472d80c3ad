"""The simulated grasp in the browser: asked for by a click, its outcomes, and its moments."""

from __future__ import annotations

from tests.browser.conftest import SESSIONS, SLOW_MS, Look, is_seen
from verefine_viz.viewer import commands as c


def test_a_grasp_is_carried_out_and_scrubbed(look: Look) -> None:
    screen = look(SESSIONS / "mug.toml")
    screen.app.send(c.RunUntil("end"))
    screen.app.wait_until_idle(120)
    screen.tab("Grasp")
    (client,) = screen.app.server.get_clients().values()
    before_m = float(client.camera.look_at[2])
    screen.text("^Grasp mug by the answer$").click(timeout=SLOW_MS)
    screen.until(lambda: screen.app.debugger.options.grasp_moment is not None)
    pair = screen.app.debugger.view().grasp
    assert pair is not None
    assert pair.answer.verdict == "success"
    # To where the lifted object is.
    screen.until(lambda: client.camera.look_at[2] > before_m + 0.03)
    chips = screen.page.locator(".vz .end")
    chips.first.wait_for(timeout=SLOW_MS)
    assert chips.count() == 2
    assert [chip.inner_text().split("\n")[0] for chip in chips.all()] == ["answer", "ground truth"]
    assert is_seen(screen, chips.last)
    assert is_seen(screen, screen.page.locator('.vz svg[aria-label="grasp over time"]'))
    screen.shot("grasp_end")

    chips.last.click(timeout=SLOW_MS)
    screen.until(lambda: screen.app.debugger.options.grasp_by == "ground truth")
    assert is_seen(screen, screen.text("^Moment$"))
    screen.click("Hide")
    screen.until(lambda: screen.app.debugger.options.grasp_moment is None)
    screen.click("Play")
    screen.until(lambda: screen.app.debugger.options.grasp_moment is not None)
    screen.shot("grasp_ground_truth")
