"""A real frame without ground truth: the verdict, what else fits, and the score around an answer."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.browser.conftest import SESSIONS, Pages, Screen
from verefine_viz.page.app import App
from verefine_viz.run.session_file import changed, load_session

LESS = {"hypotheses": {"max_per_object": 4}, "method": {"iterations": 1}, "physics": {"collider": "hull", "steps": 20}}


@pytest.fixture(scope="module")
def app(chromium, shared_data, tmp_path_factory):
    path = SESSIONS / "xapc.toml"
    app = App(
        changed(load_session(path), LESS, tuple(LESS)), path, port=0, folder=Path(tmp_path_factory.mktemp("x"))
    ).start()
    app.wait_until_ready(180)
    yield app
    app.stop()


def finished(app: App, pages: Pages) -> Screen:
    screen = pages.show(app)
    screen.until("state.runs.has(state.view.branch)")
    if not screen.state("state.runs.get(state.view.branch).over"):
        screen.key(" ")
    screen.until("moment.isAnswer && state.verdicts.has(state.view.branch)")
    return screen


def test_verdict_names_the_worst_first_with_physics(app, pages):
    screen = finished(app, pages)
    branch = app.debugger.space.work.first
    names = [target.instance.instance_id for target in branch.run.problem.targets]
    answers = dict(zip(names, branch.run.final_state.best, strict=True))
    app.wait_until_idle(120)
    verdict = screen.state("state.verdicts.get(state.view.branch)")
    assert all(o["err"] is None and o["tone"] in ("doubt", "unknown", "none") for o in verdict["objects"])
    impossible = [o["obj"] for o in verdict["objects"] if any(f["cause"] == "impossible" for f in o["findings"])]
    worst = min(impossible or answers, key=lambda obj: answers[obj].score.score)
    assert verdict["scene"]["worst"] == worst
    assert screen.state("moment.obj") == worst
    words = screen.page.locator(".verdict").inner_text()
    assert screen.state("moment.object.label") in words
    assert verdict["scene"]["words"] in words
    also = [o for o in verdict["objects"] if o["also_fits"]]
    for o in also:
        screen.view(obj=o["obj"])
        screen.until("moment.obj === arg", o["obj"])
        screen.page.locator(".legend", has_text="fits as well").wait_for()
    screen.page.get_by_title("Evidence and what to do about it").click()
    screen.shot("unknown_truth_verdict")


def test_landscape_is_the_score_and_a_click_edits_the_pose_there(app, pages):
    screen = finished(app, pages)
    screen.tab("landscape")
    screen.page.locator(".tab.landscape .map rect").first.wait_for(timeout=120_000)
    branch, obj = app.debugger.space.work.first, screen.state("moment.obj")
    target = branch.run.problem.target(obj)
    T_best = np.array(screen.state("moment.best.T")).reshape(4, 4)
    assert branch.final_evaluator.known_allowed(target, T_best, branch.run.iterations) is not None
    assert screen.page.locator(".tab.landscape .curves figure").count() == 6
    svg = screen.page.locator(".tab.landscape .map svg")
    svg.scroll_into_view_if_needed()
    box = svg.bounding_box()
    screen.page.mouse.move(box["x"] + 0.2 * box["width"], box["y"] + 0.3 * box["height"])
    shown = float(screen.page.locator(".tab.landscape .map .read b").inner_text())
    screen.shot("landscape")
    screen.page.mouse.down()
    screen.page.mouse.up()
    screen.until("state.view.edited !== null")
    T = np.array(screen.state("state.view.edited.T")).reshape(4, 4)
    assert shown == pytest.approx(branch.final_evaluator.score(target, T).score, abs=6e-4)
    assert screen.page.locator(".tab.landscape .curves figure").count() == 6  # To try another pose.
    screen.key("Escape")
    screen.until("state.view.edited === null")
    figure = screen.page.locator(".tab.landscape .curves figure").first
    figure.click(position={"x": 10, "y": 30})
    screen.until("state.view.edited !== null")
    assert screen.state("state.view.edited.obj") == obj
    screen.shot("landscape_edit")
