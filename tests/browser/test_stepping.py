"""Step, stage, back, run, breakpoints, marks: with keys and buttons, whatever was clicked last."""

from __future__ import annotations

from verefine_viz.page import protocol as p


def test_step_stage_and_back(show):
    screen = show()
    assert screen.state("state.view.k") == 0
    screen.click("Step")
    screen.until("state.view.k === 1 && moment.row.k === 1")
    screen.key("s")
    screen.until("state.view.k === 2 && state.view.stage === 'current'")
    stages = screen.state("moment.row.stages.map(s => s.name)")
    for stage in stages[1:]:
        screen.key("s")
        screen.until("state.view.stage === arg || (state.view.stage === null && arg === moment.row.accepted)", stage)
    screen.key("ArrowRight")
    screen.key("ArrowRight")
    screen.until("state.view.k >= 3")
    k = screen.state("state.view.k")
    screen.key("ArrowLeft")
    screen.until("state.view.k === arg", k - 1)
    assert screen.state("state.runs.get(state.view.branch).rows.length") == k
    screen.shot("stepping")
    assert screen.errors == []
    assert screen.foreign == []


def test_space_runs_and_pauses_whatever_was_clicked_last(show):
    screen = show()
    screen.click("Step")
    screen.until("state.view.k === 1")
    screen.key(" ")  # The focused button must not be pressed as well.
    screen.until("state.runs.get(state.view.branch)?.over")
    screen.until("moment.isAnswer")
    rows = screen.state("state.runs.get(state.view.branch).rows.length")
    assert rows == screen.state("state.runs.get(state.view.branch).total")
    # The verdict is computed after the run.
    screen.until("state.verdicts.has(state.view.branch) && document.querySelector('.verdict .words.right')")
    assert "allowed" in screen.page.locator(".verdict").inner_text()


def test_run_on_the_page_equals_the_engine(show):
    screen = show()
    screen.key(" ")
    screen.until("moment.isAnswer")
    branch = screen.app.debugger.space.work.first
    seen = screen.state("state.runs.get(state.view.branch).rows.map(r => r.stages.map(s => [s.name, s.score, s.T]))")
    made = [
        [[s.name, s.score and s.score.score, s.T_cam_obj.ravel().tolist()] for s in i.stages]
        for i in branch.run.iterations
    ]
    assert seen == made


def test_breakpoint_stops_and_scrubbing_asks_nothing(show):
    screen = show()
    screen.app.send(p.Break({"arm_switched": True}))
    screen.app.wait_until_idle()
    screen.key(" ")
    screen.until("state.runs.get(state.view.branch).rows.length > 0 && state.running.branch === null")
    stopped = screen.app.debugger.space.work.first.run
    assert not stopped.is_done
    assert any(event.kind == "arm_switched" for event in stopped.iterations[-1].events)
    screen.app.send(p.Break({"arm_switched": False}))
    screen.key(" ")
    screen.until("moment.isAnswer")
    n_verbs = len(screen.app.debugger.log)
    for key in ("Home", "ArrowRight", "e", "e", "End", "ArrowLeft"):
        screen.key(key)
    screen.until("state.view.k === arg - 1", stopped.length)
    assert len(screen.app.debugger.log) == n_verbs
    screen.shot("marks")
