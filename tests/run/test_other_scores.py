"""A fork that goes on with another score: nothing that was judged by the old one is weighed against the new."""

from __future__ import annotations

from dataclasses import dataclass, replace

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.fakes import FakeRefiner, FakeSimulator, FakeVerifier, box_problem
from verefine_viz.core.errors import InputError
from verefine_viz.core.problem import DependencyGraph, Problem
from verefine_viz.core.settings import MethodSettings, ScoreSettings
from verefine_viz.methods.registry import make_method
from verefine_viz.recording.verify import first_difference
from verefine_viz.run.engine import Run

STRICT = ScoreSettings(tau_m=0.001)


@dataclass(frozen=True)
class Strict(FakeVerifier):
    """Gives a tenth of what the other gives."""

    settings: ScoreSettings = STRICT

    def score(self, target, Ts_cam_obj, placed=()):  # type: ignore[no-untyped-def]
        found = super().score(target, Ts_cam_obj, placed)
        return replace(found, score=found.score / 10)


def method_of(name: str, verifier: FakeVerifier, **fields: object):  # type: ignore[no-untyped-def]
    settings = msgspec.convert({"name": name, "iterations": 3, **fields}, MethodSettings)
    return make_method(settings, FakeSimulator(), FakeRefiner(), verifier, 3)


def finished(name: str, problem: Problem, **changes: object) -> Run:
    run = Run(method_of(name, FakeVerifier()), problem, **changes)  # type: ignore[arg-type]
    run.finish()
    return run


OF_ONE_OBJECT = ("refine", "pir", "sir", "rir", "even", "expl", "vf_breadth")


@settings(max_examples=25, deadline=None)
@given(st.sampled_from(OF_ONE_OBJECT), st.integers(1, 4), st.integers(1, 2), st.integers(0, 100), st.data())
def test_everything_known_is_rescored(name: str, n: int, n_instances: int, seed: int, data: st.DataObject) -> None:
    problem = box_problem(n, n_instances, seed)
    run = finished(name, problem)
    k = data.draw(st.integers(1, run.length))
    fork = run.fork(k, method_of(name, Strict()))
    for target, o in zip(problem.targets, fork.state_at(k).objects, strict=True):
        for arm in o.arms:
            for entry in arm.entries:
                assert entry.score.score == Strict().score(target, entry.T_cam_obj[None]).score[0]
            plays = [arm.entries[0], *arm.entries[1:]]
            assert arm.mean == pytest.approx(np.mean([e.score.score for e in plays]))
            assert arm.plays == len(plays)
        known = [e.score.score for arm in o.arms for e in arm.entries]
        assert o.best.score.score in known
        if name not in ("refine", "pir"):
            assert o.best.score.score == max(known)
    fork.finish()
    assert all(i.best.score.score <= 0.1 for i in fork.iterations[k:])
    assert first_difference(fork.iterations[:k], run.iterations[:k]) is None


def test_a_session_repeats_it_whatever_was_tried_in_between() -> None:
    problem = box_problem(3)
    run = finished("rir", problem)
    strict, T = method_of("rir", Strict()), np.array(problem.instances[0].hypotheses[1].T_cam_obj)
    # Moved, then judged by another score, then back and on to the same again.
    fork = run.fork(4, edit=(0, 1, T)).fork(4, strict).fork(4, method_of("rir", FakeVerifier())).fork(4, strict)
    fork.finish()
    again = finished("rir", problem, edits=fork.edits, changes={4: strict})
    assert first_difference(fork.iterations, again.iterations) is None
    back = fork.fork(4, method_of("rir", FakeVerifier()))
    back.finish()
    moved = run.fork(4, edit=(0, 1, T))
    moved.finish()
    assert first_difference(back.iterations, moved.iterations) is None


def test_a_fork_at_the_start_is_a_run_with_the_new_score() -> None:
    problem = box_problem(3)
    fork = finished("rir", problem).fork(0, method_of("sir", Strict()))
    fork.finish()
    alone = Run(method_of("sir", Strict()), problem)
    alone.finish()
    assert first_difference(fork.iterations, alone.iterations) is None


@pytest.mark.parametrize("then", ["rir", "vf_depth"])
def test_rewards_of_whole_scenes_cannot_be_rescored(then: str) -> None:
    problem = box_problem(2, 3)
    problem = replace(problem, dependencies=DependencyGraph((), ((2, 0), (1,)), (), "given"))
    run = finished("vf_depth", problem)
    if then == "vf_depth":
        with pytest.raises(InputError, match="begin again with these settings"):
            run.fork(4, method_of(then, Strict()))
        return
    fork = run.fork(4, method_of(then, Strict()))
    fork.finish()
    assert fork.length == run.length


def test_vf_depth_takes_over_with_another_score_from_a_method_without_scenes() -> None:
    problem = box_problem(2, 2)
    problem = replace(problem, dependencies=DependencyGraph((), ((0, 1),), (), "given"))
    fork = finished("rir", problem).fork(5, method_of("vf_depth", Strict()))
    fork.finish()
    assert fork.length == fork.n_iterations
    scenes = [i.scene.reward for i in fork.iterations if i.scene is not None]
    assert scenes
    assert all(reward <= 0.1 for reward in scenes)
