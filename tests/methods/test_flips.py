"""Flips of promising poses: they win where colour says so, and change nothing elsewhere."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import msgspec
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.changing import replace
from tests.fakes import FakeRefiner, FakeSimulator, FakeVerifier, box_problem
from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import apply, axis_angle, inverse, transform
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.problem import Placed, Problem, Target
from verefine_viz.core.scores import Scores
from verefine_viz.core.settings import HypothesesSettings, MethodSettings, RecordingSettings, Session
from verefine_viz.evaluation.near_symmetry import flips, sought
from verefine_viz.methods.known_methods import METHODS
from verefine_viz.methods.object_method import LEAST_GAIN, Flips
from verefine_viz.methods.registry import METHOD_NAMES, make_method
from verefine_viz.recording.verify import first_difference
from verefine_viz.run.engine import Run
from verefine_viz.run.run_file import RunFile, read_run_file

HALF_TURNS = np.array([np.diag([1.0, -1, -1, 1]), np.diag([-1.0, 1, -1, 1]), np.diag([-1.0, -1, 1, 1])])
"""Of a box."""
WEIGHT = 0.2


def gap_m(target: Target, T_cam_obj: Float) -> float:
    """Mean distance of the model's points to where ground truth has them."""
    points = target.model.points
    difference = apply(T_cam_obj, points) - apply(target.instance.T_cam_obj_gt, points)
    return float(np.linalg.norm(difference, axis=1).mean())


@dataclass(frozen=True)
class Looks(FakeVerifier):
    """Depth scores a box alike after a half turn; colour, where it counts, tells the sides apart."""

    weight: float = WEIGHT

    def score(self, target: Target, Ts_cam_obj: Float, placed: Sequence[Placed] = ()) -> Scores:
        shape_m = [min(gap_m(target, T @ S) for S in (np.eye(4), *HALF_TURNS)) for T in Ts_cam_obj]
        looks_m = [gap_m(target, T) for T in Ts_cam_obj]
        value = (1 - self.weight) * np.exp(-np.array(shape_m) / 0.02) + self.weight * np.exp(-np.array(looks_m) / 0.02)
        alike = super().score(target, Ts_cam_obj, placed)
        rest = alike.depth_fit, alike.normal_fit, alike.n_pixels, alike.n_rendered, alike.counts
        return Scores(value, *rest, colour_fit=np.exp(-np.array(looks_m) / 0.02), colour_weight=self.weight)


@dataclass(frozen=True)
class ToTheShape(FakeRefiner):
    """Goes half of the way to the nearest pose that looks alike in depth, and counts its calls."""

    calls: list[int] = field(default_factory=list)

    def refine(self, target: Target, T_cam_obj: Float, fixed: Sequence[Placed] = ()) -> Float:
        self.calls.append(target.instance.instance_id)
        T_gt = target.instance.T_cam_obj_gt
        S = min((np.eye(4), *HALF_TURNS), key=lambda S: gap_m(target, T_cam_obj @ S))
        return super().refine(replace(target, instance=replace(target.instance, T_cam_obj_gt=T_gt @ S)), T_cam_obj)


def turned(problem: Problem, turns: Sequence[int | None]) -> Problem:
    """The same with the j-th hypothesis of each object after a half turn, or as it is."""

    def pool(hypotheses: Sequence[object]) -> tuple[object, ...]:
        return tuple(
            h if turns[j] is None else replace(h, T_cam_obj=h.T_cam_obj @ HALF_TURNS[turns[j]])  # pyright: ignore
            for j, h in enumerate(hypotheses)
        )

    instances = tuple(replace(i, hypotheses=pool(i.hypotheses)) for i in problem.instances)
    return replace(problem, instances=instances)


def of_box(model: ObjectModel) -> Float:
    return HALF_TURNS


def run_of(
    name: str,
    problem: Problem,
    flips: Flips | None = of_box,
    weight: float = WEIGHT,
    refiner: object = None,
    simulator: object = None,
) -> Run:
    s = msgspec.convert({"name": name, "iterations": 3}, MethodSettings)
    parts = simulator, refiner or ToTheShape(), Looks(weight=weight)
    return Run(make_method(s, *parts, 3, flips), problem)  # pyright: ignore[reportArgumentType]


def answer_gap_m(run: Run) -> float:
    state = run.finish()
    return max(gap_m(t, b.T_cam_obj) for t, b in zip(run.problem.targets, state.best, strict=True) if b)


VERIFIED = [name for name in METHOD_NAMES if METHODS[name].verifies]


def test_a_pool_that_is_turned_over_comes_right() -> None:
    problem = turned(box_problem(2, 2, seed=3), (0, 2))
    for name in VERIFIED:
        assert answer_gap_m(run_of(name, problem, None)) > 0.03, name
        run = run_of(name, problem)
        assert answer_gap_m(run) < 0.01, name
        flipped = [i for i in run.iterations if i.accepted == "flipped"]
        assert flipped, name
        for i in flipped:
            (event,) = [e for e in i.events if e.kind == "flipped"]
            assert "180°" in event.text, name
            assert not any(e.kind.startswith("kept") for e in i.events), name


def test_where_colour_does_not_count_or_nothing_is_verified_nothing_changes() -> None:
    problem = turned(box_problem(3, 2, seed=1), (0, None, 1))
    colourless = [(name, 0.0) for name in METHOD_NAMES]
    for name, weight in (*colourless, *((name, WEIGHT) for name in METHOD_NAMES if name not in VERIFIED)):
        without, with_them = run_of(name, problem, None, weight=weight), run_of(name, problem, weight=weight)
        without.finish()
        with_them.finish()
        assert first_difference(without.iterations, with_them.iterations) is None, (name, weight)


@settings(max_examples=40)
@given(st.integers(1, 4), st.integers(0, 1000))
def test_until_a_flip_wins_a_run_is_the_same(n: int, seed: int) -> None:
    """The right sides are seen from the start: no flip wins."""
    problem = box_problem(n, 1, seed)
    asked: list[ObjectModel] = []

    def counted(model: ObjectModel) -> Float:
        asked.append(model)
        return HALF_TURNS

    without, with_them = run_of("rir", problem, None), run_of("rir", problem, counted)
    without.finish()
    with_them.finish()
    assert len(asked) >= n
    assert first_difference(without.iterations, with_them.iterations) is None


@settings(max_examples=60)
@given(st.lists(st.sampled_from([None, 0, 1, 2]), min_size=1, max_size=4), st.integers(0, 1000))
def test_flips_of_promising_poses_are_scored_and_the_budget_stays(turns: list[int | None], seed: int) -> None:
    problem = turned(box_problem(len(turns), 1, seed), turns)
    calls: list[list[int]] = []
    for of in (None, of_box):
        refiner = ToTheShape()
        run = run_of("rir", problem, of, refiner=refiner)
        run.finish()
        calls.append(refiner.calls)
    assert len(calls[0]) == len(calls[1]) == 3 * len(turns)
    best = max(run.state_at(0).initial[0].score)
    for i in run.iterations:
        candidates = [s for s in (i.stage("simulated"), i.stage("refined")) if s is not None and s.score is not None]
        start = max(candidates, key=lambda s: s.score.score if s.score else 0)
        flipped = i.stage("flipped")
        highest = Looks().score(problem.targets[0], start.T_cam_obj @ HALF_TURNS).score.max()
        is_promising = i.arm_iteration == 1 or start.score.score > best
        wins = is_promising and highest - start.score.score > LEAST_GAIN * WEIGHT
        assert (flipped is not None) == (i.accepted == "flipped") == wins
        if flipped is not None:
            assert flipped.score.score == highest
        best = max(best, i.best.score.score)
        assert i.best.score.score == best


@dataclass(frozen=True)
class Faint(FakeVerifier):
    """Scores all poses alike but ground truth, which scores more by what so much correlation is worth."""

    correlation: float = 0.0

    def score(self, target: Target, Ts_cam_obj: Float, placed: Sequence[Placed] = ()) -> Scores:
        is_right = np.array([gap_m(target, T) < 1e-9 for T in Ts_cam_obj])
        value = 0.5 + WEIGHT * self.correlation * is_right
        return replace(super().score(target, Ts_cam_obj, placed), score=value, colour_weight=WEIGHT)


@dataclass(frozen=True)
class Stays:
    """A refiner that moves nothing."""

    def refine(self, target: Target, T_cam_obj: Float, fixed: Sequence[Placed] = ()) -> Float:
        return T_cam_obj


def test_a_small_gain_is_enough_for_a_small_turn_only() -> None:
    """Beyond it some hundredths of correlation are chance."""
    (instance,) = box_problem(1).instances
    s = MethodSettings(name="sir", iterations=1)
    wins = []
    for deg, correlation in ((8, 0.02), (16, 0.02), (180, 0.12), (8, -0.02), (32, 0.02), (180, 0.08)):
        turn = transform(axis_angle([0, 1, 0], np.radians(deg)), np.zeros(3))
        hypothesis = replace(instance.hypotheses[0], T_cam_obj=instance.T_cam_obj_gt @ turn)
        problem = replace(box_problem(1), instances=(replace(instance, hypotheses=(hypothesis,)),))
        back = inverse(turn)[None]
        method = make_method(s, None, Stays(), Faint(correlation=correlation), 3, lambda model, back=back: back)
        wins.append(Run(method, problem).step().accepted == "flipped")
    assert wins == [True] * 3 + [False] * 3


def test_stepping_rewinding_and_forks_agree() -> None:
    problem = turned(box_problem(2, 2, seed=5), (0, None))
    for name in METHOD_NAMES:
        headless, stepped = (run_of(name, problem, simulator=FakeSimulator()) for _ in range(2))
        headless.finish()
        while not stepped.at_end:
            stepped.step()
            fork = stepped.fork(stepped.cursor // 2)
            fork.finish()
            assert first_difference(headless.iterations, fork.iterations) is None, name
        assert first_difference(headless.iterations, stepped.iterations) is None, name


def test_the_flips_of_the_search_are_those_of_the_box() -> None:
    """What the toolbox plugs in is as good as what is known here."""
    problem = turned(box_problem(2, 1, seed=2), (1, 1))
    found = flips(sought(problem.models[1]))
    assert answer_gap_m(run_of("rir", problem, lambda model: found)) < 0.01


def test_a_recording_has_them(tmp_path: Path, processes: None) -> None:
    problem = turned(box_problem(2, 1, seed=3), (0, 2))
    session = Session(
        hypotheses=HypothesesSettings(flips=True),
        method=MethodSettings(name="rir", iterations=3),
        recording=RecordingSettings(maps=False),
    )
    file = RunFile(tmp_path / "run.vfrun", session)
    run = Run(run_of("rir", problem).method, problem, (file,))
    run.finish()
    again = Run.from_record(read_run_file(file.path), problem)
    stages = [[s.name for s in i.stages] for i in run.iterations]
    assert [[s.name for s in i.stages] for i in again.iterations] == stages
    assert any("flipped" in names for names in stages)
    for ours, theirs in zip(run.iterations, again.iterations, strict=True):
        assert ours.accepted == theirs.accepted
        assert [s.T_cam_obj.tobytes() for s in ours.stages] == [s.T_cam_obj.tobytes() for s in theirs.stages]
        assert [e.text for e in ours.events] == [e.text for e in theirs.events]
    assert again.final_state.best[0].T_cam_obj.tobytes() == run.final_state.best[0].T_cam_obj.tobytes()
