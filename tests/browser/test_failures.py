"""Each failure of the page's table, in at most the clicks that it allows."""

from __future__ import annotations

from tests.browser.conftest import SESSIONS, SLOW_MS, Look, Screen
from verefine_viz.viewer import commands as c


def run_to_end(screen: Screen) -> None:
    """Run, past breakpoints if there are any."""
    for _ in range(30):
        screen.click("Run")
        screen.app.wait_until_idle(120)
        if screen.app.debugger.workspace.run.is_done:
            return
    raise AssertionError("the run did not end")


def open_failure(screen: Screen, name: str) -> None:
    screen.app.send(c.OpenSession(str(SESSIONS / f"failure_{name}.toml")))
    screen.app.wait_until_idle(120)
    screen.at(0)


def test_each_failure_is_named(look: Look) -> None:
    screen = look(SESSIONS / "failure_no_hypothesis_near.toml")
    no_hypothesis_near(screen)
    for name, check in (
        ("icp_slides", icp_slides),
        ("simulation_topples", simulation_topples),
        ("score_prefers_wrong", score_prefers_wrong),
        ("mask_leaks", mask_leaks),
        ("wrong_plane", wrong_plane),
        ("arm_starved", arm_starved),
    ):
        open_failure(screen, name)
        check(screen)


def no_hypothesis_near(screen: Screen) -> None:
    run_to_end(screen)
    assert screen.finished().startswith("no good hypothesis in the pool: nearest start")
    screen.why("No hypothesis of the .* starts near: best initial error")
    screen.shot("failure_no_hypothesis_near")


def icp_slides(screen: Screen) -> None:
    run_to_end(screen)
    marks = [m for m in screen.app.debugger.workspace.branch.marks() if m.kind == "error_grew"]
    assert marks, "no red mark where the error grew"
    screen.page.locator(".vz.line g[data-cmd] polygon[fill='rgb(220, 50, 47)']").first.click(timeout=SLOW_MS)
    screen.text("while the error grew by")
    screen.shot("failure_icp_slides")


def simulation_topples(screen: Screen) -> None:
    screen.click("Run")
    screen.text("Breakpoint at iteration|The simulation turned the object by")
    screen.shot("failure_simulation_topples")
    screen.tab("Physics")
    assert any(row[0] == "simulated" for row in screen.table("stage", "turned"))
    screen.shot("failure_simulation_topples_physics")


def score_prefers_wrong(screen: Screen) -> None:
    run_to_end(screen)
    assert screen.finished().startswith("score ranks a wrong pose above the ground truth, by 0.1")
    view = screen.app.debugger.view()
    assert (view.options.a, view.options.b) == ("best", "ground truth")
    screen.why("The score prefers a pose of the .* that is wrong by .* More iterations need not help")
    screen.tab("Errors")
    screen.text("^The score prefers the answer to ground truth.")
    screen.click("Compare with ground truth")
    screen.shot("failure_score_prefers_wrong")


def arm_starved(screen: Screen) -> None:
    run_to_end(screen)
    screen.why("its exploration bonus never won")
    # The hypotheses have one source, which does not say how far off they are.
    legend = screen.page.locator(".vz.line .blocks")
    assert legend.inner_text().split() == ["1", "2", "3", "4", "5"]
    last = legend.locator("> span").last.bounding_box()
    whole = legend.bounding_box()
    assert last is not None
    assert whole is not None
    assert last["x"] + last["width"] <= whole["x"] + whole["width"]
    for words in screen.page.locator(".vz.line .legend > span").all():
        assert words.evaluate("e => e.scrollWidth <= e.clientWidth"), "the marks are explained in full"
    screen.curve("Pulls")
    screen.page.locator(".u-over").last.wait_for(timeout=SLOW_MS)
    screen.shot("failure_arm_starved")
    screen.why("its exploration bonus never won")
    screen.page.locator(".vz a", has_text="what if method.exploration =").first.click(timeout=SLOW_MS)
    screen.text("exploration = 0.2, from iteration 0")
    screen.app.wait_until_idle(60)
    first, second = screen.app.debugger.view().branches
    assert first.errors[0] is not None
    assert second.errors[0] is not None
    assert second.errors[0].add_s_mm < first.errors[0].add_s_mm
    screen.shot("failure_arm_starved_what_if")


def mask_leaks(screen: Screen) -> None:
    run_to_end(screen)
    screen.why("of the pixels are missed")
    screen.shot("failure_mask_leaks")


def wrong_plane(screen: Screen) -> None:
    run_to_end(screen)
    screen.why("The support plane explains only")
    screen.shot("failure_wrong_plane")
