"""Laws of the methods, on made-up problems with stand-in parts."""

from __future__ import annotations

import itertools
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import msgspec
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.fakes import FakeRefiner, FakeSimulator, FakeVerifier, box_problem
from verefine_viz.core.arrays import Float
from verefine_viz.core.problem import Placed, Problem, Target
from verefine_viz.core.settings import MethodSettings, PhysicsSettings
from verefine_viz.methods.arms import ObjectState
from verefine_viz.methods.bandit import Ucb
from verefine_viz.methods.registry import METHOD_NAMES, make_method
from verefine_viz.physics.simulator import BulletSimulator
from verefine_viz.recording.verify import first_difference
from verefine_viz.run.engine import Run


def run_of(name: str, problem: Problem, **fields: object) -> Run:
    settings = msgspec.convert({"name": name, "iterations": 3, **fields}, MethodSettings)
    method = make_method(settings, FakeSimulator(), FakeRefiner(), FakeVerifier(), 3)
    run = Run(method, problem)
    run.finish()
    return run


class Throwing(FakeRefiner):
    """Throws the object 200 m away."""

    def refine(self, target: Target, T_cam_obj: Float, fixed: Sequence[Placed] = ()) -> Float:
        T = np.array(T_cam_obj)
        T[:3, 3] += [0.0, 0.0, 200.0]
        return T


def test_a_step_out_of_reach_is_not_taken_and_the_frame_goes_on(tmp_path: Path) -> None:
    problem = box_problem(2, 2)
    simulator = BulletSimulator(PhysicsSettings(collider="hull"), tmp_path)
    for name in METHOD_NAMES:
        settings = msgspec.convert({"name": name, "iterations": 2}, MethodSettings)
        run = Run(make_method(settings, simulator, Throwing(), FakeVerifier(), 3), problem)
        run.finish()
        assert run.length == run.n_iterations, name
        stages = [stage for it in run.iterations for stage in it.stages]
        assert max(np.linalg.norm(stage.T_cam_obj[:3, 3]) for stage in stages) < 10, name
        assert "refiner_stuck" in {event.kind for it in run.iterations for event in it.events}, name


class Straying(FakeRefiner):
    """Leads away from ground truth, but for every third call, which leads back by less."""

    def refine(self, target: Target, T_cam_obj: Float, fixed: Sequence[Placed] = ()) -> Float:
        T = np.array(T_cam_obj)
        # The answer depends on the arguments only: on which centimetre the pose is in.
        T[0, 3] += -0.004 if int(np.floor(100 * T[0, 3])) % 3 == 0 else 0.011
        return T


def test_a_new_best_scores_more_than_every_pose_that_was_accepted_before() -> None:
    for name, seed in itertools.product(("refine", "pir", "sir", "rir", "phys_after"), range(4)):
        settings = msgspec.convert({"name": name, "iterations": 6}, MethodSettings)
        run = Run(make_method(settings, FakeSimulator(), Straying(), FakeVerifier(), 3), box_problem(2, 1, seed))
        run.finish()
        for k, it in enumerate(run.iterations):
            if any(event.kind == "new_best" for event in it.events):
                before = [one.accepted_stage.score for one in run.iterations[:k]]
                before += [one.stages[0].score for one in run.iterations[: k + 1]]
                assert it.best.score.score > max(score.score for score in before if score is not None), (name, seed)


problems = st.builds(box_problem, st.integers(1, 5), st.integers(1, 2), st.integers(0, 1000))


@settings(max_examples=20, deadline=None)
@given(problems, st.sampled_from(METHOD_NAMES))
def test_records_are_complete_and_consistent(problem: Problem, name: str) -> None:
    run = run_of(name, problem)
    assert [it.index for it in run.iterations] == list(range(1, run.n_iterations + 1))
    for it in run.iterations:
        assert it.stages[0].name == "current"
        assert it.accepted in [s.name for s in it.stages]
        assert all(s.score is not None for s in it.stages if s.name != "mixed")
        target = next(t for t in problem.targets if t.instance.instance_id == it.instance_id)
        assert 0 <= it.arm < len(target.instance.hypotheses)
    assert {it.instance_id for it in run.iterations} == {i.instance_id for i in problem.instances}


@settings(max_examples=20, deadline=None)
@given(problems, st.sampled_from(["sir", "rir", "even", "expl"]))
def test_best_never_falls_and_is_a_recorded_pose(problem: Problem, name: str) -> None:
    run = run_of(name, problem)
    for i, target in enumerate(problem.targets):
        own = [it for it in run.iterations if it.instance_id == target.instance.instance_id]
        values = [it.best.score.score for it in own]
        assert values == sorted(values)
        initial = run.final_state.initial[i].score
        used = initial[:1] if name == "sir" else initial
        best = run.final_state.best[i]
        assert best.score.score >= used.max()
        assert best.score.score == max([*used, *(it.accepted_stage.score.score for it in own)])
        poses = [h.T_cam_obj for h in target.instance.hypotheses] + [it.accepted_stage.T_cam_obj for it in own]
        assert any(np.array_equal(best.T_cam_obj, T) for T in poses)


@settings(max_examples=20, deadline=None)
@given(problems)
def test_pir_mixes_the_simulated_rotation_with_the_current_translation(problem: Problem) -> None:
    for it in run_of("pir", problem).iterations:
        current, simulated, mixed, refined = it.stages
        assert np.array_equal(mixed.T_cam_obj[:3, :3], simulated.T_cam_obj[:3, :3])
        assert np.array_equal(mixed.T_cam_obj[:3, 3], current.T_cam_obj[:3, 3])
        assert it.accepted == refined.name == "refined"


@settings(max_examples=20, deadline=None)
@given(problems, st.sampled_from(["full", "rotation_only"]))
def test_sir_keeps_the_better_candidate_and_the_refined_one_on_ties(problem: Problem, candidate: str) -> None:
    for it in run_of("sir", problem, sim_candidate=candidate).iterations:
        simulated, refined = it.stage("simulated" if candidate == "full" else "mixed"), it.stage("refined")
        better = refined if refined.score.score >= simulated.score.score else simulated
        assert it.accepted == better.name


def test_each_iteration_starts_where_the_arm_was_left() -> None:
    for name in METHOD_NAMES:
        problem = box_problem(3, 2)
        left: dict[tuple[int, int], np.ndarray] = {
            (i.instance_id, j): h.T_cam_obj for i in problem.instances for j, h in enumerate(i.hypotheses)
        }
        for it in run_of(name, problem).iterations:
            assert np.array_equal(it.stages[0].T_cam_obj, left[it.instance_id, it.arm]), name
            left[it.instance_id, it.arm] = it.accepted_stage.T_cam_obj


class Drifting(FakeRefiner):
    """Ends 15 mm beside the truth, so that a good pose gets worse."""

    def refine(self, target, T_cam_obj, fixed=()):  # type: ignore[no-untyped-def]
        T = np.array(super().refine(target, T_cam_obj, fixed))
        T[0, 3] += 0.015
        return T


def test_never_worse_never_goes_downhill() -> None:
    def scores(accept: str) -> list[tuple[float, float]]:
        settings = msgspec.convert({"name": "sir", "iterations": 4, "accept": accept}, MethodSettings)
        run = Run(make_method(settings, FakeSimulator(), Drifting(), FakeVerifier(), 3), box_problem(1))
        run.finish()
        return [(it.stages[0].score.score, it.accepted_stage.score.score) for it in run.iterations]

    assert all(after >= before for before, after in scores("never_worse"))
    assert any(after < before for before, after in scores("latest")), "else the law above says nothing"


@settings(max_examples=20, deadline=None)
@given(problems, st.floats(0, 2))
def test_bandit_plays_are_arms_plus_budget_and_the_choice_is_the_largest_bound(problem: Problem, c: float) -> None:
    run = run_of("rir", problem, exploration=c)
    for target in problem.targets:
        n = len(target.instance.hypotheses)
        own = [it for it in run.iterations if it.instance_id == target.instance.instance_id]
        assert len(own) == 3 * n
        for done, it in enumerate(own):
            choice = it.choice
            assert choice.plays.sum() == n + done
            assert it.arm == choice.arm == int(np.argmax(choice.ucb))
            assert np.allclose(choice.ucb, choice.mean + c * np.sqrt(np.log(n + done) / choice.plays))


def test_ucb_trace_by_hand() -> None:
    """Two arms, c = 0.1: means and plays written down by hand from the rewards in the records."""
    run = run_of("rir", box_problem(2, 1), exploration=0.1)
    plays, sums = np.ones(2), run.final_state.initial[0].score.copy()
    for it in run.iterations:
        bound = sums / plays + 0.1 * np.sqrt(np.log(plays.sum()) / plays)
        assert it.arm == int(np.argmax(bound))
        assert np.allclose(it.choice.ucb, bound, atol=1e-12)
        sums[it.arm] += max(it.stage(s).score.score for s in ("simulated", "refined"))
        plays[it.arm] += 1


def test_no_exploration_is_greedy_and_much_exploration_is_even() -> None:
    greedy = run_of("rir", box_problem(4, 1), exploration=0.0)
    for it in greedy.iterations:
        assert it.choice.mean[it.arm] == it.choice.mean.max()
    even = run_of("rir", box_problem(4, 1), exploration=1000.0)
    pulls = np.bincount([it.arm for it in even.iterations], minlength=4)
    assert pulls.tolist() == [3, 3, 3, 3]


def test_policies_of_the_ablation() -> None:
    problem = box_problem(4, 1)
    even = run_of("even", problem)
    assert np.bincount([it.arm for it in even.iterations]).tolist() == [3] * 4
    expl = run_of("expl", problem)
    best = int(np.argmax(expl.final_state.initial[0].score))
    assert {it.arm for it in expl.iterations} == {best}
    assert len(expl.iterations) == 12


def test_physics_comes_once_before_or_once_after() -> None:
    before, after = run_of("phys_before", box_problem(1)), run_of("phys_after", box_problem(1))
    assert [it.stage("simulated") is not None for it in before.iterations] == [True, False, False]
    assert [it.stage("simulated") is not None for it in after.iterations] == [False, False, True]
    assert after.iterations[-1].accepted == "simulated"
    assert np.array_equal(after.final_state.best[0].T_cam_obj, after.iterations[-1].path.T_cam_obj)


def test_an_instance_without_hypotheses_is_passed_over() -> None:
    problem = box_problem(2, 2)
    empty = replace(problem, instances=(replace(problem.instances[0], hypotheses=()), problem.instances[1]))
    run = run_of("rir", empty)
    assert run.final_state.best[0] is None
    assert run.final_state.best[1] is not None
    assert {it.instance_id for it in run.iterations} == {1}


def test_an_instance_is_solved_alike_alone_and_in_company() -> None:
    problem = box_problem(3, 2)
    for name in (n for n in METHOD_NAMES if not n.startswith("vf_")):
        runs = run_of(name, problem), run_of(name, problem.only([1]))
        together, alone = ([it for it in run.iterations if it.instance_id == 1] for run in runs)
        for a, b in zip(together, alone, strict=True):
            assert first_difference(a.stages, b.stages) is None, name
            assert first_difference(a.choice, b.choice) is None, name


def test_without_support_the_run_goes_on_and_says_so() -> None:
    problem = box_problem(2)
    observation = replace(problem.observation, support=None, support_note="no plane found")
    run = run_of("sir", replace(problem, observation=observation))
    assert all(it.path is None and it.accepted == "refined" for it in run.iterations)
    assert [e.text for e in run.iterations[0].events if e.kind == "no_physics"] == ["No simulation: no plane found"]


def state_of(plays: list[float], means: list[float]) -> ObjectState:
    problem = box_problem(len(plays))
    method = make_method(MethodSettings(name="rir"), FakeSimulator(), FakeRefiner(), FakeVerifier(), 3)
    (o,) = method.start(problem).objects
    arms = (replace(arm, plays=n, mean=m) for arm, n, m in zip(o.arms, plays, means, strict=True))
    return replace(o, arms=tuple(arms))


def test_a_hypothesis_whose_plays_count_nothing_comes_first() -> None:
    """A discount of 0 forgets all plays but the last."""
    choice = Ucb(0.7).choose(state_of([1.0, 0.0, 0.0], [0.9, 0.1, 0.2]))
    assert choice.arm == 1
    assert choice.exploration.tolist() == [0.0, np.inf, np.inf]
    assert Ucb(0.0).choose(state_of([1.0, 0.0, 0.0], [0.9, 0.1, 0.2])).arm == 0


def test_the_sentence_shows_which_sum_is_larger() -> None:
    for lead in (0.2, 0.02, 0.004, 0.0004, 0.00002):
        choice = Ucb(0.7).choose(state_of([3.0, 3.0], [0.5049, 0.5049 + lead]))
        first, second = (part.split(": ")[1] for part in choice.reason.split(" > "))
        a, b = (sum(map(float, part.split(" + "))) for part in (first, second))
        assert choice.arm == 1, lead
        assert a > b, lead


@dataclass(frozen=True)
class Alike(FakeVerifier):
    """Scores all poses nearly alike."""

    scale: float = 1.0

    def score(self, target, Ts_cam_obj, placed=()):  # type: ignore[no-untyped-def]
        found = super().score(target, Ts_cam_obj, placed)
        return replace(found, score=0.9 + self.scale * found.score)


def test_the_event_shows_which_pose_scored_better() -> None:
    for scale in (1.0, 1e-2, 1e-3):
        method = make_method(MethodSettings(name="rir"), FakeSimulator(), FakeRefiner(), Alike(scale=scale), 3)
        run = Run(method, box_problem(3))
        run.finish()
        for it in run.iterations:
            text = next(e.text for e in it.events if e.kind in ("kept_refined", "kept_simulated"))
            simulated, refined = map(float, re.findall(r"(?:simulated|refined) (\d\.\d+)", text))
            a, b = it.stage("simulated").score.score, it.stage("refined").score.score
            assert np.sign(simulated - refined) == (0 if abs(a - b) < 1e-6 else np.sign(a - b)), scale


class Foreseeing(FakeVerifier):
    """Scores what it is told of beforehand, as another thread would."""

    def begin(self, target, Ts_cam_obj, placed=()):  # type: ignore[no-untyped-def]
        scores = self.score(target, Ts_cam_obj, placed)
        return lambda: scores


@settings(max_examples=20, deadline=None)
@given(problems, st.sampled_from(METHOD_NAMES), st.sampled_from(["full", "rotation_only"]))
def test_scoring_beside_the_refiner_changes_nothing(problem: Problem, name: str, sim_candidate: str) -> None:
    chosen = msgspec.convert({"name": name, "iterations": 3, "sim_candidate": sim_candidate}, MethodSettings)
    runs = [
        Run(make_method(chosen, FakeSimulator(), FakeRefiner(), verifier, 3), problem)
        for verifier in (FakeVerifier(), Foreseeing())
    ]
    for run in runs:
        run.finish()
    assert first_difference(*(run.iterations for run in runs)) is None


def test_a_score_that_is_not_a_number_counts_as_zero() -> None:
    class Broken(FakeVerifier):
        def score(self, target, Ts_cam_obj, placed=()):  # type: ignore[no-untyped-def]
            good = super().score(target, Ts_cam_obj, placed)
            return replace(good, score=np.where(np.arange(len(good)) == 0, np.nan, good.score))

    method = make_method(MethodSettings(name="rir", iterations=3), FakeSimulator(), FakeRefiner(), Broken(), 3)
    run = Run(method, box_problem(3))
    run.finish()
    for it in run.iterations:
        assert np.isfinite(it.choice.ucb).all()
        assert it.stages[1].score.score == 0.0
