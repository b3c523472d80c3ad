"""A real frame, YCB-Video 50/1, from the first look to the last panel: the sentences and numbers that a person reads.

Two of its pictures are always kept, in ``tests/browser/shots`` (git-ignored): their pixels are counted.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tests.browser.conftest import Look, Screen
from verefine_viz.core.geometry import angle_between, apply
from verefine_viz.core.palette import CLASS_COLORS

pytestmark = pytest.mark.data
NUMBER = r"(-?\d+(?:\.\d+)?)"
NAMES = ["003_cracker_box", "005_tomato_soup_can", "006_mustard_bottle", "011_banana", "035_power_drill"]


def numbers(screen: Screen, pattern: str) -> list[float]:
    """The numbers (``#`` in the pattern) of a sentence on the page, waited for."""
    pattern = pattern.replace("#", NUMBER)
    found = re.search(pattern, screen.text(pattern).inner_text())
    assert found is not None
    return [float(x) for x in found.groups()]


def test_real_frame(look: Look, real_session: Path) -> None:
    screen = look(real_session)
    screen.text("^5 objects; 003_cracker_box: 3 hypotheses, best score")
    screen.shot("real_0_ready")
    screen.click("Step ▶")
    screen.text("^Iteration 1 · 003_cracker_box · hypothesis 1 of 3")
    screen.shot("real_1_stepped")
    screen.click("Run")
    assert screen.finished().startswith("largest error: ")
    screen.text("^5 of 5 right$")
    of_objects = objects(screen)
    for tab, look_at in (("Score", score), ("Bandit", bandit), ("Physics", physics), ("Session", session)):
        screen.tab(tab)
        look_at(screen)
        screen.shot(f"real_panel_{tab.lower()}")
    screen.tab("Errors")
    errors(screen, of_objects["035_power_drill"])
    classes(screen, before=screen.picture("real_panel_errors"))


def objects(screen: Screen) -> dict[str, float]:
    """Each object's error [mm]; all of them are ticked as correct in the row of the frame."""
    frame, *rows = screen.table("object", "score", "mm", "it.")
    rows = [[cell.replace("\n", "") for cell in row] for row in rows]  # A long name is in two parts, cut between them.
    assert [row[1] for row in rows] == NAMES
    assert frame[4] == "5/5 ✓"
    assert [int(row[5]) for row in (frame, *rows)] == [75, 15, 15, 15, 15, 15]
    return {row[1]: float(row[4]) for row in rows}


def score(screen: Screen) -> None:
    rows = {row[0]: row[1:] for row in screen.table("initial", "answer", "B − A")}
    for name in ("score f̄", "depth f_d", "normal f_n"):
        initial, best, more = (float(x) for x in rows[name])
        assert best - initial == pytest.approx(more, abs=0.0011)
    run = screen.app.debugger.workspace.run
    assert float(rows["score f̄"][1]) == pytest.approx(run.iterations[-1].best.score.score, abs=0.0006)
    for k in range(2):
        shares = [float(rows[n][k].rstrip("%")) for n in ("explained", "missed", "protruding", "hidden", "unknown")]
        assert sum(shares) == pytest.approx(100, abs=0.3)
        assert shares[0] > 50


def bandit(screen: Screen) -> None:
    sentence = "^Answer: iteration .* Iteration 75 took hypothesis #: # [+] # > hypothesis #: # [+] #"
    arm, mean, bonus, _, other_mean, other_bonus = numbers(screen, sentence)
    assert mean + bonus > other_mean + other_bonus
    rows = screen.table("arm", "n", "UCB")
    plays = [int(row[1]) for row in rows]
    assert sum(plays) == 3 + 14  # The initial pose of each, and every play of this object but the one that is chosen.
    for row in rows:
        assert float(row[2]) + float(row[3]) == pytest.approx(float(row[4]), abs=0.0011)
    assert int(arm) - 1 == int(np.argmax([float(row[4]) for row in rows]))


def physics(screen: Screen) -> None:
    last, model = screen.app.debugger.workspace.run.iterations[-1], screen.app.debugger.view().target.model
    Ts = [stage.T_cam_obj for stage in last.stages[:2]]
    middles = [apply(T, model.points.mean(axis=0)[None])[0] for T in Ts]
    turned = np.rad2deg(angle_between(*(T[:3, :3] for T in Ts)))
    moved = 1e3 * np.linalg.norm(middles[1] - middles[0])
    simulated, *_ = (row for row in screen.table("stage", "turned") if row[0] == "simulated")
    assert [float(simulated[1].rstrip("°")), float(simulated[3])] == pytest.approx([turned, moved], abs=0.006)
    ended, in_all = numbers(screen, r"^After step 3: # contacts, # N in all")
    contacts = screen.table("with", "depth mm", "force N")
    assert len(contacts) == int(ended)
    assert {row[0] for row in contacts} == {"table"}
    assert sum(float(row[2]) for row in contacts) == pytest.approx(in_all, abs=0.3)


def errors(screen: Screen, of_drill_mm: float) -> None:
    rows = {row[0]: row for row in screen.table("stage", "ADD(-S)", "diam.")}
    *angles, moved, add = (float(cell.rstrip("°")) for cell in rows["answer"][1:6])
    turned, tilt, turn = angles
    assert np.hypot(tilt, turn) == pytest.approx(turned, abs=0.1)
    run = screen.app.debugger.workspace.run
    drill, best = run.problem.targets[-1], run.iterations[-1].best
    T_true, vertices = drill.instance.T_cam_obj_gt, drill.model.vertices
    assert T_true is not None
    # The drill has no symmetry: every point against itself.
    apart_mm = 1e3 * np.linalg.norm(apply(best.T_cam_obj, vertices) - apply(T_true, vertices), axis=1).mean()
    assert add == pytest.approx(apart_mm, abs=0.3)
    assert add == of_drill_mm
    assert rows["answer"][6] == f"{100 * add / (1e3 * drill.model.diameter_m):.0f}%"
    assert moved == pytest.approx(1e3 * np.linalg.norm((best.T_cam_obj - T_true)[:3, 3]), abs=0.06)
    assert [row[1].replace("\n", "") for row in screen.table("hyp.", "from")] == [
        "cosypose",
        "posecnn-rss2018",
        "sundermeyer",
    ]


def session(screen: Screen) -> None:
    screen.text(r"^Session “YCB-Video 50/1”, from .*real\.toml: frame 50/1 with 5 objects\.")


def classes(screen: Screen, before: Path) -> None:
    """In the colours of the pixel classes, the drill's cloud is mostly explained, and so green."""
    screen.key("c")
    screen.key("c")
    screen.until(lambda: screen.app.debugger.options.cloud == "class")
    assert explained_px(screen.picture("real_classes")) > explained_px(before) + 150


def explained_px(picture: Path) -> int:
    pixels = np.asarray(Image.open(picture).convert("RGB")).astype(int)
    return int((np.abs(pixels - CLASS_COLORS["explained"]).max(axis=-1) < 40).sum())
