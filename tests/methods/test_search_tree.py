"""Laws of the search tree, on costs that are made up."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from verefine_viz.core.geometry import transform
from verefine_viz.methods.search_tree import Candidate, SearchTree

T = transform(np.eye(3), [0, 0, 1])

shapes = st.lists(st.integers(1, 4), min_size=1, max_size=3)


def pools_of(shape: list[int], seed: int) -> tuple[tuple[Candidate, ...], ...]:
    rng = np.random.default_rng(seed)
    return tuple(tuple(Candidate(T, float(lcp)) for lcp in rng.integers(0, 4, n) / 4) for n in shape)


def grow(tree: SearchTree, n: int, seed: int, exploration_px: float = 50.0) -> SearchTree:
    rng = np.random.default_rng(seed)
    for _ in range(n):
        if tree.is_complete:
            break
        s = tree.select(exploration_px)
        branch = (*s.branch, len(tree.nodes))
        tree = tree.expanded(s.branch[-1], s.arm, T).backed_up(branch, float(rng.integers(0, 1000)))
    return tree


def assert_sound(tree: SearchTree) -> None:
    """Visits and costs of a node are those of its children and one visit of its own; the root has none of its own."""
    for k, node in enumerate(tree.nodes):
        children = [tree.nodes[c] for c in node.children]
        assert node.visits == sum(c.visits for c in children) + (k > 0)
        assert node.cost_px >= sum(c.cost_px for c in children)
        assert all(c.parent == k and c.level == node.level + 1 for c in children)
        leaves_untried = node.level < len(tree.pools) and bool(tree.untried(k))
        assert node.is_closed == (not leaves_untried and all(c.is_closed for c in children))


@given(shape=shapes, seed=st.integers(0, 999), n=st.integers(0, 120), exploration_px=st.sampled_from([0.0, 50.0, 5e3]))
def test_every_expansion_adds_one_node_until_every_combination_was_placed(
    shape: list[int], seed: int, n: int, exploration_px: float
) -> None:
    tree = grow(SearchTree(pools_of(shape, seed)), n, seed, exploration_px)
    whole = sum(math.prod(shape[: k + 1]) for k in range(len(shape)))
    assert tree.n_expanded == min(n, whole)
    assert tree.is_complete == (n >= whole)
    assert tree.size(10_000) == whole
    assert tree.size(5) == min(whole, 5)
    assert tree.nodes[0].visits == tree.n_expanded
    assert_sound(tree)
    combinations = set()
    for k in range(1, len(tree.nodes)):
        arms = []
        while k:
            arms.append(tree.nodes[k].arm)
            k = tree.nodes[k].parent
        combinations.add(tuple(arms))
    assert len(combinations) == tree.n_expanded, "nothing is placed twice"


def test_five_objects_of_five_hypotheses_have_3905_nodes() -> None:
    """The paper's example (Sec. IV-A), of which it does not count the root."""
    assert SearchTree(pools_of([5] * 5, 0)).size(10_000) == (5**6 - 1) // 4 - 1 == 3905


@given(shape=shapes, seed=st.integers(0, 999), n=st.integers(0, 60))
def test_the_largest_untried_overlap_comes_first_and_the_first_of_equals(shape: list[int], seed: int, n: int) -> None:
    tree = grow(SearchTree(pools_of(shape, seed)), n, seed)
    if tree.is_complete:
        return
    s = tree.select(50.0)
    untried = tree.untried(s.branch[-1])
    pool = tree.pools[tree.nodes[s.branch[-1]].level]
    assert s.arm in untried
    largest = max(pool[a].lcp for a in untried)
    assert s.arm == next(a for a in untried if pool[a].lcp == largest)
    assert len(s.choices) == len(s.branch)
    assert s.choices[-1].startswith(f"hypothesis {s.arm + 1}: ")


@given(shape=shapes, seed=st.integers(0, 999), n=st.integers(0, 60), exploration_px=st.sampled_from([0.0, 300.0]))
def test_the_branch_follows_the_lowest_bound_among_what_is_open(
    shape: list[int], seed: int, n: int, exploration_px: float
) -> None:
    tree = grow(SearchTree(pools_of(shape, seed)), n, seed, exploration_px)
    if tree.is_complete:
        return
    branch = tree.select(exploration_px).branch
    for above, chosen in pairwise(branch):
        node = tree.nodes[above]
        assert not tree.untried(above)
        bounds = {
            c: tree.nodes[c].cost_px / tree.nodes[c].visits
            - exploration_px * np.sqrt(2 * np.log(node.visits) / tree.nodes[c].visits)
            for c in node.children
            if not tree.nodes[c].is_closed
        }
        assert bounds[chosen] == pytest.approx(min(bounds.values()))


def test_selection_by_hand() -> None:
    """Two objects with two hypotheses: four iterations written down."""
    tree = SearchTree(((Candidate(T, 0.2), Candidate(T, 0.6)), (Candidate(T, 0.5), Candidate(T, 0.1))))
    costs = iter([100.0, 400.0, 120.0, 90.0])
    taken = []
    for _ in range(4):
        s = tree.select(10.0)
        branch = (*s.branch, len(tree.nodes))
        taken.append((s.branch, s.arm))
        tree = tree.expanded(s.branch[-1], s.arm, T).backed_up(branch, next(costs))
    assert taken == [((0,), 1), ((0,), 0), ((0, 1), 0), ((0, 1), 1)]
    assert [(n.visits, n.cost_px) for n in tree.nodes] == [(4, 710.0), (3, 310.0), (1, 400.0), (1, 120.0), (1, 90.0)]
    assert tree.nodes[1].is_closed
    last = tree.select(10.0)
    assert (last.branch, last.arm) == ((0, 2), 0)
    assert last.choices == (
        "hypothesis 1: 400 − 17 px, the only one with anything left to try",
        "hypothesis 1: 50 %, largest overlap of 2 untried",
    )


def test_zero_overlaps_are_tried_like_any_others() -> None:
    tree = SearchTree(((Candidate(T, 0.0), Candidate(T, 0.0)),))
    assert tree.select(0.0).arm == 0
    assert tree.favourite(0) == 0
    assert grow(tree, 9, 0).n_expanded == 2


def test_a_tree_is_not_changed_by_what_grows_from_it() -> None:
    tree = grow(SearchTree(pools_of([3, 3], 1)), 5, 1)
    before = tree.nodes
    told = [(n.visits, n.cost_px, n.children) for n in before]
    once, again = ([(n.visits, n.cost_px, n.arm) for n in grow(tree, 4, 2).nodes] for _ in range(2))
    assert once == again
    assert len(once) == 10
    assert tree.nodes is before
    assert [(n.visits, n.cost_px, n.children) for n in tree.nodes] == told


@given(shape=shapes, seed=st.integers(0, 999), n=st.integers(0, 60), data=st.data())
def test_a_moved_hypothesis_is_tried_again_everywhere(shape: list[int], seed: int, n: int, data: st.DataObject) -> None:
    tree = grow(SearchTree(pools_of(shape, seed)), n, seed)
    level = data.draw(st.integers(0, len(shape) - 1))
    arm = data.draw(st.integers(0, shape[level] - 1))
    moved = tree.with_candidate(level, arm, transform(np.eye(3), [0, 0, 2]), 1.0)
    assert_sound(moved)
    assert moved.nodes[0].visits == tree.nodes[0].visits
    for k, node in enumerate(moved.nodes):
        if node.level == level:
            assert arm in moved.untried(k)
    whole = moved.size(100_000)
    done = grow(moved, 100_000, seed)
    assert done.is_complete
    assert done.n_expanded == whole
    assert_sound(done)
