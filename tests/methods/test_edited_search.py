"""PHYSIM-MCTS places a hypothesis that a person moved as soon as its tree allows, and completes scenes with it."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.fakes import box_problem
from tests.methods.test_physim_mcts import clustered, method_of
from tests.methods.test_search_tree import grow, pools_of
from verefine_viz.core.geometry import axis_angle, transform
from verefine_viz.methods.search_tree import SearchTree
from verefine_viz.recording.verify import first_difference
from verefine_viz.run.engine import Run

PUT = transform(axis_angle([0, 0, 1], 0.3), [0.3, 0.2, 0.9])
"""Far from the segment, so that its overlap is none and the search by itself would try it last."""


def stepped(n: int, *clusters: tuple[int, ...], n_objects: int = 3) -> Run:
    problem = clustered(box_problem(3, n_objects), *clusters)
    run = Run(method_of(problem), problem)
    for _ in range(n):
        run.step()
    return run


@settings(max_examples=30, deadline=None)
@given(st.lists(st.integers(1, 3), min_size=1, max_size=3), st.integers(0, 500), st.integers(0, 20), st.data())
def test_the_search_takes_the_shortest_way_to_where_it_can_be_placed(
    shape: list[int], seed: int, n: int, data: st.DataObject
) -> None:
    tree = grow(SearchTree(pools_of(shape, seed)), n, seed)
    level = data.draw(st.integers(0, len(shape) - 1))
    arm = data.draw(st.integers(0, shape[level] - 1))
    tree = tree.with_candidate(level, arm, np.eye(4), 0.0)
    deepest = max(node.level for node in tree.nodes if node.level <= level)
    selection = tree.select(50.0, (level, arm))
    assert len(selection.branch) - 1 == deepest, "as deep as there are nodes above the object"
    if deepest == level:
        assert selection.arm == arm
        assert selection.choices[-1] == f"hypothesis {arm + 1}: its pose was edited and is placed first"


def test_it_is_placed_next_below_what_is_placed_already() -> None:
    for instance_id in (0, 1, 2):
        run = stepped(10, (0, 1, 2))
        deep = max(node.level for node in run.state.searches[0].tree.nodes)
        fork = run.fork(10, edit=(instance_id, 1, PUT))
        while fork.state.objects[instance_id].edited_arms:
            fork.step()
        made = fork.iterations[10:]
        assert len(made) == max(1, instance_id - deep + 1), instance_id
        assert (made[-1].instance_id, made[-1].arm) == (instance_id, 1), instance_id
        assert np.array_equal(made[-1].stages[0].T_cam_obj, PUT), instance_id


def test_until_then_it_completes_every_scene() -> None:
    fork = stepped(0, (0, 1, 2)).fork(0, edit=(2, 1, PUT))
    steps = [fork.step().tree for _ in range(3)]
    assert [step.rollout_arms[-1] for step in steps[:2] if step] == [1, 1]
    assert [len(step.branch) for step in steps if step] == [2, 3, 4], "straight down to it"
    assert fork.iterations[2].instance_id == 2


def test_its_cluster_goes_ahead_once_and_a_replay_repeats_it() -> None:
    fork = stepped(2, (0,), (1, 2)).fork(2, edit=(1, 2, PUT))
    fork.finish()
    assert (fork.iterations[2].instance_id, fork.iterations[2].arm) == (1, 2)
    assert fork.iterations[3].instance_id == 0
    problem = clustered(box_problem(3, 3), (0,), (1, 2))
    again = Run(method_of(problem), problem, edits=fork.edits)
    again.finish()
    assert first_difference(fork.iterations, again.iterations) is None


def test_where_the_search_is_over_nothing_waits() -> None:
    run = stepped(0, (0,), n_objects=1)
    run.finish()
    fork = run.fork(run.length, edit=(0, 1, PUT))
    assert fork.is_done == (not fork.state.objects[0].edited_arms)
