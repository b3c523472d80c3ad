"""Each failure of the page's table, in at most the clicks that it allows."""

from __future__ import annotations

from tests.browser.conftest import SESSIONS, SLOW_MS, Look, Screen


def run_to_end(screen: Screen) -> None:
    """Run, past breakpoints if there are any."""
    for _ in range(30):
        screen.click("Run")
        screen.app.wait_until_idle(120)
        if screen.app.debugger.workspace.run.is_done:
            return
    raise AssertionError("the run did not end")


def test_no_hypothesis_near(look: Look) -> None:
    screen = look(SESSIONS / "failure_no_hypothesis_near.toml")
    run_to_end(screen)
    assert screen.finished().startswith("no good hypothesis in the pool: nearest start")
    screen.why("No hypothesis starts near: best initial error")
    screen.shot("failure_no_hypothesis_near")


def test_icp_slides(look: Look) -> None:
    screen = look(SESSIONS / "failure_icp_slides.toml")
    run_to_end(screen)
    marks = [m for m in screen.app.debugger.workspace.branch.marks() if m.kind == "error_grew"]
    assert marks, "no red mark where the error grew"
    screen.page.locator(".vz.line g[data-cmd] polygon[fill='rgb(220, 50, 47)']").first.click(timeout=SLOW_MS)
    screen.text("while the error grew by")
    screen.shot("failure_icp_slides")


def test_simulation_topples(look: Look) -> None:
    screen = look(SESSIONS / "failure_simulation_topples.toml")
    screen.click("Run")
    screen.text("Breakpoint at iteration|The simulation turned the object by")
    screen.shot("failure_simulation_topples")
    screen.tab("Physics")
    assert any(row[0] == "simulated" for row in screen.table("stage", "turned"))
    screen.shot("failure_simulation_topples_physics")


def test_score_prefers_a_wrong_pose(look: Look) -> None:
    screen = look(SESSIONS / "failure_score_prefers_wrong.toml")
    run_to_end(screen)
    assert screen.finished().startswith("score ranks a wrong pose above the ground truth, by 0.1")
    view = screen.app.debugger.view()
    assert (view.options.a, view.options.b) == ("best", "ground truth")
    screen.why("The score prefers a pose of the .* that is wrong by .* More iterations need not help")
    screen.tab("Errors")
    screen.text("^The score prefers the answer to ground truth.")
    screen.click("Compare with ground truth")
    screen.shot("failure_score_prefers_wrong")


def test_arm_starved(look: Look) -> None:
    screen = look(SESSIONS / "failure_arm_starved.toml")
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
    screen.page.locator(".vz a", has_text="what if c =").first.click(timeout=SLOW_MS)
    screen.text("exploration = 0.2, from iteration 0")
    screen.app.wait_until_idle(60)
    first, second = screen.app.debugger.view().branches
    assert first.errors[0] is not None
    assert second.errors[0] is not None
    assert second.errors[0].add_s_mm < first.errors[0].add_s_mm
    screen.shot("failure_arm_starved_what_if")


def test_mask_leaks(look: Look) -> None:
    screen = look(SESSIONS / "failure_mask_leaks.toml")
    run_to_end(screen)
    screen.why("of the pixels are missed")
    screen.shot("failure_mask_leaks")


def test_wrong_plane(look: Look) -> None:
    screen = look(SESSIONS / "failure_wrong_plane.toml")
    run_to_end(screen)
    screen.why("The support plane explains only")
    screen.shot("failure_wrong_plane")
