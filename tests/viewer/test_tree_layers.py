"""The search tree that records add up to, and how it is drawn."""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from verefine_viz.core.records import Best, Iteration, PlacedPose, Stage, TreeNode, TreeStep
from verefine_viz.core.scores import ZERO_SCORE
from verefine_viz.pictures.visited_tree import Node, Tree, tree_of
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.drawing.markup import carries
from verefine_viz.viewer.drawing.tree_layers import (
    MOST_ROWS,
    NARROWEST,
    WIDTH,
    Fold,
    boxes,
    layers_svg,
    nodes_table,
    tree_html,
)

T = np.eye(4)
LABELS = {0: "box", 1: "can", 2: "duck"}
COLORS = {0: (1, 2, 3), 1: (4, 5, 6)}
Visit = tuple[int | None, float]
"""(parent of the node that is added, cost): None = the branch down to the latest leaf is visited again."""


def searched(index: int, step: TreeStep) -> Iteration:
    instance = step.node.instance_id if step.node else 0
    best = Best(T, ZERO_SCORE, 0, index, "simulated")
    return Iteration(index, instance, 1, 0, 1, (Stage("current", T),), "current", best, tree=step)


def steps(visits: Sequence[tuple[int, float]], cluster: int = 0, first: int = 1) -> list[Iteration]:
    """Every visit adds a node below ``parent``; its object is the depth's."""
    parents: dict[int, int] = {}
    depth = {0: 0}
    lowest = float("inf")
    made = []
    for k, (parent, cost) in enumerate(visits, 1):
        parents[k], depth[k] = parent, depth[parent] + 1
        branch = [k]
        while branch[-1]:
            branch.append(parents[branch[-1]])
        lowest = min(lowest, cost)
        node = TreeNode(k, parent, depth[k] - 1, k % 5, 0.5, T)
        rollout = tuple(PlacedPose(i, T) for i in range(depth[k], 3))
        step = TreeStep(
            cluster, tuple(reversed(branch)), node, ("because",) * depth[k], rollout, (0,) * len(rollout), cost, (),
            lowest,
        )  # fmt: skip
        made.append(searched(first + k - 1, step))
    return made


def test_visits_and_costs_go_to_every_node_of_the_branch() -> None:
    tree = tree_of(steps([(0, 100.0), (0, 80.0), (2, 60.0), (3, 90.0)]))
    assert [(n.visits, n.cost_px) for n in tree.nodes] == [(4, 330.0), (1, 100.0), (3, 230.0), (2, 150.0), (1, 90.0)]
    assert tree.nodes[2].mean_px == pytest.approx(230 / 3)
    assert tree.branch == (0, 2, 3, 4)
    assert (tree.incumbent, tree.incumbent_px, tree.incumbent_iteration) == ((0, 2, 3), 60.0, 3)
    assert tree.costs[-1] == (4, 90.0, 60.0)
    assert [n.depth for n in tree.nodes] == [0, 1, 1, 2, 3]


def test_a_branch_that_is_visited_again_adds_no_node() -> None:
    made = steps([(0, 100.0), (1, 50.0)])
    again = TreeStep(0, (0, 1, 2), None, ("a", "b"), (), (), 40.0, (), 40.0)
    tree = tree_of([*made, searched(3, again)])
    assert len(tree.nodes) == 3
    assert [n.visits for n in tree.nodes] == [3, 3, 2]
    assert tree.incumbent_iteration == 3


def test_every_cluster_has_a_tree_of_its_own() -> None:
    made = [*steps([(0, 10.0), (1, 9.0)]), *steps([(0, 70.0)], cluster=1, first=3)]
    latest, first = tree_of(made), tree_of(made, cluster=0)
    assert (latest.cluster, len(latest.nodes), latest.incumbent_px) == (1, 2, 70.0)
    assert (first.cluster, len(first.nodes), first.incumbent_px) == (0, 3, 9.0)


def test_without_a_search_there_is_no_tree() -> None:
    assert tree_of([]) is None
    best = Best(T, ZERO_SCORE, 0, 1, "refined")
    assert tree_of([Iteration(1, 0, 1, 0, 1, (Stage("current", T),), "current", best)]) is None


visits = st.lists(st.tuples(st.integers(0, 1000), st.floats(1, 1e5)), min_size=1, max_size=60)


def grown(drawn: list[tuple[int, float]]) -> Tree:
    """A tree of three layers at most."""
    depth = {0: 0}
    made = []
    for k, (number, cost) in enumerate(drawn, 1):
        parents = [p for p in range(k) if depth[p] < 3]
        parent = parents[number % len(parents)]
        depth[k] = depth[parent] + 1
        made.append((parent, cost))
    tree = tree_of(steps(made))
    assert tree is not None
    return tree


@given(visits)
def test_a_parent_was_visited_at_least_as_often_as_its_children_together(drawn: list[tuple[int, float]]) -> None:
    tree = grown(drawn)
    assert tree.nodes[0].visits == len(drawn)
    for node in tree.nodes:
        own = 1 if node.number else 0
        assert node.visits == own + sum(tree.nodes[k].visits for k in node.children)
        assert node.cost_px >= sum(tree.nodes[k].cost_px for k in node.children) - 1e-6
    assert sorted(n.number for n in tree.below()) == list(range(1, len(tree.nodes)))
    assert tree.incumbent_px == min(cost for _, cost in drawn)


@given(visits)
def test_every_node_is_drawn_or_counted_and_no_box_is_a_sliver(drawn: list[tuple[int, float]]) -> None:
    tree = grown(drawn)
    made = boxes(tree, WIDTH, NARROWEST)
    nodes = [b.what.number for b in made if isinstance(b.what, Node)]
    folded = [n.number for b in made if isinstance(b.what, Fold) for n in b.what.nodes]
    assert sorted(nodes + folded) == list(range(1, len(tree.nodes)))
    assert {*tree.branch, *tree.incumbent} <= {0, *nodes}, "both ways are always drawn"
    # Two ways of three nodes each and a fold beside each of these are all that has to be there.
    assert min(b.width for b in made) >= min(NARROWEST, WIDTH / 8) - 1e-6
    assert max(b.x + b.width for b in made) == pytest.approx(WIDTH)


@given(visits)
def test_children_stand_below_their_parent_and_boxes_do_not_overlap(drawn: list[tuple[int, float]]) -> None:
    tree = grown(drawn)
    made = boxes(tree, WIDTH, NARROWEST)
    of_node = {b.what.number: b for b in made if isinstance(b.what, Node)}
    for box in made:
        parent = of_node.get(box.what.parent)
        if parent is not None:
            assert box.depth == parent.depth + 1
            assert parent.x - 1e-6 <= box.x <= box.x + box.width <= parent.x + parent.width + 1e-6
    for layer in {b.depth for b in made}:
        row = sorted((b for b in made if b.depth == layer), key=lambda b: b.x)
        assert all(a.x + a.width <= b.x + 1e-6 for a, b in pairwise(row))


@given(visits)
def test_what_is_folded_was_visited_no_more_than_what_is_drawn_beside_it(drawn: list[tuple[int, float]]) -> None:
    tree = grown(drawn)
    must = {*tree.branch, *tree.incumbent}
    made = boxes(tree, WIDTH, NARROWEST)
    for fold in (b.what for b in made if isinstance(b.what, Fold)):
        assert len(fold.nodes) > 1, "a single node can be drawn as well"
        assert fold.visits == sum(n.visits for n in fold.roots)
        assert fold.best.mean_px == min(n.mean_px for n in fold.nodes)
        beside = [b.what for b in made if isinstance(b.what, Node) and b.what.parent == fold.parent]
        chosen = [n.visits for n in beside if n.number not in must]
        assert min(chosen, default=10**9) >= max(n.visits for n in fold.roots)


def test_a_fold_says_how_many_and_which_is_best_and_leads_there() -> None:
    tree = tree_of(steps([(0, 50.0 + k % 97) for k in range(150)]))
    assert tree is not None
    svg = layers_svg(tree, LABELS, COLORS)
    n = 150 - len(re.findall(r">h\d", svg))
    assert f">+{n}</text>" in svg
    assert "the cheapest of them: box, hypothesis 3, 1 visit, 54 px" in svg
    assert re.search(re.escape(carries(c.Seek(102))) + f"><rect [^>]*/><text [^>]*>\\+{n}</text>", svg), (
        "nodes 1 to 5 and 98 to 101 are drawn"
    )


def test_big_trees_stay_readable_and_name_what_is_left_out_and_small_ones_are_listed() -> None:
    tree, small = (tree_of(steps([(0, 50.0 + k) for k in range(n)])) for n in (150, 5))
    assert tree is not None
    html = nodes_table(tree, LABELS, {})
    assert html.count("<tr") - 1 <= MOST_ROWS
    assert "148 more nodes" in html
    html = nodes_table(small, LABELS, {})
    assert html.count("<tr") - 1 == len(small.nodes) - 1
    assert "more nodes" not in html
    assert "<script>" not in tree_html(small, {0: "<script>alert(1)</script>"}, {})
