"""PHYSIM-MCTS on made-up problems: a toy with a known optimum, and what holds for every run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.fakes import FakeRefiner, FakeSimulator, FakeVerifier, box_problem
from verefine_viz.core.algorithm_settings import MctsSettings, TricpSettings
from verefine_viz.core.errors import InputError, ShapeError
from verefine_viz.core.geometry import apply, axis_angle, transform
from verefine_viz.core.observation import Observation
from verefine_viz.core.problem import DependencyGraph, Hypothesis, Placed, Problem
from verefine_viz.core.records import Iteration
from verefine_viz.core.settings import PhysicsSettings
from verefine_viz.methods.events import PHYSICS_FALL
from verefine_viz.methods.physim_mcts import (
    REFINED_BEST,
    PhysimMcts,
    SearchState,
    make_physim_mcts,
    mcts_physics,
    mcts_tricp,
    overlaps,
)
from verefine_viz.recording.verify import first_difference
from verefine_viz.refiners.registry import Identity
from verefine_viz.run.engine import Run


@dataclass(frozen=True)
class GapRenderer:
    """Costs each object its distance to ground truth in tenths of a millimetre, at most 1000, and 1000 if missing."""

    problem: Problem

    def unexplained_px(self, observation: Observation, scene: Sequence[Placed]) -> int:
        cost = 1000 * (len(self.problem.instances) - len(scene))
        for placed in scene:
            truth = self.problem.target(placed.instance_id).instance.T_cam_obj_gt
            points = placed.model.points
            gap_m = np.linalg.norm(apply(placed.T_cam_obj, points) - apply(truth, points), axis=1).mean()
            cost += min(int(gap_m * 1e4), 1000)
        return cost


def clustered(problem: Problem, *clusters: tuple[int, ...]) -> Problem:
    return replace(problem, dependencies=DependencyGraph((), clusters, (), "given"))


def method_of(problem: Problem, expansions: int = 6, **fields: object) -> PhysimMcts:
    s = msgspec.convert({"expansions": expansions, "exploration_px": 50.0, **fields}, MctsSettings)
    return make_physim_mcts(s, FakeSimulator(), FakeRefiner(), FakeVerifier(), GapRenderer(problem), 3)


def finished(problem: Problem, expansions: int = 6, **fields: object) -> Run:
    run = Run(method_of(problem, expansions, **fields), problem)
    run.finish()
    return run


@st.composite
def problems(draw: st.DrawFn) -> Problem:
    n = draw(st.integers(1, 3))
    problem = box_problem(draw(st.integers(1, 4)), n, draw(st.integers(0, 500)))
    order = tuple(draw(st.permutations(range(n))))
    cut = draw(st.integers(0, n))
    return clustered(problem, *filter(None, (order[:cut], order[cut:])))


# The toy --------------------------------------------------------------------------------------------------------------


def toy() -> Problem:
    """Two boxes; the ground-truth pose of each is the hypothesis with the smaller overlap, so greed alone misses it."""
    problem = box_problem(1, 2)
    instances = []
    for i in problem.instances:
        wrong = [i.T_cam_obj_gt @ transform(np.eye(3), t) for t in ([0.03, 0, 0], [0.05, 0.02, 0])]
        pool = [Hypothesis(T, 1.0, "toy") for T in (*wrong, i.T_cam_obj_gt)]
        # The segment lies where the first, wrong hypothesis puts the model.
        seen = apply(wrong[0], problem.models[i.obj_id].points[::2])
        instances.append(replace(i, hypotheses=tuple(pool), points_cam=seen))
    return clustered(replace(problem, instances=tuple(instances)), (0, 1))


def test_finds_the_known_optimum_of_two_objects() -> None:
    problem = toy()
    s = MctsSettings(expansions=10, exploration_px=100.0)
    method = make_physim_mcts(s, None, Identity(), FakeVerifier(), GapRenderer(problem), 3)
    run = Run(method, problem)
    run.finish()
    assert run.length == 20  # the whole tree: 4 + 4 · 4 nodes
    for target, best in zip(problem.targets, run.final_state.best, strict=True):
        assert np.array_equal(best.T_cam_obj, target.instance.T_cam_obj_gt)
        assert best.arm == 2
    first, last = run.iterations[0].tree, run.iterations[-1].tree
    assert first.cost_px > last.incumbent_cost_px == 0


def test_what_lies_below_the_better_first_object_is_searched_first() -> None:
    problem = toy()
    s = MctsSettings(expansions=5, exploration_px=20.0)
    run = Run(make_physim_mcts(s, None, Identity(), FakeVerifier(), GapRenderer(problem), 3), problem)
    run.finish()
    first = {it.tree.node.node: it.arm for it in run.iterations if it.instance_id == 0}
    below = [first[it.tree.branch[1]] for it in run.iterations if it.instance_id == 1]
    assert sorted(first.values()) == [0, 1, 2, 3]
    assert below[:4] == [2] * 4  # the ground-truth pose; nothing is left to try below it then
    assert 2 not in below[4:]


def test_that_physics_moves_an_object_far_is_no_event_of_a_search() -> None:
    problem = toy()
    s = MctsSettings(expansions=5)
    run = Run(make_physim_mcts(s, FakeSimulator(), Identity(), FakeVerifier(), GapRenderer(problem), 60), problem)
    run.finish()
    falls = [
        before.score.score - after.score.score
        for it in run.iterations
        for before, after in pairwise(it.stages)
        if after.name == "simulated" and before.score is not None and after.score is not None
    ]
    assert max(falls) > PHYSICS_FALL
    assert not any(event.kind == "physics_worse" for it in run.iterations for event in it.events)


# Every run ------------------------------------------------------------------------------------------------------------


@settings(max_examples=25)
@given(problems(), st.integers(1, 8))
def test_every_iteration_adds_one_node_and_the_incumbent_never_gets_worse(problem: Problem, expansions: int) -> None:
    run = finished(problem, expansions)
    for k, members in enumerate(problem.clusters):
        own = [it for it in run.iterations if it.tree.cluster == k]
        whole, width = 0, 1
        for i in members:
            width *= len(problem.target(i).instance.hypotheses) + 1
            whole += width
        assert len(own) == min(expansions * len(members), whole)
        assert [it.tree.node.node for it in own] == list(range(1, len(own) + 1))
        lowest = np.inf
        for it in own:
            step = it.tree
            assert step.branch[0] == 0
            assert step.branch[-1] == step.node.node
            assert step.branch[-2] == step.node.parent
            assert len(step.choices) == len(step.branch) - 1
            assert (it.instance_id, it.arm) == (step.node.instance_id, step.node.arm)
            # What is placed, the new one, and the roll-out are the cluster, in its order.
            scene = [p.instance_id for p in (*it.placed, *step.rollout)]
            scene.insert(len(it.placed), it.instance_id)
            assert scene == list(members)
            assert len(step.rollout_arms) == len(step.rollout)
            is_new = step.cost_px < lowest
            lowest = min(lowest, step.cost_px)
            assert step.incumbent_cost_px == lowest
            assert [p.instance_id for p in step.incumbent] == list(members)
            assert ("new_best_scene" in [e.kind for e in it.events]) == is_new
    assert run.n_iterations == run.length


@settings(max_examples=15)
@given(problems())
def test_records_rebuild_the_tree_and_the_answer(problem: Problem) -> None:
    run = finished(problem)
    state = run.final_state
    for k, search in enumerate(state.searches):
        own = [it.tree for it in run.iterations if it.tree.cluster == k]
        visits = np.zeros(len(search.tree.nodes))
        cost = np.zeros(len(search.tree.nodes))
        for step in own:
            visits[list(step.branch)] += 1
            cost[list(step.branch)] += step.cost_px
        assert [n.visits for n in search.tree.nodes] == visits.tolist()
        assert [n.cost_px for n in search.tree.nodes] == cost.tolist()
        for node, step in zip(search.tree.nodes[1:], own, strict=True):
            assert np.array_equal(node.T_cam_obj, step.node.T_cam_obj)
            assert (node.parent, node.arm) == (step.node.parent, step.node.arm)
        for placed in search.incumbent:
            i = [x.instance_id for x in problem.instances].index(placed.instance_id)
            assert np.array_equal(state.best[i].T_cam_obj, placed.T_cam_obj)
            assert state.best[i].iteration == run.iterations[state.best[i].iteration - 1].index


@settings(max_examples=15)
@given(problems())
def test_stages_lead_from_the_hypothesis_to_where_it_came_to_lie(problem: Problem) -> None:
    run = finished(problem)
    for it in run.iterations:
        assert [s.name for s in it.stages] == ["current", "refined", "simulated"]
        assert it.accepted == "simulated"
        assert all(s.score is not None for s in it.stages)
        hypothesis = run.problem.target(it.instance_id).instance.hypotheses[it.arm]
        assert np.array_equal(it.stages[0].T_cam_obj, hypothesis.T_cam_obj)
        assert np.array_equal(it.path.Ts_cam_obj[0], it.stage("refined").T_cam_obj)
        assert np.array_equal(it.path.T_cam_obj, it.stage("simulated").T_cam_obj)
        assert np.array_equal(it.tree.node.T_cam_obj, it.stage("simulated").T_cam_obj)
        assert it.tree.node.lcp == overlaps(run.problem.target(it.instance_id), hypothesis.T_cam_obj[None])[0]


def test_each_pool_gets_its_best_overlap_aligned_as_one_more() -> None:
    problem = box_problem(3, 2)
    state = method_of(problem).start(problem)
    for given_to, target, o in zip(problem.targets, state.problem.targets, state.objects, strict=True):
        pool = target.instance.hypotheses
        assert pool[:-1] == given_to.instance.hypotheses
        assert pool[-1].source == REFINED_BEST
        best = int(np.argmax(overlaps(given_to, np.array([h.T_cam_obj for h in pool[:-1]]))))
        assert np.array_equal(pool[-1].T_cam_obj, FakeRefiner().refine(given_to, pool[best].T_cam_obj))
        assert len(o.arms) == len(o.initial) == 4
    again = method_of(problem).start(state.problem)  # started anew from its own problem: none is added twice
    assert first_difference(again.best, state.best) is None
    assert [len(i.hypotheses) for i in again.problem.instances] == [4, 4]


@settings(max_examples=10)
@given(problems())
def test_stepping_finishing_rewinding_and_forking_are_the_same_bit_for_bit(problem: Problem) -> None:
    headless = finished(problem)
    stepped = Run(method_of(problem), problem)
    while not stepped.at_end:
        stepped.step()
        if stepped.cursor % 4 == 0:
            stepped.seek(stepped.cursor // 2)
            while stepped.cursor < stepped.length:
                stepped.step()
    assert first_difference(headless.iterations, stepped.iterations) is None
    assert first_difference(headless.final_state.best, stepped.final_state.best) is None
    fork = stepped.fork(stepped.length // 2)
    fork.finish()
    assert first_difference(headless.iterations, fork.iterations) is None


def test_clusters_have_trees_of_their_own_and_do_not_see_each_other() -> None:
    problem = clustered(box_problem(3, 3), (2, 0), (1,))
    together = finished(problem)
    alone = finished(clustered(problem.only([1]), (1,)))
    second = [it for it in together.iterations if it.tree.cluster == 1]
    assert [it.tree.cluster for it in together.iterations] == [0] * 12 + [1] * 4

    def poses(iterations: Sequence[Iteration]) -> list[object]:
        return [(it.arm, it.tree.branch, it.tree.node, it.placed) for it in iterations]

    assert first_difference(poses(second), poses(alone.iterations)) is None
    assert all(p.instance_id == 2 for it in together.iterations for p in it.placed)


# What can go wrong ----------------------------------------------------------------------------------------------------


def test_objects_and_frames_without_hypotheses_are_left_out() -> None:
    problem = box_problem(2, 3)
    instances = list(problem.instances)
    instances[1] = replace(instances[1], hypotheses=())
    problem = clustered(replace(problem, instances=tuple(instances)), (0, 1, 2))
    run = finished(problem)
    assert run.final_state.best[1] is None
    assert run.final_state.initial[1] is None
    assert {it.instance_id for it in run.iterations} == {0, 2}
    assert run.length == 3 + 9
    assert [p.instance_id for p in run.iterations[-1].tree.incumbent] == [0, 2]
    problem = box_problem(0, 2)
    run = Run(method_of(problem), problem)
    assert run.is_done
    assert run.n_iterations == 0
    with pytest.raises(InputError, match="the run is over"):
        run.step()


def test_without_a_plane_objects_are_placed_by_alignment_alone_and_it_is_said_once_each() -> None:
    problem = box_problem(2, 2)
    seen = replace(problem.observation, support=None, support_note="no plane found")
    run = finished(clustered(replace(problem, observation=seen), (0, 1)))
    assert all([s.name for s in it.stages] == ["current", "refined"] and it.path is None for it in run.iterations)
    said = [e.text for it in run.iterations for e in it.events if e.kind == "no_physics"]
    assert said == ["No simulation: no plane found"] * 2


def test_an_empty_segment_has_no_overlap_and_is_searched_all_the_same() -> None:
    problem = box_problem(3, 1)
    blind = replace(problem, instances=(replace(problem.instances[0], points_cam=np.zeros((0, 3))),))
    assert overlaps(blind.targets[0], np.eye(4)[None]).tolist() == [0.0]
    run = finished(blind)
    assert [it.arm for it in run.iterations] == [0, 1, 2, 3]


def test_a_moved_hypothesis_is_tried_from_where_it_was_put_and_a_replay_repeats_it() -> None:
    problem = clustered(box_problem(2, 2), (0, 1))
    run = finished(problem)
    T = transform(axis_angle([0, 0, 1], 0.3), problem.instances[0].hypotheses[1].T_cam_obj[:3, 3])
    fork = run.fork(2, edit=(0, 1, T))
    fork.finish()
    from_there = [it for it in fork.iterations[2:] if np.array_equal(it.stages[0].T_cam_obj, T)]
    assert from_there
    assert all((it.instance_id, it.arm) == (0, 1) for it in from_there)
    assert "edited" in [e.kind for e in from_there[0].events]
    again = Run(method_of(problem), problem, edits=fork.edits)
    again.finish()
    assert first_difference(fork.iterations, again.iterations) is None


def test_an_impossible_edit_is_said_in_one_line() -> None:
    problem = box_problem(2)
    method = method_of(problem)
    for edit, error, says in (
        ((7, 0, np.eye(4)), InputError, "unknown instance 7"),
        ((0, 9, np.eye(4)), ShapeError, "no hypothesis 10; this object has 3"),
        ((0, 0, 2 * np.eye(4)), ShapeError, "not rigid"),
    ):
        with pytest.raises(error, match=says) as caught:
            method.edit(method.start(problem), *edit)
        assert "\n" not in str(caught.value), says
    problem = box_problem(0)
    method = method_of(problem)
    with pytest.raises(InputError, match="instance 0 has no hypothesis"):
        method.edit(method.start(problem), 0, 0, np.eye(4))


def test_time_as_the_budget_ends_the_run() -> None:
    problem = clustered(box_problem(4, 3), (0, 1, 2))
    run = Run(method_of(problem, seconds=0.05), problem)
    assert run.n_iterations > 0
    while not run.is_done:
        run.step()
        assert run.n_iterations >= run.length
    spent = [s.spent_s for s in run.final_state.searches]
    assert spent[0] >= 0.05 or run.final_state.searches[0].tree.is_complete


def test_it_takes_over_from_another_method_where_that_left_its_hypotheses() -> None:
    from verefine_viz.core.settings import MethodSettings
    from verefine_viz.methods.registry import make_method

    problem = clustered(box_problem(2, 2), (0, 1))
    rir = make_method(MethodSettings(name="rir", iterations=2), FakeSimulator(), FakeRefiner(), FakeVerifier(), 3)
    run = Run(rir, problem)
    run.finish()
    fork = run.fork(run.length - 2, method=method_of(problem))
    left = fork.state.objects[0].arms
    fork.finish()
    assert fork.length == fork.n_iterations == run.length - 2 + 2 + 4
    assert isinstance(fork.final_state, SearchState)
    ours = fork.iterations[run.length - 2 :]
    assert all(
        np.array_equal(it.stages[0].T_cam_obj, left[it.arm].current.T_cam_obj) for it in ours if it.instance_id == 0
    )
    back = fork.fork(fork.length, method=rir)
    back.finish()
    assert back.is_done


def test_settings_of_its_parts() -> None:
    session = PhysicsSettings(enabled=True, steps=3, step_s=1 / 100)
    published = mcts_physics(MctsSettings(), session)
    assert published == PhysicsSettings(
        steps=60, mass_kg=10, gravity_m_s2=2, damping=0.99, friction=1, collider="hull", margin_m=1e-3, step_s=1 / 100
    )
    assert mcts_physics(MctsSettings(physics="session"), session) == session
    assert mcts_tricp(MctsSettings(trim=0.8), TricpSettings(max_passes=7)) == TricpSettings(trim=0.8, max_passes=7)


def test_overlap_is_one_where_the_segment_is_the_model_and_none_far_away() -> None:
    problem = box_problem(1)
    target = problem.targets[0]
    T = target.instance.T_cam_obj_gt
    whole = replace(target, instance=replace(target.instance, points_cam=apply(T, target.model.points)))
    away = transform(np.eye(3), [0, 0, 1]) @ T
    shares = overlaps(whole, np.array([T, away]))
    assert shares.tolist() == [1.0, 0.0]
    front = whole.model.points[:, 2] < -0.029
    half = replace(whole, instance=replace(whole.instance, points_cam=apply(T, whole.model.points[front])))
    assert front.mean() <= overlaps(half, T[None])[0] < front.mean() + 0.2
