"""The dependency graph in the page: seen, reordered and cut by clicking."""

from __future__ import annotations

from pathlib import Path

from tests.browser.conftest import SLOW_MS, Look, Screen, saved
from verefine_viz.viewer.commands import CutDependency, MoveInOrder, ResetOrder


def click(screen: Screen, command: type, title: str = "") -> None:
    """The first thing in the picture or below it that sends such a command."""
    shown = screen.page.locator(f".vz.order [data-cmd*='\"{command.__name__}\"']")
    (shown.filter(has_text=title) if title else shown).first.click(timeout=SLOW_MS)


def test_the_order_is_seen_and_changed_by_clicking(look: Look, tmp_path: Path) -> None:
    method = {"name": "vf_breadth", "iterations": 1}
    screen = look(saved(tmp_path, scene={"demo": "stack"}, hypotheses={"max_per_object": 1}, method=method))

    def order() -> tuple[int, ...]:
        graph = screen.app.debugger.workspace.work.problem.dependencies
        assert graph is not None
        return graph.order

    by_rule = order()
    screen.tab("Order")
    screen.text("The order follows from what touches, hides and carries what")
    screen.text("^carries 100%")
    screen.shot("order_by_rule")

    click(screen, MoveInOrder, "later")
    screen.until(lambda: order() == (by_rule[1], by_rule[0], by_rule[2]))
    screen.text("The order is given by the session")
    screen.text("which seems to carry it")
    screen.shot("order_by_hand")

    click(screen, ResetOrder)
    screen.until(lambda: order() == by_rule)

    click(screen, CutDependency)
    screen.until(lambda: screen.app.debugger.workspace.session.dependency.cut == ((0, 1),))
    screen.text("^carries 100% ✂")
    screen.text("restore")
    assert screen.page.locator("svg title", has_text="cluster 2 of 2").count()
    screen.shot("order_cut")
    click(screen, CutDependency, "restore")
    screen.until(lambda: screen.app.debugger.workspace.session.dependency.cut == ())

    screen.click("Run")
    screen.until(lambda: screen.app.debugger.workspace.run.is_done)
    assert [i.instance_id for i in screen.app.debugger.workspace.run.iterations] == list(by_rule)
