"""Plausibility as a term of the score: what it adds, what it leaves alone, and the contract of runs with it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from tests.fakes import FakeVerifier, box_problem
from tests.physics.bodies import box, placed, standing, table
from tests.recording.runs import ending
from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import ShapeError
from verefine_viz.core.geometry import axis_angle
from verefine_viz.core.problem import Placed, Problem, Target
from verefine_viz.core.scores import Scores
from verefine_viz.core.settings import PhysicsSettings, ScoreSettings
from verefine_viz.page.views.pixel_maps import score_numbers
from verefine_viz.physics.plausibility import Plausibility, centre_of_mass, plausibility
from verefine_viz.recording.verify import first_difference, verify
from verefine_viz.run.engine import Run
from verefine_viz.run.plausible_verifier import PlausibleVerifier, are_comparable
from verefine_viz.run.run_file import RunFile, as_read, read_run_file
from verefine_viz.run.session_file import resolve
from verefine_viz.run.toolbox import Toolbox

BRICK = box(0.06, 0.04, 0.1)
TAU_M = 0.02
W = 0.2


@pytest.fixture(scope="module")
def colliders(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("colliders")


@pytest.fixture(scope="module")
def check(colliders: Path) -> Callable[..., Plausibility]:
    def checked(one: Placed, *others: Placed) -> Plausibility:
        return plausibility(one, others, table(), PhysicsSettings(), colliders)

    return checked


def share_at(check: Callable[..., Plausibility], height_m: float) -> float:
    """Of a brick so far above the table."""
    return check(placed(BRICK, (0, 0, 0.05 + height_m))).share(TAU_M)


def test_what_floats_or_sinks_in_has_less_the_further(
    check: Callable[..., Plausibility],
) -> None:
    assert share_at(check, 0.0) == 1
    assert share_at(check, 0.002) == pytest.approx(1, abs=1e-6), "that is touching"
    # By hand: half for the distance beyond 2 mm against 20 mm, half for being stable, which ends at 5 mm.
    shares = [share_at(check, mm * 1e-3) for mm in (4, 7, 12, 22.1, 100)]
    assert shares == pytest.approx([0.95, 0.375, 0.25, 0, 0], abs=1e-4)
    # Below the table both begin at what short heights explain: 11.57 mm of a brick as high as 100 mm.
    shares = [share_at(check, -mm * 1e-3) for mm in (4, 11.5, 13.57, 21.57, 31.7, 100)]
    assert shares == pytest.approx([1, 1, 0.45, 0.25, 0, 0], abs=1e-3)


def test_what_would_tip_has_half(check: Callable[..., Plausibility]) -> None:
    tilted = standing(BRICK, axis_angle([1, 0, 0], np.deg2rad(40)))
    assert check(tilted).share(TAU_M) == pytest.approx(0.5, abs=1e-4)


def test_a_known_centre_of_mass_changes_nothing(check: Callable[..., Plausibility], colliders: Path) -> None:
    com = centre_of_mass(BRICK, PhysicsSettings(), colliders)
    one = placed(BRICK, (0, 0, 0.053), axis_angle([1, 1, 0], 0.02))
    known = plausibility(one, (), table(), PhysicsSettings(), colliders, com_obj=com)
    assert first_difference(known, check(one)) is None


def settings_of(w: float) -> ScoreSettings:
    return ScoreSettings(plausibility_weight=w)


def by_height(one: Placed, others, support) -> float:  # type: ignore[no-untyped-def]
    """A check that can be computed by hand: 1 on the table, 0 at 10 cm; refuses what is further away."""
    height_m = float((support.T_world_cam @ one.T_cam_obj)[2, 3])
    if not abs(height_m) < 1:
        raise ShapeError("far away")
    return float(np.clip(1 - height_m / 0.1, 0, 1)) / (1 + len(others))


def around(problem: Problem, verifier=None) -> PlausibleVerifier:  # type: ignore[no-untyped-def]
    return PlausibleVerifier(verifier or FakeVerifier(settings_of(W)), by_height, PhysicsSettings())


def truth_of(target: Target) -> Float:
    assert target.instance.T_cam_obj_gt is not None
    return target.instance.T_cam_obj_gt


def shares_of(scores: Scores) -> Float:
    assert scores.plausibility is not None
    return scores.plausibility


def raised(target: Target, *heights_m: float) -> Float:
    """Ground truth moved up: in the boxes' camera −y is up."""
    out = np.repeat(truth_of(target)[None], len(heights_m), axis=0)
    out[:, 1, 3] -= heights_m
    return out


def test_the_score_is_a_mixture_and_the_fits_are_as_without_it() -> None:
    problem = box_problem()
    target = problem.targets[0]
    Ts = raised(target, 0.0, 0.01, 0.2)
    without, scores = FakeVerifier().score(target, Ts), around(problem).score(target, Ts)
    p = np.array([by_height(Placed(0, target.model, T), (), problem.observation.support) for T in Ts])
    assert 0 < p[1] < p[0]
    assert np.array_equal(scores.plausibility, p)
    np.testing.assert_allclose(scores.score, (1 - W) * without.score + W * p, atol=1e-15)
    assert np.array_equal(scores.depth_fit, without.depth_fit)
    assert (scores[1].plausibility, scores[1].plausibility_weight) == (p[1], W)
    assert score_numbers(scores[1], None).plausibility == p[1], "the page shows it"


def test_a_batch_gives_what_single_calls_give_also_when_begun() -> None:
    problem = box_problem()
    target, verifier = problem.targets[0], around(problem)
    Ts = raised(target, 0.0, 0.02, 0.03)
    together = verifier.score(target, Ts)
    assert [verifier.score(target, T[None]).score[0] for T in Ts] == together.score.tolist()
    assert verifier.begin(target, Ts) is None, "as the one inside"

    class Beginning(FakeVerifier):
        def begin(self, target, Ts_cam_obj, placed=()):  # type: ignore[no-untyped-def]
            return lambda: self.score(target, Ts_cam_obj, placed)

    begun = around(problem, Beginning(settings_of(W))).begin(target, Ts)
    assert begun is not None
    assert first_difference(begun(), together) is None


def test_of_a_scene_it_is_the_mean_each_object_among_the_others_and_itself_left_out() -> None:
    problem = box_problem(n_instances=2)
    a, b = problem.targets
    verifier, truth = around(problem), np.stack([truth_of(t) for t in (a, b)])
    alone = shares_of(verifier.score(a, truth[:1]))
    own = [Placed(t.instance.instance_id, t.model, T) for t, T in zip((a, b), truth, strict=True)]
    assert np.array_equal(verifier.score(a, truth[:1], [own[0]]).plausibility, alone)
    np.testing.assert_allclose(verifier.score(a, truth[:1], own).plausibility, alone / 2)
    scene = verifier.score_scene((a, b), truth[None])
    np.testing.assert_allclose(scene.plausibility, alone / 2)
    np.testing.assert_allclose(
        scene.score, (1 - W) * FakeVerifier().score_scene((a, b), truth[None]).score + W * alone / 2
    )


def test_what_is_not_seen_or_no_pose_has_none_and_undefined_scores_stay_0() -> None:
    problem = box_problem()
    target = problem.targets[0]

    class Half(FakeVerifier):
        """Sees nothing of the first pose, and gives NaN for the second."""

        def score(self, target, Ts_cam_obj, placed=()):  # type: ignore[no-untyped-def]
            found = super().score(target, Ts_cam_obj, placed)
            broken = np.where(np.arange(len(found)) == 1, np.nan, found.score)
            return replace(found, score=broken, n_rendered=np.array([0, 100, 100]))

    Ts = raised(target, 0.0, 0.0, 5.0)
    scores = around(problem, Half(settings_of(W))).score(target, Ts)
    assert shares_of(scores).tolist()[::2] == [0, 0]
    assert scores.score[1] == 0
    assert scores[1].undefined


def test_without_a_support_plane_there_is_no_term() -> None:
    problem = box_problem()
    floating = replace(problem, observation=replace(problem.observation, support=None))
    target = floating.targets[0]
    Ts = truth_of(target)[None]
    assert first_difference(around(floating).score(target, Ts), FakeVerifier().score(target, Ts)) is None


def test_scores_by_other_friction_are_not_compared() -> None:
    one, plain = around(box_problem()), FakeVerifier(settings_of(W))
    other = PlausibleVerifier(plain, by_height, PhysicsSettings(friction=0.2))
    assert are_comparable(one, around(box_problem()))
    assert not are_comparable(one, other)
    assert are_comparable(plain, FakeVerifier(settings_of(W)))
    assert not are_comparable(plain, FakeVerifier(settings_of(0.1)))


def session(w: float, method: str = "rir"):  # type: ignore[no-untyped-def]
    return resolve(
        {
            "scene": {"demo": "clutter"},
            "hypotheses": {"max_per_object": 2},
            "method": {"name": method, "refiner": "icp", "iterations": 2},
            "score": {"plausibility_weight": w},
        }
    )


def test_weight_0_is_the_verifier_itself_and_others_are_made_again_where_physics_changes() -> None:
    off, on = Toolbox(session(0.0)), Toolbox(session(W))
    assert not isinstance(off.verifier, PlausibleVerifier)
    assert off.changed({"physics": {"friction": 0.2}}).verifier is off.verifier
    assert isinstance(on.verifier, PlausibleVerifier)
    assert on.changed({"method": {"exploration": 0.3}}).verifier is on.verifier
    assert on.changed({"physics": {"friction": 0.2}}).verifier is not on.verifier


@cache
def two_objects() -> Problem:
    """Made once per process, which takes longer than the runs."""
    box = Toolbox(session(0.0))
    whole = box.problem(box.frames[0])
    return whole.only([i.instance_id for i in whole.instances[:2]])


@pytest.mark.usefixtures("processes", "long_run")
@pytest.mark.parametrize("method", ["rir", "vf_depth"])
def test_stepped_headless_rewound_and_replayed_are_the_same(method: str, tmp_path: Path) -> None:
    box, problem = Toolbox(session(W, method)), two_objects()
    file = RunFile(tmp_path / "run.vfrun", box.session)
    headless = box.run(problem, (file,))
    headless.finish()
    file.finish(ending(headless))
    stepped = Toolbox(session(W, method)).run(problem)
    while not stepped.at_end:
        stepped.step()
        fork = stepped.fork(stepped.cursor // 2)
        if not fork.at_end:
            fork.step()
    assert first_difference(headless.iterations, stepped.iterations) is None
    shares = [s.score.plausibility for it in headless.iterations for s in it.stages if s.score is not None]
    assert all(p is not None for p in shares)
    assert len(set(shares)) > 3
    record = read_run_file(file.path)
    assert first_difference(record.iterations, tuple(map(as_read, headless.iterations))) is None
    replayed = Run.from_record(record, problem)
    assert first_difference(replayed.state_at(0).initial, headless.state_at(0).initial) is None
    again = verify(file.path)
    assert again.difference is None
    assert again.n_compared == headless.length


@pytest.mark.usefixtures("processes", "long_run")
def test_weight_0_leaves_every_bit_of_a_run_as_it_is() -> None:
    """A run that never heard of the term: its verifier is made by hand."""
    from verefine_viz.methods.registry import make_method
    from verefine_viz.rendering.registry import make_verifier

    box, problem = Toolbox(session(0.0)), two_objects()
    run = box.run(problem)
    run.finish()
    s = box.session
    plain = make_method(s.method, box.simulator, box.refiner, make_verifier(ScoreSettings()), s.physics.steps, None)
    by_hand = Run(plain, problem)
    by_hand.finish()
    assert first_difference(run.iterations, by_hand.iterations) is None
    assert all(s.score is None or s.score.plausibility is None for it in run.iterations for s in it.stages)
