"""Physics of an object in words and numbers, and the simulated path."""

from __future__ import annotations

import numpy as np
import pytest

from verefine_viz.page.protocol import PathMoment
from verefine_viz.run.iteration_words import moved_by_mm


def stepped(show):
    screen = show()
    screen.key("ArrowRight")
    screen.until("state.view.k === 1")
    screen.tab("physics")
    screen.text("Simulation of iteration 1")
    return screen, screen.app.debugger.space.work.first


def test_words_and_numbers_are_those_of_the_evaluator(show):
    screen, branch = stepped(show)
    target, iteration = branch.run.problem.targets[0], branch.run.iterations[0]
    names = [s.name for s in iteration.stages]
    tab = screen.page.locator(".tab.physics")
    heads = [text.strip() for text in tab.locator(".focus thead th").all_inner_texts()[1:]]
    rows = {row.locator("td").first.inner_text(): row.locator("td").all_inner_texts()[1:]
            for row in tab.locator(".focus tbody tr").all()}  # fmt: skip
    assert heads
    for j, name in enumerate(heads):
        stage = iteration.accepted_stage if name == "accepted" else iteration.stages[names.index(name)]
        known = branch.evaluator_of(1).plausibility(target, stage.T_cam_obj)
        assert float(rows["gap mm"][j]) == pytest.approx(known.gap_mm, abs=0.06)
        if known.penetrates is not None:
            assert float(rows["overlap mm"][j].split()[0]) == pytest.approx(known.penetration_mm, abs=0.06)
        if np.isfinite(known.margin_mm):
            assert float(rows["balance mm"][j]) == pytest.approx(known.margin_mm, abs=0.06)
        words = tab.locator(".light-words").nth(j).inner_text()
        assert words.startswith(name)
        assert known.sentence.removesuffix(".") in words
    screen.shot("physics")


def test_moments_of_the_path_are_scrubbed_and_played(show):
    screen, branch = stepped(show)
    path, points = branch.run.iterations[0].path, branch.run.problem.targets[0].model.points
    n = len(path.Ts_cam_obj)
    tab = screen.page.locator(".tab.physics")
    moved_mm = moved_by_mm(path.Ts_cam_obj[0], path.T_cam_obj, points)
    assert f"moved {moved_mm:.1f} mm" in tab.inner_text()
    slider = tab.locator("input[type=range]")
    for step in range(1, n):
        slider.fill(str(step))
        screen.until("state.view.moment === arg", step)
        screen.text(f"step {step} of {n - 1}")
        for _ in range(100):
            if screen.app.debugger.look.path == PathMoment(1, step):  # What the 3D view draws.
                break
            screen.page.wait_for_timeout(50)
        assert screen.app.debugger.look.path == PathMoment(1, step)
        contacts = path.contacts[step - 1]
        table = tab.locator("table", has_text=f"touches at step {step}")
        cells = [row.locator("td").all_inner_texts() for row in table.locator("tbody tr").all()]
        assert sum(int(row[1]) for row in cells) == len(contacts.others)
        assert sum(float(row[2]) for row in cells) == pytest.approx(float(contacts.forces_n.sum()), abs=0.2)
    screen.shot("physics_path")
    screen.page.evaluate("""async () => {
        const { state, listen } = await import("/web/store.js");
        window.seen = [];
        listen(() => window.seen.push(state.view.moment));
    }""")
    screen.click("Play")
    screen.until("window.seen.includes(0) && state.view.moment === arg", n - 1)
    screen.click("Hide")
    screen.until("state.view.moment === null")
    assert screen.errors == []
