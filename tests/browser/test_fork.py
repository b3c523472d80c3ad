"""What-ifs: fork with a changed setting, compare A with B, remove a branch."""

from __future__ import annotations

from verefine_viz.core.presets import PRESETS
from verefine_viz.page import protocol as p


def setting(screen, name):
    return screen.page.locator(".setting-row").filter(has_text=name).locator("input, select").first


def test_fork_with_a_changed_setting_keeps_what_was_before_and_runs(show):
    screen = show()
    for k in range(1, 6):
        screen.key("ArrowRight")
        screen.until("state.view.k === arg", k)
    screen.tab("settings")
    setting(screen, "exploration").fill("0.9")
    screen.text("0.1 → 0.9")
    screen.click("Fork at 5")
    screen.until("state.branches.length === 2 && state.view.branch === state.branches[1].index")
    screen.until("state.runs.get(state.branches[1].index)?.over")
    old, new = screen.app.debugger.space.branches.values()
    assert new.settings.method.exploration == 0.9
    assert [i.arm for i in new.run.iterations[:5]] == [i.arm for i in old.run.iterations]
    assert old.run.length == 5
    screen.until("moment.isAnswer")
    screen.text("Change a setting")  # The new branch holds what was typed.
    screen.shot("fork")
    screen.page.locator(".status .branches button").first.click()
    screen.until("state.view.branch === arg && state.view.k === 5", old.index)
    screen.tab("compare")
    screen.page.get_by_title("remove this branch").last.click()
    screen.until("state.branches.length === 1")
    assert list(screen.app.debugger.space.branches) == [old.index]


def test_run_b_on_an_unrun_a_runs_both_and_shows_where_they_part(show):
    screen = show()
    screen.tab("compare")
    screen.page.locator(".new-b input.name").fill("method: exploration")
    screen.page.locator(".new-b input.setting").fill("2")
    screen.click("Run B")
    screen.until("state.compare && [state.compare.a, state.compare.b].every(i => state.runs.get(i)?.over)")
    a, b = screen.app.debugger.space.branches.values()
    assert b.settings.method.exploration == 2
    choices = [[i.arm for i in branch.run.iterations] for branch in (a, b)]
    first = next(k for k, (x, y) in enumerate(zip(*choices, strict=True), start=1) if x != y)
    screen.text("First difference").click()
    screen.until("state.view.k === arg && moment.row.k === arg", first)
    assert screen.state("moment.beside.row.arm") == choices[1][first - 1]
    pair = screen.state("[moment.a.T, moment.b.T]")
    assert pair == [branch.run.iterations[first - 1].accepted_stage.T_cam_obj.ravel().tolist() for branch in (a, b)]
    for branch in (a, b):
        best, target = branch.run.final_state.best[0], branch.run.problem.targets[0]
        error = branch.final_evaluator.errors(target, best.T_cam_obj).add_s_mm
        screen.page.locator(".tab.compare tbody tr", has_text=f"{error:.1f}").first.wait_for()
    screen.shot("compare_tab")
    screen.click("Compare")
    screen.page.wait_for_timeout(300)
    screen.shot("compare_preset")
    screen.click("End A/B")
    screen.until("state.compare === null && state.branches.length === 2")


def test_nothing_that_is_begun_stops_another_run(show):
    screen = show("clutter")
    first = screen.app.debugger.space.work.first
    screen.key(" ")
    screen.until("state.running.branch !== null")
    screen.app.send(p.Compare(first.index, changes={"method.exploration": 1.5}))  # As another window would.
    screen.until("state.branches.length === 2")
    screen.key("Home")
    screen.tab("settings")
    screen.page.get_by_role("button", name="Fork at").click()
    screen.until("state.branches.length === 3 && state.view.branch === state.branches[2].index")
    screen.until("state.branches.every(b => state.runs.get(b.index)?.over)")
    assert all(b.run.is_done for b in screen.app.debugger.space.branches.values())
    screen.shot("fork_three_runs")


def test_b_can_have_the_papers_choices(show):
    screen = show()
    screen.tab("compare")
    screen.page.locator(".new-b input.name").fill("preset")
    select = screen.page.locator(".new-b select")
    assert select.locator("option").all_inner_texts() == list(PRESETS)
    select.select_option("paper")
    screen.click("Run B")
    screen.until("state.compare && [state.compare.a, state.compare.b].every(i => state.runs.get(i)?.over)")
    _, b = screen.app.debugger.space.branches.values()
    assert (b.settings.preset, b.settings.score.alpha) == ("paper", 0.293)
    screen.shot("compare_paper")
