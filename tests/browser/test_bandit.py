"""The bandit as it was when it chose."""

from __future__ import annotations

import pytest

SHOWS = "document.querySelector('.tab.bandit p')?.innerText.startsWith(`Iteration ${arg} `)"


def test_numbers_of_the_bandit_are_those_it_chose_by(show):
    screen = show().finish()
    screen.tab("bandit")
    run = screen.app.debugger.space.work.first.run
    for k in (1, 2, run.length // 2, run.length - 1):
        screen.state("(await import('/web/cursor.js')).seek(arg)", k)
        screen.until(f"moment.k === arg && {SHOWS}", k)
        choice = run.iterations[k - 1].choice
        rows = screen.page.locator(".bandit-arms tbody tr").all()
        assert len(rows) == len(choice.mean)
        for j, row in enumerate(rows):
            cells = row.locator("td").all_inner_texts()
            assert cells[0].strip() == str(j + 1)
            assert float(cells[2]) == pytest.approx(choice.ucb[j], abs=6e-4)
            # n of the bandit counts the initial pose as well.
            calls = cells[3].removesuffix(" + 1")
            assert int(calls) == choice.plays[j] - 1
            assert (calls != cells[3]) == (j == run.iterations[k - 1].arm)
            title = row.get_attribute("title")
            assert f"mean {choice.mean[j]:.3f} + bonus {choice.exploration[j]:.3f}" in title
            widths = row.locator(".ucb i").evaluate_all("all => all.map(i => parseFloat(i.style.width))")
            assert sum(widths) <= 100.01
        chosen = screen.page.locator(".bandit-arms tr.chosen td").first.inner_text()
        assert int(chosen) == run.iterations[k - 1].arm + 1
    screen.shot("bandit")


def test_click_on_a_hypothesis_puts_it_in_focus(show):
    screen = show()
    screen.key("ArrowRight")
    screen.until("state.view.k === 1")
    screen.tab("bandit")
    row = screen.page.locator(".bandit-arms tbody tr").nth(2)
    row.click()
    screen.until("moment.arm === 2 && state.view.arm === 2")
    branch = screen.app.debugger.space.work.first
    hypothesis = branch.run.problem.targets[0].instance.hypotheses[2]
    assert screen.state("moment.poses.initial.T") == hypothesis.T_cam_obj.ravel().tolist()
    row.click()
    screen.until("state.view.arm === null")
    screen.page.get_by_role("button", name="0.2", exact=True).click()  # A what-if of the bonus's weight.
    screen.until("state.branches.length === 2 && state.runs.get(state.branches[1].index)?.over")
    assert list(screen.app.debugger.space.branches.values())[1].settings.method.exploration == 0.2
    screen.text("instead of 0.2?")
    screen.shot("bandit_what_if")
