"""The order of the objects on the page: changed by hand, drawn, and said in words."""

from __future__ import annotations

import re
from dataclasses import replace
from itertools import pairwise
from typing import Any
from xml.etree import ElementTree

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.viewer.client import client, until
from tests.viewer.conftest import OpenPage
from tests.viewer.fake_tools import FakeTools
from verefine_viz.core.errors import InputError
from verefine_viz.core.problem import DependencyGraph, Edge, Problem
from verefine_viz.core.settings import MethodSettings, Session
from verefine_viz.recording.verify import first_difference
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.command_json import from_json, to_json
from verefine_viz.viewer.commands import CutDependency, MoveInOrder, ResetOrder
from verefine_viz.viewer.debugger import Debugger
from verefine_viz.viewer.handlers.open_handlers import entries, moved
from verefine_viz.viewer.panels.order_panel import Node, order_html, picture

SESSION = Session(title="order", method=MethodSettings(iterations=1, name="vf_breadth"))
EDGES = (
    Edge("support", 3, 1, 0.8, "64% of its footprint, 2 mm above"),
    Edge("contact", 1, 3, 0.9, "1 mm apart"),
    Edge("occlusion", 2, 3, 0.4, "22 mm nearer along 40 px"),
    Edge("support", 1, 2, 0.1, "leans on it, 5 mm above where they meet", "ambiguous"),
)
GRAPH = DependencyGraph(EDGES, ((3, 1, 2), (4,)), ((3, 1), (2,), (4,)), "recommended", ("what carries what is odd",))
NAMES = {1: "can", 2: "duck", 3: "cereal", 4: "mug"}


class ThreeBoxes(FakeTools):
    """One frame of three boxes, the outer two seen to depend on the one between them."""

    def problem(self, frame: str) -> Problem:
        return self.ordered(super().problem("0/3"))

    @property
    def frames(self) -> tuple[str, ...]:
        return ("0/1", "0/2", "0/3")

    def ordered(self, problem: Problem) -> Problem:
        found = super().ordered(problem)
        assert found.dependencies is not None
        pairs = ((0, 1), (1, 2))
        cut = {frozenset(p) for p in self.session.dependency.cut}
        edges = tuple(Edge("contact", *p, 0.5, "9 mm apart", "cut" if frozenset(p) in cut else "used") for p in pairs)
        return replace(found, dependencies=replace(found.dependencies, edges=edges))


@pytest.fixture
def debugger() -> Debugger:
    return Debugger(SESSION, None, ThreeBoxes)


def order(debugger: Debugger) -> tuple[int, ...]:
    graph = debugger.workspace.work.problem.dependencies
    return graph.order


def test_moving_gives_an_order_that_the_session_keeps(debugger: Debugger) -> None:
    first, second, third = order(debugger)
    debugger.carry_out([c.RunUntil("end"), MoveInOrder(first, 1)])
    assert order(debugger) == (second, first, third)
    assert debugger.workspace.run.length == 0
    kept = debugger.workspace.session.dependency.order
    assert kept == ((f"#{second}",), (f"#{first}",), (f"#{third}",))
    again = Debugger(debugger.workspace.session, None, ThreeBoxes)
    assert order(again) == order(debugger)
    # The run follows it.
    debugger.carry_out([c.RunUntil("end")])
    assert debugger.workspace.run.iterations[0].instance_id == second


def test_cutting_and_restoring(debugger: Debugger) -> None:
    debugger.carry_out([CutDependency(1, 0), CutDependency(1, 2)])
    assert debugger.workspace.session.dependency.cut == ((0, 1), (1, 2))
    debugger.carry_out([CutDependency(0, 1), CutDependency(2, 1, False)])
    assert debugger.workspace.session.dependency.cut == ((0, 1),)


def test_what_was_done_can_be_repeated(debugger: Debugger) -> None:
    ids = order(debugger)
    debugger.carry_out(
        [c.Step(), CutDependency(0, 1), MoveInOrder(ids[2], -1), c.RunUntil("end"), c.Seek(1), MoveInOrder(ids[0], 1)]
    )
    again = Debugger(SESSION, None, ThreeBoxes).carry_out(from_json(to_json(x)) for x in debugger.log)
    assert again.workspace.session == debugger.workspace.session
    assert (
        first_difference(again.workspace.work.problem.dependencies, debugger.workspace.work.problem.dependencies)
        is None
    )
    assert first_difference(again.workspace.run.iterations, debugger.workspace.run.iterations) is None


def test_what_cannot_be_done_is_said_and_changes_nothing(debugger: Debugger) -> None:
    before, ids = debugger.workspace.run, order(debugger)
    for command, said in (
        (CutDependency(0, 2), "unknown pair of instances '#0 and #2'; available: #0 and #1, #1 and #2"),
        (MoveInOrder(9, 1), "unknown instance 9"),
        (MoveInOrder(0, 2), "one place at a time"),
        (MoveInOrder(ids[0], -1), "is first in the order already"),
        (MoveInOrder(ids[-1], 1), "is last in the order already"),
    ):
        with pytest.raises(InputError, match=re.escape(said)):
            debugger.apply(command)
        assert debugger.workspace.run is before, said
        assert debugger.log == [], said


def test_a_frame_whose_order_nobody_looked_at() -> None:
    plain = Debugger(SESSION, None, FakeTools)
    with pytest.raises(InputError, match="is unknown"):
        plain.apply(MoveInOrder(0, 1))
    plain.apply(c.OpenFrame("0/2"))
    assert "No dependencies known." in order_html(plain.view(deep=False))


CLUSTERS = st.permutations(range(6)).flatmap(
    lambda ids: st.lists(st.integers(1, 5), max_size=4).map(
        lambda ends: tuple(
            tuple(ids[a:b]) for a, b in zip([0, *sorted(set(ends))], [*sorted(set(ends)), 6], strict=True)
        )
    )
)


@given(CLUSTERS, st.integers(0, 5), st.sampled_from((-1, 1)))
def test_a_move_keeps_every_cluster_together_and_can_be_taken_back(clusters: Any, instance_id: int, by: int) -> None:
    found = moved(clusters, instance_id, by)
    flat = [i for cluster in clusters for i in cluster]
    if found is None:
        k = next(k for k, cluster in enumerate(clusters) if instance_id in cluster)
        assert instance_id == clusters[k][0 if by < 0 else -1]
        assert k == (0 if by < 0 else len(clusters) - 1)
        return
    assert {frozenset(cluster) for cluster in found} == {frozenset(cluster) for cluster in clusters}
    now = [i for cluster in found for i in cluster]
    assert (now.index(instance_id) - flat.index(instance_id)) * by > 0
    if [set(x) for x in found] == [set(x) for x in clusters]:
        assert moved(found, instance_id, -by) == clusters


def test_objects_are_named_by_class_where_that_is_enough() -> None:
    problem = FakeTools(SESSION).problem("0/2")
    assert entries(problem, ((1,), (0,))) == (("#1",), ("#0",))
    one = replace(problem, instances=problem.instances[:1])
    assert entries(one, ((0,),)) == ((1,),)


def test_the_picture_names_every_object_and_labels_every_edge() -> None:
    svg = picture(GRAPH, {i: Node(name, (200, 100, 0), i == 2) for i, name in NAMES.items()})
    root = ElementTree.fromstring(svg)
    said = ["".join(e.itertext()) for e in root.iter("text")]
    assert [t for t in said if t in NAMES.values()] == ["cereal", "can", "duck", "mug"]
    assert {"carries 64%", "hides 22 mm"} <= set(said)
    commands = [from_json(e.attrib["data-cmd"]) for e in root.iter() if "data-cmd" in e.attrib]
    assert [x.instance_id for x in commands if isinstance(x, c.Focus)] == [3, 1, 2, 4]
    moves = [(x.instance_id, x.by) for x in commands if isinstance(x, MoveInOrder)]
    assert len(moves) == 6  # no way up from the first, nor down from the last
    assert (3, -1) not in moves
    assert (4, 1) not in moves


@given(st.integers(1, 9), st.data())
def test_any_graph_can_be_drawn_without_labels_that_overlap(n: int, data: st.DataObject) -> None:
    ids = data.draw(st.permutations(range(n)))
    pair = st.lists(st.sampled_from(ids), min_size=2, max_size=2, unique=True)
    kind, state = st.sampled_from(("contact", "occlusion", "support")), st.sampled_from(("used", "ambiguous", "cut"))
    draw = data.draw(st.lists(st.tuples(kind, pair, state), max_size=8)) if n > 1 else []
    edges = tuple(Edge(kind, *pair, 0.5, "5 mm apart", state) for kind, pair, state in draw)
    graph = DependencyGraph(edges, (tuple(ids),), tuple((i,) for i in ids), "recommended")
    root = ElementTree.fromstring(picture(graph, {i: Node(f"box {i}", (0, 0, 0)) for i in ids}))
    ys = sorted(float(e.attrib["y"]) for e in root.iter("text") if float(e.attrib["x"]) > 200)
    assert all(b - a >= 12.9 for a, b in pairwise(ys))
    assert all(0 < y < float(root.attrib["viewBox"].split()[3]) for y in ys)


def test_the_order_that_is_reported_is_the_one_of_the_run() -> None:
    for method, alone in (("rir", True), ("sir", True), ("refine", True), ("vf_breadth", False), ("vf_depth", False)):
        session = Session(title="order", method=MethodSettings(iterations=2, name=method))
        d = Debugger(session, None, ThreeBoxes).carry_out([c.Focus(0)])
        first, second, third = order(d)
        d.carry_out([MoveInOrder(first, 1), c.RunUntil("end")])
        view = d.view(deep=False)
        run = list(dict.fromkeys(i.instance_id for i in view.iterations))
        assert run == ([0, 1, 2] if alone else [second, first, third]), method
        html = order_html(view)
        assert ("Solved in the order of the frame: box #0, box #1, box #2" in html) == alone, method
        assert [int(i) for i in re.findall(r"<title>box #(\d): click", html)] == [second, first, third], method


def test_names_from_data_cannot_break_the_page() -> None:
    evil = "<script>alert(1)</script>"
    svg = picture(GRAPH, {i: Node(evil, (0, 0, 0)) for i in NAMES})
    assert "<script" not in svg
    debugger = Debugger(SESSION, None, ThreeBoxes)
    view = debugger.view(deep=False)
    bad = {k: replace(m, name=evil) for k, m in view.problem.models.items()}
    assert view.problem.dependencies is not None
    noted = replace(view.problem.dependencies, notes=(evil,))
    html = order_html(replace(view, problem=replace(view.problem, models=bad, dependencies=noted)))
    assert "<script" not in html
    assert "&lt;script" in html


def test_links_of_the_panel_change_the_order(open_page: OpenPage) -> None:
    app = open_page(SESSION, ThreeBoxes)
    ids = order(app.debugger)
    with client(app.url) as browser:
        browser.set(app.page.layout.link, to_json(MoveInOrder(ids[0], 1)) + " 1")
        until(app, lambda: order(app.debugger)[0] == ids[1])
    assert app.debugger.message == ""
    for command in (CutDependency(0, 1), ResetOrder(), MoveInOrder(7, 1)):
        app.send(command)
    app.wait_until_idle()
    assert app.debugger.message.startswith("unknown instance 7")
    assert order(app.debugger) == ids
