"""Hypotheses are known by number, colour and source: in the legends, the Bandit tab and the list of objects."""

from __future__ import annotations

from dataclasses import replace

from tests.viewer.fake_tools import FakeTools
from tests.viewer.two_runs import SESSION, TWO
from tests.viewer.two_runs import debugger as plain
from verefine_viz.core.problem import Problem
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.debugger import Debugger
from verefine_viz.viewer.drawing.bandit_tables import arms_table
from verefine_viz.viewer.drawing.markup import arms_legend
from verefine_viz.viewer.drawing.pose_tables import starts_table
from verefine_viz.viewer.panels.bandit_panel import score_lines
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
    assert "Colours of the blocks: hypotheses" in shown
    for j in range(3):
        assert f'background:rgb{arm_color(j)}" title=""></i>{j + 1}' in shown
    assert ">cosypose</span>" in shown
    assert "<b>posecnn" not in shown
    assert "Blocks in the colours of the list of objects." in strip(
        debugger().carry_out([TWO, c.ShowScene(), c.RunUntil("end")]).view()
    )


def test_estimators_are_named_where_hypotheses_are() -> None:
    view = debugger().carry_out([c.RunUntil("end")]).view()
    assert ">cosypose</span>" in arms_table(view)
    best = view.state.best
    assert f"hypothesis {best.arm + 1} ({NAMES[best.arm]})" in headline(view)


def test_a_source_that_all_have_is_reported_once() -> None:
    view = plain().carry_out([c.RunUntil("end")]).view()
    hypotheses = [replace(h, source=f"perturbed 9° #{k + 1}") for k, h in enumerate(view.target.instance.hypotheses)]
    target = replace(view.target, instance=replace(view.target.instance, hypotheses=tuple(hypotheses)))
    assert arms_legend(target).count(">all perturbed 9°</span>") == 1
    assert starts_table(replace(view, target=target)).count(">perturbed 9°</span>") == 3, "the arm has the number"
    assert "perturbed" not in headline(replace(view, target=target)) + arms_table(replace(view, target=target))


def test_the_list_of_a_finished_run_names_the_hypotheses_that_won() -> None:
    d = debugger().carry_out([TWO, c.RunUntil("end")])
    shown = objects_html(d.view())
    for best in d.workspace.run.state.best:
        assert f"hypothesis {best.arm + 1} ({NAMES[best.arm]}), ".replace("<", "&lt;") in shown
    assert ">hyp.</th>" in shown
    assert ">hyp.</th>" not in objects_html(d.carry_out([c.Back()]).view())


def test_the_line_of_the_answer_lies_below_the_hypotheses() -> None:
    view = plain().carry_out([c.RunUntil("end")]).view()
    lines = score_lines(view, 3)
    assert lines[0].label == "answer"
    assert all(line.width < lines[0].width for line in lines[1:])
