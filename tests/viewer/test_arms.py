"""Hypotheses are known by number, colour and source: in the legends, the Bandit tab and the list of objects."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from tests.viewer.fake_tools import FakeTools
from tests.viewer.test_read_changes import FORK, Clustered
from tests.viewer.two_runs import SESSION, TWO
from tests.viewer.two_runs import debugger as plain
from verefine_viz.core.problem import Problem
from verefine_viz.core.settings import MethodSettings, Session
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.debugger import Debugger
from verefine_viz.viewer.drawing.bandit_tables import arms_table
from verefine_viz.viewer.drawing.markup import arms_legend
from verefine_viz.viewer.panels.objects_panel import objects_html
from verefine_viz.viewer.panels.timeline_panel import strip
from verefine_viz.viewer.text.display_names import arm_color
from verefine_viz.viewer.text.headline import headline

NAMES = ("cosypose", "<b>posecnn", "cosypose")


class Named(FakeTools):
    """Hypotheses of several estimators."""

    def problem(self, frame: str) -> Problem:
        problem = super().problem(frame)
        instances = []
        for instance in problem.instances:
            pairs = zip(instance.hypotheses, NAMES, strict=True)
            instances.append(replace(instance, hypotheses=tuple(replace(h, source=name) for h, name in pairs)))
        return replace(problem, instances=tuple(instances))


def debugger() -> Debugger:
    return Debugger(SESSION, None, Named)


def test_the_timeline_says_whose_colour_a_block_has() -> None:
    shown = strip(debugger().carry_out([c.RunUntil("end")]).view())
    for j in range(3):
        assert f"background:rgb{arm_color(j)}" in shown
    assert "cosypose" in shown
    assert "<b>posecnn" not in shown
    scene = strip(debugger().carry_out([TWO, c.ShowScene(), c.RunUntil("end")]).view())
    assert "colours of the list of objects" in scene


def test_estimators_are_named_where_hypotheses_are() -> None:
    view = debugger().carry_out([c.RunUntil("end")]).view()
    assert ">cosypose</span>" in arms_table(view)
    best = view.state.best
    assert f"hypothesis {best.arm + 1} ({NAMES[best.arm]})" in headline(view)


def test_a_source_that_all_have_is_reported_once() -> None:
    view = plain().carry_out([c.RunUntil("end")]).view()
    hypotheses = [replace(h, source=f"perturbed 9° #{k + 1}") for k, h in enumerate(view.target.instance.hypotheses)]
    target = replace(view.target, instance=replace(view.target.instance, hypotheses=tuple(hypotheses)))
    assert arms_legend(target).count("all perturbed 9°") == 1
    assert "perturbed" not in headline(replace(view, target=target)) + arms_table(replace(view, target=target))


def test_the_list_of_a_finished_run_names_the_hypotheses_that_won() -> None:
    d = debugger().carry_out([TWO, c.RunUntil("end")])
    shown = objects_html(d.view())
    for best in d.workspace.run.state.best:
        assert f"hypothesis {best.arm + 1} ({NAMES[best.arm]})".replace("<", "&lt;") in shown
    assert "hypothesis" not in objects_html(d.carry_out([c.Back()]).view())


def table(*commands: c.Command, frame: str = "0/2", **method: Any) -> str:
    d = Debugger(Session(method=MethodSettings(**{"name": "vf_depth", "iterations": 2} | method)), None, Clustered)
    return arms_table(d.carry_out([c.OpenFrame(frame), *commands]).view())


def test_of_several_objects_it_is_of_their_scores_together_and_of_one_of_its_own() -> None:
    assert "not of this object alone" in table(c.RunUntil("end"))
    for name, frame in (("rir", "0/2"), ("vf_depth", "0/1")):
        assert "not of this object alone" not in table(c.RunUntil("end"), name=name, frame=frame), (name, frame)


def test_settings_of_the_reward_and_an_earlier_method_are_reported() -> None:
    assert "the object&#x27;s initial pose" in table(c.Step(), scene_prior="object")
    assert "best pose of each object so far" in table(c.Step(), scene_reward="best_known")
    assert "Plays before vf_depth took over" in table(c.RunTo(2), FORK, name="rir")
