"""A hypothesis that a person moved is played next, and begins anew where it was put; on stand-in parts."""

from __future__ import annotations

import itertools

import msgspec
import numpy as np
import pytest

from tests.changing import replace
from tests.fakes import FakeRefiner, FakeSimulator, FakeVerifier, box_problem
from verefine_viz.core.geometry import axis_angle, transform
from verefine_viz.core.problem import DependencyGraph, Problem
from verefine_viz.core.settings import MethodSettings
from verefine_viz.methods.registry import METHOD_NAMES, make_method
from verefine_viz.recording.verify import first_difference
from verefine_viz.run.engine import Run

CHOOSING = ("rir", "even", "expl", "vf_breadth", "vf_depth")
PUT = transform(axis_angle([0, 0, 1], 0.3), [0.01, 0.02, 0.6])
"""Neither near the truth nor what any hypothesis starts with."""


def clustered(problem: Problem, *clusters: tuple[int, ...]) -> Problem:
    return replace(problem, dependencies=DependencyGraph((), clusters, clusters, "given"))


def method_of(name: str, **fields: object):  # type: ignore[no-untyped-def]
    s = msgspec.convert({"name": name, "iterations": 3, "exploration": 0.0, **fields}, MethodSettings)
    return make_method(s, FakeSimulator(), FakeRefiner(), FakeVerifier(), 3)


def stepped(name: str, problem: Problem, n: int, **fields: object) -> Run:
    run = Run(method_of(name, **fields), problem)
    for _ in range(n):
        run.step()
    return run


def test_the_next_iteration_works_on_the_moved_hypothesis_whatever_it_scores() -> None:
    for name, k in itertools.product(METHOD_NAMES, (0, 1, 2)):
        run = stepped(name, box_problem(3, 1), k)
        for arm in range(len(run.state.objects[0].arms)):
            fork = run.fork(k, edit=(0, arm, PUT))
            fork.step()
            first = fork.iterations[k]
            assert first.arm == arm, (name, k)
            assert np.array_equal(first.stages[0].T_cam_obj, PUT), (name, k)
            assert "edited" in [e.kind for e in first.events], (name, k)
            if name in CHOOSING:
                assert first.choice.arm == arm, (name, k)
                assert first.choice.reason == f"hypothesis {arm + 1}: its pose was edited and is played first"
            assert fork.state.objects[0].edited_arms == (), (name, k)


def test_the_rest_of_the_run_goes_its_usual_way_and_a_replay_repeats_it() -> None:
    problem = clustered(box_problem(3, 2), (0, 1))
    for name in METHOD_NAMES:
        run = stepped(name, problem, 2)
        instance, arm = (1, len(run.state.objects[1].arms) - 1)
        fork = run.fork(2, edit=(instance, arm, PUT))
        fork.finish()
        assert fork.length == fork.n_iterations == run.n_iterations, name
        by_hand = [i.index for i in fork.iterations if "edited" in [e.kind for e in i.events]]
        assert len(by_hand) == 1, f"{name} plays it first, once"
        again = Run(method_of(name), problem, edits=fork.edits)
        again.finish()
        assert first_difference(fork.iterations, again.iterations) is None, name
        rewound = fork.fork(5)
        rewound.finish()
        assert first_difference(fork.iterations, rewound.iterations) is None, name


def test_another_object_is_worked_on_ahead_of_its_turn_and_then_the_turns_go_on() -> None:
    problem = clustered(box_problem(2, 3), (0, 1, 2))
    for name in METHOD_NAMES:
        fork = stepped(name, problem, 1).fork(1, edit=(2, 0, PUT))
        fork.finish()
        own = [i.instance_id for i in fork.iterations]
        if name == "vf_depth":  # A pass needs its order: it comes when it is next in turn.
            assert own[:4] == [0, 1, 2, 0], name
            assert np.array_equal(fork.iterations[2].stages[0].T_cam_obj, PUT), name
        else:
            assert own[:3] == [0, 2, 0], name
            assert sorted(own[2:]) == own[2:], name
            assert np.array_equal(fork.iterations[1].stages[0].T_cam_obj, PUT), name


def test_what_went_ahead_is_judged_again_among_the_objects_that_were_solved_meanwhile() -> None:
    problem = clustered(box_problem(2, 2), (0, 1))
    fork = stepped("vf_breadth", problem, 1).fork(1, edit=(1, 0, PUT))
    fork.step()
    assert fork.state.objects[1].was_ahead
    fork.finish()
    assert not fork.final_state.objects[1].was_ahead
    last = fork.iterations[-1]
    final = fork.final_state.best[0]
    assert [p.instance_id for p in last.placed] == [0]
    assert np.array_equal(last.placed[0].T_cam_obj, final.T_cam_obj)


def test_a_moved_hypothesis_begins_anew_with_the_score_of_its_pose_as_the_first_play() -> None:
    for name in ("rir", "vf_breadth"):
        run = stepped(name, box_problem(3, 1), 4)
        arm = run.iterations[-1].arm
        before = run.state.objects[0].arms[arm]
        edited = run.fork(4, edit=(0, arm, PUT)).state.objects[0].arms[arm]
        assert before.plays > 1, name
        assert (edited.plays, edited.mean) == (1.0, edited.current.score.score), name
        assert edited.n_iterations == before.n_iterations, "iterations were spent on it all the same"


def test_a_second_play_counts_beside_the_pose_that_was_put_there() -> None:
    fork = stepped("rir", box_problem(3, 1), 3).fork(3, edit=(0, 1, PUT))
    score = fork.state.objects[0].arms[1].mean
    iteration = fork.step()
    reward = max(s.score.score for s in iteration.stages[1:] if s.score and s.name != "mixed")
    arm = fork.state.objects[0].arms[1]
    assert (arm.plays, arm.mean) == (2.0, pytest.approx((score + reward) / 2))


def test_in_passes_its_first_play_is_worth_what_that_of_any_hypothesis_is() -> None:
    problem = clustered(box_problem(2, 2), (0, 1))
    for prior in ("scene", "object"):
        run = stepped("vf_depth", problem, 0, scene_prior=prior)
        pose = run.state.objects[1].arms[0].current.T_cam_obj
        unmoved = run.fork(0, edit=(1, 0, pose)).state.objects[1].arms[0]
        assert unmoved.mean == pytest.approx(run.state.objects[1].arms[0].mean, abs=1e-12), "put where it was"


def test_the_latest_of_several_moved_hypotheses_comes_first_and_all_come() -> None:
    run = stepped("rir", box_problem(4, 1), 1)
    fork = run.fork(1, edit=(0, 2, PUT)).fork(1, edit=(0, 0, PUT)).fork(1, edit=(0, 3, PUT)).fork(1, edit=(0, 2, PUT))
    for _ in range(3):
        fork.step()
    assert [i.arm for i in fork.iterations[1:4]] == [2, 3, 0]


def test_expl_stays_with_a_pose_by_hand_that_scores_best_and_leaves_one_that_does_not() -> None:
    problem = box_problem(3, 1)
    truth = problem.instances[0].T_cam_obj_gt
    run = stepped("expl", problem, 1)
    usual = run.iterations[0].arm
    other = (usual + 1) % 3
    near = run.fork(1, edit=(0, other, truth))
    near.finish()
    assert [i.arm for i in near.iterations[1:]] == [other] * 8
    said = near.iterations[2].choice
    assert said.reason.endswith("its edited pose scored best, 1.00")
    far = run.fork(1, edit=(0, other, transform(np.eye(3), [0.5, 0, 2])))
    far.finish()
    assert [i.arm for i in far.iterations[1:]] == [other, *[usual] * 7]


def test_even_gives_every_hypothesis_its_share_all_the_same() -> None:
    fork = stepped("even", box_problem(3, 1), 1).fork(1, edit=(0, 0, PUT))
    fork.finish()
    arms = [i.arm for i in fork.iterations]
    assert arms[:2] == [0, 0]
    assert [arms.count(j) for j in range(3)] == [3, 3, 3]


def test_without_budget_a_moved_pose_is_scored_but_waits_for_nothing() -> None:
    for name in METHOD_NAMES:
        run = stepped(name, box_problem(2, 1), 0)
        run.finish()
        fork = run.fork(run.length, edit=(0, 0, PUT))
        assert fork.is_done, name
        assert fork.state.objects[0].edited_arms == (), name


def test_after_other_settings_of_the_score_the_answer_is_the_best_pose_also_among_the_first_ones() -> None:
    """The mean of an arm may fall far below its initial pose, which is the best one all the same."""
    method = method_of("rir")
    state = Run(method, box_problem(3, 1)).state
    o = state.objects[0]
    best = int(np.argmax(o.initial.score))
    fallen = tuple(replace(arm, mean=0.0 if j == best else arm.mean) for j, arm in enumerate(o.arms))
    entry = replace(o.arms[best].entries[0], T_cam_obj=transform(np.eye(3), [0.5, 0, 2]), stage="refined", iteration=1)
    fallen = tuple(replace(a, entries=(*a.entries, entry)) if j == best else a for j, a in enumerate(fallen))
    judged = method.rescored(state.with_object(0, replace(o, arms=fallen))).objects[0]
    assert judged.best.score.score == max(o.initial.score)


def test_rescored_an_edited_hypothesis_still_begins_where_it_was_put() -> None:
    fork = stepped("rir", box_problem(3, 1), 3).fork(3, edit=(0, 1, PUT))
    fork.step()
    o = method_of("rir").rescored(fork.state).objects[0]
    put, kept = o.arms[1].entries[-2:]
    assert put.stage == "edited"
    assert o.arms[1].mean == pytest.approx((put.score.score + kept.score.score) / 2)
    waiting = method_of("rir").rescored(stepped("rir", box_problem(3, 1), 3).fork(3, edit=(0, 1, PUT)).state)
    assert waiting.objects[0].edited_arms == (1,)
