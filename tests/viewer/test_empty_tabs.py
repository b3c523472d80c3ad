"""Tabs of what is not there are named with the reason, and only those."""

from __future__ import annotations

from dataclasses import replace

from tests.viewer.fake_tools import FakeTools
from verefine_viz.core.problem import Problem
from verefine_viz.core.settings import MethodSettings, Session
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.debugger import Debugger
from verefine_viz.viewer.panels.landscape_panel import landscape_html
from verefine_viz.viewer.panels.order_panel import order_html
from verefine_viz.viewer.snapshot.snapshot import Snapshot
from verefine_viz.viewer.text.empty_tabs import empty_tabs

TWO = c.OpenFrame("0/2")


class Ordered(FakeTools):
    def problem(self, frame: str) -> Problem:
        return self.ordered(super().problem(frame))


def after(*commands: c.Command, name: str = "rir") -> Snapshot:
    return Debugger(Session(method=MethodSettings(name=name, iterations=2)), None, Ordered).carry_out(commands).view()


def test_a_method_without_a_choice_has_no_bandit_and_only_one_with_bounds_has_curves_of_them() -> None:
    assert {"Bandit", "UCB"} <= empty_tabs(after(name="pir")).keys()
    for name in ("rir", "vf_depth", "even"):
        assert "Bandit" not in empty_tabs(after(name=name)), name
    assert "UCB" not in empty_tabs(after(name="rir"))
    assert "UCB" in empty_tabs(after(name="even"))
    assert "UCB" in empty_tabs(after(TWO, c.ShowScene()))


def test_one_object_has_no_order_and_several_have() -> None:
    one, two = after(), after(TWO)
    assert empty_tabs(one)["Order"] in order_html(one)
    assert "Order" not in empty_tabs(two)


def test_the_landscape_is_empty_until_the_run_is_over_or_it_is_asked_for() -> None:
    ready = after()
    assert empty_tabs(ready)["Landscape"] in landscape_html(ready)
    for commands in ([c.RunUntil("end")], [c.ShowLandscape()]):
        assert "Landscape" not in empty_tabs(after(*commands))


def test_without_ground_truth_there_are_no_errors() -> None:
    known = after(c.RunUntil("end"))
    assert not {"Errors", "Error"} & empty_tabs(known).keys()
    objects = [
        replace(o, target=replace(o.target, instance=replace(o.target.instance, T_cam_obj_gt=None)))
        for o in known.scene.objects
    ]
    unknown = replace(known, ground_truth=None, scene=replace(known.scene, objects=tuple(objects)))
    assert {"Errors", "Error"} <= empty_tabs(unknown).keys()
