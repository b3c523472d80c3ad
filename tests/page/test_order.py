"""The order in which objects are solved, changed from the page."""

from __future__ import annotations

import re
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.page.conftest import Posted
from tests.page.fake_tools import FakeTools
from verefine_viz.core.errors import InputError
from verefine_viz.core.problem import Edge, Problem
from verefine_viz.core.settings import MethodSettings, Session
from verefine_viz.page import protocol as p
from verefine_viz.page.reorder import Clusters, as_entries, moved
from verefine_viz.page.verbs import Debugger
from verefine_viz.page.workspace import Workspace

SESSION = Session(title="order", method=MethodSettings(iterations=1, name="vf_breadth"))


class ThreeBoxes(FakeTools):
    """One frame of three boxes; the outer two depend on the one between them."""

    def problem(self, frame: str, **_: object) -> Problem:
        return self.ordered(super().problem("0/3"))

    @property
    def frames(self) -> tuple[str, ...]:
        return ("0/1", "0/2", "0/3")

    def ordered(self, problem: Problem) -> Problem:
        ordered = super().ordered(problem)
        assert ordered.dependencies is not None
        pairs, cut = ((0, 1), (1, 2)), {frozenset(pair) for pair in self.session.dependency.cut}
        edges = tuple(Edge("contact", *q, 0.5, "9 mm apart", "cut" if frozenset(q) in cut else "used") for q in pairs)
        return replace(ordered, dependencies=replace(ordered.dependencies, edges=edges))


@pytest.fixture
def debugger() -> Debugger:
    return Debugger(Workspace(SESSION, None, ThreeBoxes), Posted())


def order(d: Debugger) -> tuple[int, ...]:
    assert d.space.problem.dependencies is not None
    return d.space.problem.dependencies.order


def test_moving_gives_an_order_that_the_run_follows_and_the_session_has(debugger: Debugger):
    first, second, third = order(debugger)
    debugger.carry_out([p.RunVerb(), p.Order(move=(first, 1))])
    assert order(debugger) == (second, first, third)
    branch = debugger.space.work.first
    assert branch.run.length == 0
    session = debugger.space.session_of(branch)
    assert session.dependency.order == ((f"#{second}",), (f"#{first}",), (f"#{third}",))
    assert order(Debugger(Workspace(session, None, ThreeBoxes))) == order(debugger)
    debugger.carry_out([p.RunVerb(branch.index)])
    assert branch.run.iterations[0].instance_id == second
    debugger.carry_out([p.Order(branch.index, reset=True)])
    assert order(debugger) == (first, second, third)


def test_cutting_and_restoring(debugger: Debugger):
    for cut, left in (((1, 0, True), {(0, 1)}), ((1, 2, True), {(0, 1), (1, 2)}), ((2, 1, False), {(0, 1)})):
        debugger.carry_out([p.Order(max(debugger.space.branches), cut=cut)])
        assert set(debugger.space.tools.session.dependency.cut) == left


def test_what_cannot_be_done_is_refused_and_changes_nothing(debugger: Debugger):
    before, ids = debugger.space.work.first.run, order(debugger)
    for verb, words in (
        (p.Order(cut=(0, 2, True)), "unknown pair of instances '#0 and #2'; available: #0 and #1, #1 and #2"),
        (p.Order(move=(9, 1)), "unknown instance 9"),
        (p.Order(move=(0, 2)), "one place at a time"),
        (p.Order(move=(ids[0], -1)), "is first in the order already"),
        (p.Order(move=(ids[-1], 1)), "is last in the order already"),
        (p.Order(drop=(1, True)), "unknown unknown object 1"),
    ):
        with pytest.raises(InputError, match=re.escape(words)):
            debugger.apply(None, verb)
        assert debugger.space.work.first.run is before, words
        assert debugger.log == [], words


CLUSTERS = st.permutations(range(6)).flatmap(
    lambda ids: st.lists(st.integers(1, 5), max_size=4).map(
        lambda ends: tuple(
            tuple(ids[a:b]) for a, b in zip([0, *sorted(set(ends))], [*sorted(set(ends)), 6], strict=True)
        )
    )
)


@given(CLUSTERS, st.integers(0, 5), st.sampled_from((-1, 1)))
def test_a_move_leaves_clusters_together_and_can_be_taken_back(clusters: Clusters, instance_id: int, by: int):
    after = moved(clusters, instance_id, by)
    flat = [i for cluster in clusters for i in cluster]
    if after is None:
        k = next(k for k, cluster in enumerate(clusters) if instance_id in cluster)
        assert instance_id == clusters[k][0 if by < 0 else -1]
        assert k == (0 if by < 0 else len(clusters) - 1)
        return
    assert {frozenset(cluster) for cluster in after} == {frozenset(cluster) for cluster in clusters}
    now = [i for cluster in after for i in cluster]
    assert (now.index(instance_id) - flat.index(instance_id)) * by > 0
    if [set(x) for x in after] == [set(x) for x in clusters]:
        assert moved(after, instance_id, -by) == clusters


def test_objects_are_named_by_class_where_that_is_enough():
    problem = FakeTools(SESSION).problem("0/2")
    assert as_entries(problem, ((1,), (0,))) == (("#1",), ("#0",))
    one = replace(problem, instances=problem.instances[:1])
    assert as_entries(one, ((0,),)) == ((1,),)
