"""The exported 3D scene says what it shows, and text from data stays text."""

from __future__ import annotations

import re
from dataclasses import replace

import pytest

from tests.viewer.conftest import OpenPage
from tests.viewer.fake_tools import FakeTools
from verefine_viz.core.palette import CLASS_COLORS, STAGE_COLORS
from verefine_viz.core.settings import Session
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.debugger import Debugger
from verefine_viz.viewer.drawing.scene_page import scene_page

EVIL = "</details><img src=x onerror=alert(1)>\"'&"
PAGE = "<html><head><title>Viser</title><script>'</body>'</script></head><body><div></div>\n</body></html>"


@pytest.fixture
def debugger() -> Debugger:
    return Debugger(Session(title="Why did it fall?"), None, FakeTools)


def page(debugger: Debugger, *commands: c.Command) -> str:
    """What is exported after the commands, as words."""
    return scene_page(PAGE, debugger.carry_out(commands).view())


def words(html: str) -> str:
    return " ".join(re.sub(r"<style>.*?</style>|<[^>]*>", " ", html, flags=re.DOTALL).split())


def test_it_says_which_moment_it_is(debugger: Debugger) -> None:
    html = page(debugger, c.Step())
    view = debugger.view()
    assert f"<title>Why did it fall?, frame {view.frame}</title>" in html
    assert f"Why did it fall? Frame {view.frame}, RIR, iteration 1 of {view.progress.total}." in words(html)
    assert "the answer after" in words(page(debugger, c.RunUntil("end")))
    assert "before iteration 1" in words(page(debugger, c.Seek(0)))
    assert html.index("</script>") < html.index('id="legend"') < html.rindex("</body>"), "whatever the script says"


def test_it_names_every_colour_that_is_drawn_with_the_score_of_the_pose(debugger: Debugger) -> None:
    html = page(debugger, c.Step(), c.ShowLayer("refined", False), c.ShowLayer("best", True))
    poses = debugger.view().poses
    for name in ("current", "simulated", "accepted", "best"):
        score = poses[name].score
        assert f"rgb{STAGE_COLORS[name]}" in html
        assert f"{poses[name].label} {score.score:.2f}" in words(html)
    assert f"rgb{STAGE_COLORS['refined']}" not in html
    assert all(f"{j}" in words(html).partition("hypotheses, faint:")[2] for j in (1, 2))


def test_colours_of_the_cloud_and_of_two_runs_are_named(debugger: Debugger) -> None:
    html = page(debugger, c.Step(), c.ColorCloud("class"))
    assert all(f"rgb{color}" in html and name in words(html) for name, color in CLASS_COLORS.items())
    compared = words(page(debugger, c.CompareRun((("method.name", "pir"),)), c.RunB()))
    sides = debugger.view().comparison
    assert f"A {sides.name_a}, solid B {sides.name_b}, as an outline" in compared


class Evil(FakeTools):
    """Objects and hypotheses with names that would run as a script."""

    def problem(self, frame: str):
        problem = super().problem(frame)
        instances = [
            replace(i, hypotheses=tuple(replace(h, source=EVIL) for h in i.hypotheses)) for i in problem.instances
        ]
        models = {k: replace(m, name=EVIL) for k, m in problem.models.items()}
        return replace(problem, models=models, instances=tuple(instances))


def test_hostile_names_are_text(open_page: OpenPage) -> None:
    evil = open_page(Session(title=EVIL), Evil)
    evil.send(c.Step())
    evil.send(c.Export("scene"))
    evil.wait_until_idle()
    html = evil.debugger.written[0].path.read_text()
    assert html.count('id="legend"') == 1
    assert "&lt;img src=x onerror=alert(1)&gt;" in html
    assert "<img src=x" not in html
    assert html.partition('id="legend"')[2].count("</details>") == 1
