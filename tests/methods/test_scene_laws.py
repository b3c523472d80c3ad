"""Laws of VF_b and VF_d, on made-up scenes with stand-in parts."""

from __future__ import annotations

import itertools
from dataclasses import replace

import msgspec
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.fakes import FakeRefiner, FakeSimulator, FakeVerifier, box_problem
from verefine_viz.core.problem import DependencyGraph, Problem
from verefine_viz.core.settings import MethodSettings
from verefine_viz.methods.registry import make_method
from verefine_viz.recording.verify import first_difference
from verefine_viz.run.engine import Run


def clustered(problem: Problem, *clusters: tuple[int, ...]) -> Problem:
    return replace(problem, dependencies=DependencyGraph((), clusters, clusters, "given"))


def started(name: str, problem: Problem, **fields: object) -> Run:
    s = msgspec.convert({"name": name, "iterations": 3, **fields}, MethodSettings)
    return Run(make_method(s, FakeSimulator(), FakeRefiner(), FakeVerifier(), 3), problem)


def run_of(name: str, problem: Problem, **fields: object) -> Run:
    run = started(name, problem, **fields)
    run.finish()
    return run


def scenes_of(n_hypotheses: int, seed: int, flipped: bool) -> Problem:
    return clustered(box_problem(n_hypotheses, 3, seed), (2, 0, 1) if flipped else (0, 1, 2))


scenes = st.builds(scenes_of, st.integers(1, 4), st.integers(0, 1000), st.booleans())


@settings(max_examples=15, deadline=None)
@given(st.builds(box_problem, st.integers(1, 5), st.just(1), st.integers(0, 1000)), st.floats(0, 2))
def test_with_one_object_both_are_rir(problem: Problem, c: float) -> None:
    expected = run_of("rir", problem, exploration=c).iterations
    for name in ("vf_breadth", "vf_depth"):
        assert first_difference(expected, run_of(name, problem, exploration=c).iterations) is None


def test_without_company_every_object_is_solved_as_rir_solves_it() -> None:
    problem = box_problem(3, 3)
    expected = run_of("rir", problem).iterations
    for name in ("vf_breadth", "vf_depth"):
        alone = run_of(name, problem, carry_clusters=False).iterations
        assert first_difference(expected, alone) is None


@settings(max_examples=15, deadline=None)
@given(scenes)
def test_vf_breadth_places_what_it_solved_before(problem: Problem) -> None:
    order = problem.clusters[0]
    run = run_of("vf_breadth", problem)
    assert list(dict.fromkeys(it.instance_id for it in run.iterations)) == list(order)
    answers = {i.instance_id: best for i, best in zip(problem.instances, run.final_state.best, strict=True)}
    for it in run.iterations:
        assert [p.instance_id for p in it.placed] == list(order[: order.index(it.instance_id)])
        for p in it.placed:
            assert np.array_equal(p.T_cam_obj, answers[p.instance_id].T_cam_obj)


@settings(max_examples=15, deadline=None)
@given(scenes, st.sampled_from(["current_pass", "best_known"]), st.sampled_from(["scene", "object"]))
def test_vf_depth_passes_over_the_cluster_and_closes_each_pass_with_a_scene(
    problem: Problem, reward: str, prior: str
) -> None:
    order = problem.clusters[0]
    run = run_of("vf_depth", problem, scene_reward=reward, scene_prior=prior)
    assert [it.instance_id for it in run.iterations] == list(order) * (run.length // len(order))
    highest = 0.0
    for k, it in enumerate(run.iterations):
        slot = k % len(order)
        this_pass = run.iterations[k - slot : k + 1]
        assert it.scene_pass == k // len(order) + 1
        assert [p.instance_id for p in it.placed] == list(order[:slot])
        for p, earlier in zip(it.placed, this_pass, strict=False):
            assert np.array_equal(p.T_cam_obj, earlier.accepted_stage.T_cam_obj)
        assert (it.scene is not None) == (slot == len(order) - 1)
        if it.scene is not None:
            assert it.scene.reward == (it.scene.score if reward == "current_pass" else it.scene.best_known).score
            assert it.scene.incumbent_score >= max(highest, it.scene.score.score, it.scene.best_known.score)
            highest = it.scene.incumbent_score
    used = {i: sum(it.instance_id == i for it in run.iterations) for i in order}
    assert used == {i.instance_id: 3 * len(i.hypotheses) for i in problem.instances}


@settings(max_examples=15, deadline=None)
@given(scenes, st.floats(0.5, 1.0), st.floats(0, 2))
def test_discounted_sums_and_counts_are_those_of_the_paper(problem: Problem, discount: float, c: float) -> None:
    """The bandit of each object, computed again from the scene rewards alone (docs/methods.md 1.6)."""
    run = run_of("vf_depth", problem, discount=discount, exploration=c, scene_prior="object")
    order = problem.clusters[0]
    sums = {
        t.instance.instance_id: s.score.copy() for t, s in zip(problem.targets, run.final_state.initial, strict=True)
    }
    counts = {i: np.ones(len(s)) for i, s in sums.items()}
    for k in range(0, run.length, len(order)):
        this_pass = run.iterations[k : k + len(order)]
        for it in this_pass:
            q, n = sums[it.instance_id], counts[it.instance_id]
            ucb = q / n + c * np.sqrt(max(np.log(n.sum()), 0) / n)
            np.testing.assert_allclose(it.choice.plays, n, rtol=1e-9)
            np.testing.assert_allclose(it.choice.mean, q / n, rtol=1e-9)
            assert ucb[it.arm] >= ucb.max() - 1e-9
        closing = this_pass[-1].scene
        for it in this_pass:
            sums[it.instance_id] *= discount
            counts[it.instance_id] *= discount
            sums[it.instance_id][it.arm] += closing.reward
            counts[it.instance_id][it.arm] += 1


@settings(max_examples=15, deadline=None)
@given(scenes)
def test_the_answer_of_vf_depth_is_the_best_scene_ever_seen(problem: Problem) -> None:
    run = run_of("vf_depth", problem)
    last = run.iterations[-1].scene
    order = problem.clusters[0]
    answers = {i.instance_id: b.T_cam_obj for i, b in zip(problem.instances, run.final_state.best, strict=True)}
    for p in last.incumbent:
        assert np.array_equal(p.T_cam_obj, answers[p.instance_id])
    targets = [problem.target(i) for i in order]
    whole = FakeVerifier().score_scene(targets, np.array([[answers[i] for i in order]])).score[0]
    assert whole == last.incumbent_score
    seen = [s.score for it in run.iterations if it.scene for s in (it.scene.score, it.scene.best_known)]
    assert last.incumbent_score >= max(seen)
    per_object = run_of("vf_depth", problem, scene_answer="per_object")
    for o, best in zip(per_object.final_state.objects, per_object.final_state.best, strict=True):
        assert best.score.score == max(e.score.score for arm in o.arms for e in arm.entries)


def test_members_may_have_pools_of_different_sizes_or_none() -> None:
    problem = clustered(box_problem(4, 3), (0, 1, 2))
    a, b, c = problem.instances
    uneven = replace(problem, instances=(a, replace(b, hypotheses=b.hypotheses[:1]), replace(c, hypotheses=())))
    for name in ("vf_breadth", "vf_depth"):
        run = run_of(name, uneven)
        used = [sum(it.instance_id == i for it in run.iterations) for i in (0, 1, 2)]
        assert used == [12, 3, 0], name
        assert run.length == run.n_iterations, name
        assert run.final_state.best[2] is None
        if name == "vf_depth":
            closed = [it for it in run.iterations if it.scene]
            assert len(closed) == 12, name
            assert all([p.instance_id for p in it.scene.poses] == [0, 1] for it in closed if it.scene), name


def test_earlier_clusters_stay_if_asked_to() -> None:
    problem = clustered(box_problem(2, 3), (1, 0), (2,))
    for carry, name in itertools.product((True, False), ("vf_breadth", "vf_depth")):
        run = run_of(name, problem, carry_clusters=carry)
        later = [it for it in run.iterations if it.instance_id == 2]
        assert all([p.instance_id for p in it.placed] == ([1, 0] if carry else []) for it in later), (name, carry)


def test_a_pose_moved_by_hand_counts_in_the_company_of_the_best_scene() -> None:
    problem = clustered(box_problem(2, 3), (0, 1, 2))
    for k in (0, 1, 2, 4):
        run = started("vf_depth", problem)
        for _ in range(k):
            run.step()
        truth = problem.instances[1].T_cam_obj_gt
        before = run.state.scenes[0].incumbent_score
        fork = run.fork(k, edit=(1, 1, truth))
        assert fork.state.scenes[0].incumbent_score >= before, k
        assert np.array_equal(fork.state.best[1].T_cam_obj, truth), k
        fork.finish()
        assert fork.final_state.scenes[0].incumbent_score >= fork.state.scenes[0].incumbent_score, k


def test_a_fork_may_go_on_with_another_method() -> None:
    problem = clustered(box_problem(2, 3), (2, 0), (1,))
    for first, then in itertools.product(("rir", "vf_breadth", "vf_depth"), repeat=2):
        run = run_of(first, problem)
        s = msgspec.convert({"name": then, "iterations": 3}, MethodSettings)
        fork = run.fork(4, make_method(s, FakeSimulator(), FakeRefiner(), FakeVerifier(), 3))
        fork.finish()
        assert fork.length == fork.n_iterations == 18, (first, then)
        assert min(best.score.score for best in fork.final_state.best) >= 0.5, (first, then)
