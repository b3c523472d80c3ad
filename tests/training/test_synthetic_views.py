"""Views and batches that networks are trained on; no torch needed."""

from __future__ import annotations

import numpy as np
import pytest

from verefine_viz.core.geometry import angle_between, apply
from verefine_viz.learned.depth_crops import rotation_by
from verefine_viz.rendering.rasterizer import draw_depth
from verefine_viz.training import depth_net_samples
from verefine_viz.training.depth_net_samples import (
    LARGEST_DEG,
    LARGEST_SHIFT,
    TrainingBatches,
    batch_of,
    held_out_views,
    nearest_equivalent,
    start_near,
)
from verefine_viz.training.synthetic_views import SyntheticView, draw_view
from verefine_viz.training.training_shapes import (
    DIAMETER_M,
    N_HELD_OUT,
    N_RANDOM,
    _random_object,
    draw_shape,
)

VIEWS = [draw_view((7, 0, k)) for k in range(12)]


def same(a: SyntheticView, b: SyntheticView) -> bool:
    return all(np.array_equal(getattr(a, f), getattr(b, f)) for f in ("depth_m", "mask", "T_cam_obj"))


def test_a_seed_gives_one_view() -> None:
    assert same(draw_view((7, 0, 3)), VIEWS[3])
    assert not any(same(a, b) for k, a in enumerate(VIEWS) for b in VIEWS[:k])


def test_the_sensor_measures_the_object_where_ground_truth_has_it() -> None:
    """Most measured pixels lie within noise of the model's depth: masks err, and things stand in front of it."""
    shares = []
    for view in VIEWS:
        depth_m, c = np.zeros(view.camera.shape, np.float32), view.camera
        draw_depth(view.T_cam_obj, *view.shape.mesh.arrays, c.fx, c.fy, c.cx, c.cy, depth_m)
        seen = view.mask & (view.depth_m > 0) & (depth_m > 0)
        noise_m = 0.02 * depth_m[seen] ** 2 + 0.002
        shares.append((np.abs(view.depth_m[seen] - depth_m[seen]) < noise_m).mean())
    assert np.median(shares) > 0.9
    assert min(shares) > 0.3


def test_shapes_are_centred_and_of_the_stated_size() -> None:
    for held_out in (False, True):
        for k in range(40):
            shape = draw_shape(np.random.default_rng((1, k)), held_out)
            v = shape.mesh.vertices
            assert DIAMETER_M[0] <= 2 * shape.radius_m <= DIAMETER_M[1], held_out
            np.testing.assert_allclose(v.min(axis=0) + v.max(axis=0), 0, atol=1e-9)
            distances = np.linalg.norm(shape.points[:, None] - shape.points, axis=2)
            assert 1.2 * shape.radius_m < distances.max() <= 2 * shape.radius_m * (1 + 1e-9), held_out
            assert shape.resting_weights.sum() == pytest.approx(1), held_out


def test_symmetries_leave_the_shape_as_it_is() -> None:
    n_symmetric = 0
    for k in range(60):
        shape = draw_shape(np.random.default_rng((2, k)))
        v = shape.mesh.vertices
        n_symmetric += len(shape.symmetries) > 1
        for S in shape.symmetries[:: max(1, len(shape.symmetries) // 5)]:
            nearest = np.linalg.norm((v @ S.T)[:, None] - v, axis=2).min(axis=1)
            assert nearest.max() < 1e-6 * shape.radius_m + 1e-9
    assert n_symmetric > 10


def test_no_shape_that_is_held_out_is_trained_on() -> None:
    objects = {k: _random_object(k).vertices for k in (0, N_RANDOM - N_HELD_OUT - 1, N_RANDOM - N_HELD_OUT)}
    assert len({v.tobytes() for v in objects.values()}) == 3
    assert all(np.isfinite(_random_object(k).vertices).all() for k in range(160, 175))
    assert not any(same(a, b) for a in held_out_views(2) for b in VIEWS)


def test_starts_are_within_the_stated_range() -> None:
    for k in range(300):
        view = VIEWS[k % len(VIEWS)]
        T = start_near(view, np.random.default_rng(k))
        assert angle_between(T[:3, :3], view.T_cam_obj[:3, :3]) <= np.deg2rad(LARGEST_DEG) + 1e-9
        assert np.linalg.norm(T[:3, 3] - view.T_cam_obj[:3, 3]) <= LARGEST_SHIFT * view.shape.radius_m + 1e-12
        wanted = nearest_equivalent(view, T)
        assert angle_between(T[:3, :3], wanted[:3, :3]) <= angle_between(T[:3, :3], view.T_cam_obj[:3, :3]) + 1e-9


def test_a_batch_asks_for_the_rigid_step_to_the_ground_truth() -> None:
    batch = batch_of(VIEWS, np.random.default_rng(4))
    for view, points, wanted in zip(VIEWS, batch.points, batch.wanted, strict=True):
        # The rotation that fits the points best: the step that the network should answer.
        shift = wanted.mean(axis=0) - points.mean(axis=0)
        U, _, Vt = np.linalg.svd((wanted - wanted.mean(axis=0)).T @ (points - points.mean(axis=0)))
        R = U @ np.diag([1, 1, np.sign(np.linalg.det(U @ Vt))]) @ Vt
        turned = apply(np.block([[R, np.zeros((3, 1))], [np.zeros((1, 3)), 1]]), points)
        np.testing.assert_allclose(turned - turned.mean(axis=0), wanted - wanted.mean(axis=0), atol=1e-4)
        assert np.linalg.norm(shift) < 3
        assert np.linalg.norm(points, axis=1).max() < 1.5
        assert angle_between(R, rotation_by(np.zeros(3))) < np.deg2rad(LARGEST_DEG + 1)
        assert view.shape.radius_m > 0


def test_batches_go_on_from_any_step(monkeypatch: pytest.MonkeyPatch) -> None:
    """A resumed training sees what an uninterrupted one does."""
    monkeypatch.setattr(depth_net_samples, "VIEWS_HELD", 12)
    whole, later = TrainingBatches(5, 4), TrainingBatches(5, 4, 2)
    for _ in range(2):
        whole.next()
    a, b = whole.next(), later.next()
    for field in ("crops", "points", "wanted"):
        assert np.array_equal(getattr(a, field), getattr(b, field))
