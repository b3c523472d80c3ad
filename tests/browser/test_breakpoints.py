"""Breakpoints and what follows a pose moved by hand, in a browser."""

from __future__ import annotations

import re
from pathlib import Path

from tests.browser.conftest import SESSIONS, SLOW_MS, Look, Screen, is_seen, saved
from verefine_viz.core.algorithm_settings import BreakpointSettings
from verefine_viz.core.geometry import axis_angle, transform
from verefine_viz.run.session_file import load_session
from verefine_viz.viewer import commands as c


def box(screen: Screen, label: str):  # type: ignore[no-untyped-def]
    return screen.page.get_by_label(label, exact=True)


def number(screen: Screen, of: str):  # type: ignore[no-untyped-def]
    return screen.page.get_by_label(f"threshold: {of}", exact=True)


def test_thresholds_are_shown_changed_kept_and_saved(look: Look, tmp_path: Path) -> None:
    breakpoints = {"jump_mm": 25.0, "score_falls_by": 0.5}
    screen = look(saved(tmp_path, scene={"demo": "mug"}, breakpoints=breakpoints))
    screen.tab("Breakpoints")
    assert box(screen, "moved 25 mm").is_checked()
    assert box(screen, "score −0.5").is_checked()
    assert [number(screen, of).input_value() for of in ("moved", "score −", "turned")] == ["25", "0.5", "10"]
    assert is_seen(screen, box(screen, "empty render"))
    for of in ("score −", "moved", "turned", "error +"):
        assert is_seen(screen, number(screen, of))
    screen.shot("breakpoints")
    for on in (False, True):
        box(screen, "moved 25 mm").click(timeout=SLOW_MS)
        screen.until(lambda on=on: (screen.app.debugger.workspace.breakpoints.jump_mm == 25.0) == on)
    number(screen, "moved").fill("32.5", timeout=SLOW_MS)
    screen.until(lambda: screen.app.debugger.workspace.breakpoints.jump_mm == 32.5)
    number(screen, "score −").fill("-1", timeout=SLOW_MS)
    screen.text("“score −” cannot be -1: give a number from 0 to 1")
    number(screen, "score −").blur()
    assert box(screen, "moved 32.5 mm").is_checked()
    screen.app.send(c.SaveSession("kept"))
    screen.app.wait_until_idle(60)
    kept = load_session(tmp_path / "kept.toml").breakpoints
    assert kept == BreakpointSettings(jump_mm=32.5, score_falls_by=0.5)
    box(screen, "moved 32.5 mm").click(timeout=SLOW_MS)
    screen.until(lambda: screen.app.debugger.workspace.breakpoints.jump_mm is None)
    assert box(screen, "moved 32.5 mm").is_visible()
    screen.app.send(c.OpenSession(str(tmp_path / "kept.toml")))
    screen.until(lambda: screen.app.debugger.workspace.breakpoints == kept)
    screen.until(box(screen, "moved 32.5 mm").is_checked)


def test_a_pose_put_near_the_truth_is_refined_next_and_wins(look: Look) -> None:
    screen = look(SESSIONS / "mug.toml")
    screen.app.send(c.RunTo(3))
    screen.app.wait_until_idle(60)
    truth = screen.app.debugger.view().target.instance.T_cam_obj_gt
    assert truth is not None
    put = truth @ transform(axis_angle([0, 1, 0], 0.15), [0.004, 0, 0])
    screen.app.send(c.SelectArm(0))
    screen.tab("Physics")
    screen.click("Edit pose")
    screen.text("The edited pose .* scores")
    screen.app.send(c.DragPose(tuple(float(x) for x in put.ravel())))
    screen.text(r"The edited pose \(hypothesis 1\) scores 0.648")
    screen.click("Continue from here")
    screen.text("Hypothesis 1 goes on from where you put it, with a score of 0.648. Step or Run: it is refined next")
    screen.shot("by_hand_continued")
    screen.click("Step ▶")
    screen.tab("Bandit")
    screen.text("Iteration 4 took hypothesis 1: its pose was edited and is played first")
    assert screen.page.locator('th[title*="An edited pose starts again at 1."]').count()
    screen.shot("by_hand_bandit")
    screen.click("Run")
    assert re.search("^score 0.9., hypothesis 1", screen.finished())
