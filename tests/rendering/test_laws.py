"""What must hold for any pose, whatever renders it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.rendering.conftest import MakeVerifier
from tests.rendering.witness import CAMERA, T_TORUS, cast, disturbed, target_of
from verefine_viz.core.camera import Camera
from verefine_viz.core.errors import ShapeError
from verefine_viz.core.geometry import axis_angle, transform
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.observation import Observation
from verefine_viz.core.problem import Instance, Target
from verefine_viz.core.settings import ScoreSettings
from verefine_viz.recording.verify import first_difference
from verefine_viz.rendering.cpu_verifier import CpuVerifier

MODES = ["published", "observed", "classes"]
FINITE = st.floats(-2, 2, allow_nan=False)


def perfect_target() -> Target:
    """A frame that shows nothing but the torus, exactly."""
    model = target_of().model
    depth, normals, _ = cast([(model, T_TORUS)], CAMERA)
    seen = depth > 0
    observation = Observation(CAMERA, depth, normals, None, seen, None)
    return Target(observation, Instance(0, 1, seen, np.zeros((0, 3)), (), T_TORUS), model)


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(axis=st.tuples(FINITE, FINITE, FINITE), angle=st.floats(0, np.pi), t=st.tuples(FINITE, FINITE, FINITE))
def test_scores_are_between_0_and_1(
    make: MakeVerifier, axis: tuple[float, float, float], angle: float, t: tuple[float, float, float]
) -> None:
    turn = axis_angle(axis, angle) if np.linalg.norm(axis) > 1e-6 else np.eye(3)
    for pixels in MODES:
        verifier = make(pixels=pixels)
        scores = verifier.score(target_of(), transform(turn, t)[None])
        for values in (scores.score, scores.depth_fit, scores.normal_fit):
            assert 0.0 <= values[0] <= 1.0 + 1e-6, pixels
        assert (scores.counts >= 0).all(), pixels


def test_what_is_rendered_exactly_as_observed_scores_1(make: MakeVerifier) -> None:
    for pixels in MODES:
        score = make(pixels=pixels).score(perfect_target(), T_TORUS[None])[0]
        assert score.score == pytest.approx(1.0, abs=1e-3), pixels
        assert score.counts[1:] == pytest.approx((0, 0, 0, 0), abs=2), pixels


def test_the_score_never_rises_as_the_object_moves_away_in_depth(make: MakeVerifier) -> None:
    Ts = np.stack([T_TORUS] * 12)
    Ts[:, 2, 3] += np.linspace(0, 0.03, 12)
    for pixels in MODES:
        # Along the optical axis of a distant view the outline hardly changes: only the depth term falls.
        scores = make(pixels=pixels).score(perfect_target(), Ts)
        assert (np.diff(scores.score) < 0.003).all(), pixels
        assert (np.diff(scores.depth_fit) < 1e-6).all(), pixels
        assert scores.depth_fit[-1] < 0.02, pixels


def test_beyond_both_tolerances_the_score_is_0(make: MakeVerifier) -> None:
    """A plane in front of a plane that is turned by more than the cut-off angle."""
    camera = Camera(np.array([[100.0, 0, 31.5], [0, 100, 23.5], [0, 0, 1]]), 64, 48)
    normal = np.array([np.sin(np.deg2rad(74)), 0, -np.cos(np.deg2rad(74))])
    observation = Observation(
        camera,
        np.full(camera.shape, 0.6),
        np.broadcast_to(normal, (48, 64, 3)),
        None,
        np.ones(camera.shape, bool),
        None,
    )
    model = plate()
    target = Target(observation, Instance(0, 1, np.ones(camera.shape, bool), np.zeros((0, 3)), ()), model)
    for pixels in MODES:
        scores = make(pixels=pixels).score(target, np.stack([at(0.5), at(0.579), at(0.621), at(0.7)]))
        assert scores.n_rendered.min() > 1000
        assert np.array_equal(scores.score, np.zeros(4))


def plate() -> ObjectModel:
    vertices = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    points = vertices[:1]
    return ObjectModel(9, "plate", vertices, np.array([[0, 1, 2], [0, 2, 3]]), points, points, 2.8, np.eye(4)[None])


def at(z: float) -> np.ndarray:
    return transform(np.eye(3), [0, 0, z])


def test_a_plate_scores_what_the_formula_says(make: MakeVerifier) -> None:
    """Closed form: d = 0.6 m everywhere, rendered 5 mm nearer, normals 30° apart."""
    camera = Camera(np.array([[100.0, 0, 31.5], [0, 100, 23.5], [0, 0, 1]]), 64, 48)
    normal = [0.0, -np.sin(np.pi / 6), -np.cos(np.pi / 6)]
    everywhere = np.ones(camera.shape, bool)
    observation = Observation(
        camera, np.full(camera.shape, 0.6), np.broadcast_to(normal, (48, 64, 3)), None, everywhere, None
    )
    target = Target(observation, Instance(0, 1, everywhere, np.zeros((0, 3)), ()), plate())
    for pixels in MODES:
        score = make(pixels=pixels).score(target, at(0.595)[None])[0]
        assert score.depth_fit == pytest.approx(1 - 0.005 / 0.020, abs=1e-5)
        assert score.normal_fit == pytest.approx(1 - (1 - np.cos(np.pi / 6)) / 0.707, abs=1e-5)
        assert score.score == pytest.approx((score.depth_fit + score.normal_fit) / 2, abs=1e-9)
        assert score.n_pixels == 64 * 48


def test_a_batch_gives_what_single_calls_give(make: MakeVerifier) -> None:
    target, Ts = target_of(), disturbed(9)
    for pixels in MODES:
        verifier = make(pixels=pixels)
        batch = verifier.score(target, Ts)
        for i, T in enumerate(Ts):
            single = verifier.score(target, T[None])
            if verifier.name == "cpu":
                assert single.score.tobytes() == batch.score[i : i + 1].tobytes(), pixels
                assert np.array_equal(single.counts[0], batch.counts[i]), pixels
            else:
                # Tiles of another size have another float32 projection.
                assert single.score[0] == pytest.approx(batch.score[i], abs=3e-4), pixels


def test_what_is_begun_comes_to_the_same_bits() -> None:
    """Also while other poses of another target are scored."""
    target, Ts = target_of(), disturbed(9)
    for pixels in MODES:
        verifier = CpuVerifier(ScoreSettings(simplify_mm=0, pixels=pixels))
        verifier._n_threads = 2
        begun = [verifier.begin(target, T[None]) for T in Ts]
        other = verifier.score(target_of(), Ts[::-1])
        asked = verifier.score(target, Ts)
        assert other.score.tobytes() == asked.score[::-1].tobytes(), pixels
        for k, answer in enumerate(begun):
            assert answer is not None
            assert first_difference(answer()[0], asked[k]) is None, pixels


def test_nothing_is_begun_without_a_second_processor() -> None:
    verifier = CpuVerifier(ScoreSettings(simplify_mm=0))
    verifier._n_threads = 1
    assert verifier.begin(target_of(), disturbed(1)) is None


def test_bad_poses_score_0_and_leave_the_others_alone(make: MakeVerifier) -> None:
    target, good = target_of(), disturbed(3)
    nan, behind, sideways, huge, infinite = (T_TORUS.copy() for _ in range(5))
    nan[1, 2] = np.nan
    behind[2, 3] = -0.5
    sideways[0, 3] = 3.0
    huge[0, 3] = 1e300
    infinite[2, 3] = np.inf
    bad = np.stack([nan, behind, sideways, huge, infinite])
    for pixels in MODES:
        verifier = make(pixels=pixels)
        mixed = verifier.score(target, np.concatenate([good[:2], bad, good[2:]]))
        assert np.array_equal(mixed.score[2:7], np.zeros(5)), pixels
        assert np.array_equal(mixed.n_rendered[2:7], np.zeros(5)), pixels
        alone = verifier.score(target, good)
        assert mixed.score[[0, 1, 7]] == pytest.approx(alone.score, abs=3e-4), pixels
        maps = verifier.maps(target, nan)
        assert not maps.rendered_m.any(), pixels
        assert not maps.f_d.any(), pixels


def test_no_poses_give_no_scores_and_other_shapes_are_refused(make: MakeVerifier) -> None:
    target, verifier = target_of(), make()
    assert len(verifier.score(target, np.zeros((0, 4, 4)))) == 0
    with pytest.raises(ShapeError, match="expected n×4×4"):
        verifier.score(target, np.eye(4))
    wrong = Target(target.observation, Instance(3, 1, np.ones((5, 7), bool), np.zeros((0, 3)), ()), target.model)
    with pytest.raises(ShapeError, match="the mask of instance 3 is 7×5, but the frame is 323×241"):
        verifier.score(wrong, T_TORUS[None])


def test_a_pose_cannot_hide_where_nothing_was_measured(make: MakeVerifier) -> None:
    """No depth but a sliver: what fits the sliver alone must not win."""
    target = perfect_target()
    depth = target.observation.depth_m.copy()
    rows, columns = np.nonzero(depth)
    keep = np.zeros(depth.shape, bool)
    keep[rows[:60], columns[:60]] = True
    holes = Observation(CAMERA, np.where(keep, depth, 0), target.observation.normals_cam, None, keep, None)
    mostly_unknown = Target(holes, Instance(0, 1, keep, np.zeros((0, 3)), ()), target.model)
    score = make(pixels="classes").score(mostly_unknown, T_TORUS[None])[0]
    judged = 1 - (score.counts[3] + score.counts[4]) / score.n_rendered
    assert judged < 0.1
    assert score.score == pytest.approx((score.depth_fit + score.normal_fit) / 2 * judged / 0.1)
    assert score.score < 0.3
