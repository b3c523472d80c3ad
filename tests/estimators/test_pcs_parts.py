"""Laws of what congruent point sets are made of: bases, pairs, quads, rigid fits, counts."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import apply, transform
from verefine_viz.estimators.clouds import large_parts, spread_out, thinned
from verefine_viz.estimators.pcs import NearGrid, lcps
from verefine_viz.estimators.pcs_bases import APART, Base, best_pairing, diameter, draw_base, segment_gap
from verefine_viz.estimators.pcs_quads import DistanceTable, congruent_quads, fit_rms, fitted, rotation_of

DELTA_M = 0.0035
ALL = 2**31 - 1
seeds = st.integers(0, 2**32 - 1)


def box_cloud(rng: np.random.Generator, n: int) -> Float:
    """Points on a box of 100 × 160 × 60 mm."""
    half = np.array([0.05, 0.08, 0.03])
    points = rng.uniform(-1, 1, (n, 3)) * half
    axis = rng.integers(0, 3, n)
    points[np.arange(n), axis] = rng.choice([-1.0, 1.0], n) * half[axis]
    return points


def motion(rng: np.random.Generator) -> Float:
    return transform(Rotation.random(rng=rng).as_matrix(), rng.uniform(-0.5, 0.5, 3))


@given(seed=seeds)
def test_a_base_is_wide_flat_and_joined_across(seed: int) -> None:
    rng = np.random.default_rng(seed)
    cloud = box_cloud(rng, 400)
    longest = diameter(cloud)
    base = draw_base(cloud, longest, DELTA_M, rng)
    p = base.points
    assert all((cloud == corner).all(axis=1).any() for corner in p)
    for i, j in zip(*np.triu_indices(4, 1), strict=True):
        assert np.linalg.norm(p[i] - p[j]) <= longest
    # Each of the four is the fourth point or a corner of the triangle: someone is far from all others.
    between = np.linalg.norm(p[:, None] - p[None], axis=2) + np.eye(4)
    assert between.min(axis=1).max() >= APART * longest
    centred = p - p.mean(axis=0)
    assert np.linalg.svd(centred)[1][2] <= 2 * DELTA_M  # off the best plane, all together
    meet = p[0] + base.r1 * (p[1] - p[0]), p[2] + base.r2 * (p[3] - p[2])
    assert np.linalg.norm(meet[0] - meet[1]) <= DELTA_M
    assert 0 < base.r1 < 1
    assert 0 < base.r2 < 1


def test_no_base_is_larger_than_the_model() -> None:
    rng = np.random.default_rng(0)
    cloud = np.concatenate([box_cloud(rng, 400), box_cloud(rng, 40) + np.array([0, 0, 0.5])])
    for _ in range(30):
        base = draw_base(cloud, 0.2, DELTA_M, rng)
        if base is not None:
            assert diameter(base.points) <= 0.2


def test_nothing_a_point_or_a_line_has_no_base_and_no_rotation() -> None:
    for cloud in (np.zeros((0, 3)), np.zeros((50, 3)), np.linspace(0, 1, 90).reshape(30, 3)):
        assert draw_base(cloud, diameter(cloud), DELTA_M, np.random.default_rng(0)) is None
    line = np.linspace(0, 0.1, 12).reshape(4, 3)
    N, R = np.empty((4, 4)), np.empty((3, 3))
    _, root = fit_rms(line + 0.3, line, N)
    assert not rotation_of(N, root, R)


@given(seed=seeds)
def test_the_gap_of_two_segments_is_the_smallest_distance(seed: int) -> None:
    rng = np.random.default_rng(seed)
    a, b, c, d = rng.normal(size=(4, 3))
    gap, s, t = segment_gap(a, b, c, d)
    assert np.linalg.norm(a + s * (b - a) - c - t * (d - c)) == pytest.approx(gap)
    along = np.linspace(0, 1, 60)
    first, second = a + along[:, None] * (b - a), c + along[:, None] * (d - c)
    sampled = KDTree(first).query(second)[0].min()
    assert gap <= sampled + 1e-12
    assert sampled - gap < 0.1


@given(seed=seeds)
def test_pairing_and_invariants_survive_affine_maps(seed: int) -> None:
    rng = np.random.default_rng(seed)
    plane = rng.normal(size=(2, 3))
    r1, r2 = rng.uniform(0.2, 0.8, 2)
    middle, u, v = rng.normal(size=2), *rng.normal(size=(2, 2))
    flat = np.array([middle - r1 * u, middle + (1 - r1) * u, middle - r2 * v, middle + (1 - r2) * v])
    quad = flat @ plane
    moved = quad @ (np.eye(3) + 0.3 * rng.normal(size=(3, 3))) + rng.normal(size=3)
    pairing, gap, s, t = best_pairing(quad)
    pairing_moved, _, s_moved, t_moved = best_pairing(moved)
    assert gap == pytest.approx(0, abs=1e-7)
    assert pairing == pairing_moved == 0
    assert (s, t) == pytest.approx((r1, r2), abs=1e-5)
    assert (s_moved, t_moved) == pytest.approx((r1, r2), abs=1e-5)


@given(seed=seeds, n=st.integers(2, 60), length=st.floats(0.01, 0.25), tolerance=st.floats(1e-4, 0.05))
def test_pairs_of_a_length_are_those_that_comparing_all_finds(
    seed: int, n: int, length: float, tolerance: float
) -> None:
    cloud = box_cloud(np.random.default_rng(seed), n)
    found = {tuple(pair) for pair in DistanceTable.build(cloud).pairs_of_length(length, tolerance).tolist()}
    expected = {
        (i, j)
        for i in range(n)
        for j in range(i + 1, n)
        if abs(np.linalg.norm(cloud[i] - cloud[j]) - length) < tolerance
    }
    assert found == expected


@given(seed=seeds, noise_m=st.sampled_from([0.0, 1e-3, 0.02]))
def test_the_fit_is_that_of_a_singular_value_decomposition(seed: int, noise_m: float) -> None:
    rng = np.random.default_rng(seed)
    b = rng.uniform(-0.1, 0.1, (4, 3))
    b[3] = b[0] + rng.uniform(0.5, 1) * (b[1] - b[0]) + rng.uniform(0.5, 1) * (b[2] - b[0])  # coplanar, as bases are
    width_m = np.linalg.svd(b - b.mean(axis=0))[1][1]
    assume(width_m > 0.003)  # A base is the widest of many triangles; of points on a line there is no one rotation.
    T = motion(rng)
    a = apply(T, b) + rng.normal(0, noise_m, (4, 3))
    N, R = np.empty((4, 4)), np.empty((3, 3))
    rms, root = fit_rms(a, b, N)
    assert rotation_of(N, root, R)
    expected, residual = Rotation.align_vectors(a - a.mean(axis=0), b - b.mean(axis=0))
    # The root of a quartic, of which rms is a square root, is known to some hundred roundings only.
    assert rms == pytest.approx(residual / 2, abs=5e-7)
    assert np.allclose(R @ R.T, np.eye(3), atol=1e-12)
    own = np.linalg.norm((b - b.mean(axis=0)) @ R.T - (a - a.mean(axis=0)))
    assert own == pytest.approx(residual, abs=1e-6)
    if noise_m == 0 and width_m > 0.01:
        assert np.allclose(R, expected.as_matrix(), atol=1e-6)
        assert np.allclose(R, T[:3, :3], atol=1e-6)


@given(seed=seeds)
def test_the_quad_that_a_base_was_copied_from_is_found_and_its_pose_exact(seed: int) -> None:
    rng = np.random.default_rng(seed)
    model = box_cloud(rng, 80)
    T = motion(rng)
    segment = apply(T, model)
    base = draw_base(segment, diameter(segment), DELTA_M, rng)
    if base is None:
        return
    truth = [int(np.flatnonzero((segment == corner).all(axis=1))[0]) for corner in base.points]
    quads = congruent_quads(base, model, DistanceTable.build(model), DELTA_M, ALL, rng)
    Ts, of_quad = fitted(base.points, model, quads, 2 * DELTA_M)
    mine = [k for k, q in enumerate(of_quad) if quads[q].tolist() == truth]
    assert len(mine) == 1
    assert np.allclose(Ts[mine[0]], T, atol=1e-6)


@given(seed=seeds)
def test_quads_are_what_comparing_all_pairs_of_pairs_finds(seed: int) -> None:
    rng = np.random.default_rng(seed)
    model, segment = box_cloud(rng, 24), box_cloud(rng, 200)
    base = draw_base(segment, diameter(segment), DELTA_M, rng)
    if base is None:
        return
    quads = congruent_quads(base, model, DistanceTable.build(model), DELTA_M, ALL, rng)
    Ts, of_quad = fitted(base.points, model, quads, 2 * DELTA_M)
    found = {tuple(quads[q].tolist()) for q in of_quad}
    assert found == set(brute_force_quads(base, model))
    for T, q in zip(Ts, of_quad, strict=True):
        residual = apply(T, model[quads[q]]) - base.points
        assert np.sqrt((residual**2).sum() / 4) < 2 * DELTA_M


def brute_force_quads(base: Base, model: Float) -> list[tuple[int, ...]]:
    """Straight from the definition: lengths and intermediate points within 2δ, residual of the fit below 2δ."""
    p, n = base.points, len(model)
    between = np.linalg.norm(model[:, None] - model[None], axis=2)

    def as_long_as(a: Float, b: Float) -> list[tuple[int, int]]:
        close = np.abs(between - np.linalg.norm(a - b)) < 2 * DELTA_M
        return [(i, j) for i in range(n) for j in range(n) if i != j and close[i, j]]

    out = []
    for i, j in as_long_as(p[0], p[1]):
        for k, m in as_long_as(p[2], p[3]):
            first = model[i] + base.r1 * (model[j] - model[i])
            second = model[k] + base.r2 * (model[m] - model[k])
            if np.linalg.norm(first - second) > 2 * DELTA_M:
                continue
            quad = model[[i, j, k, m]]
            U, S, Vt = np.linalg.svd((quad - quad.mean(axis=0)).T @ (p - p.mean(axis=0)))
            S[2] *= np.sign(np.linalg.det(U @ Vt))
            energy = ((quad - quad.mean(axis=0)) ** 2).sum() + ((p - p.mean(axis=0)) ** 2).sum()
            if np.sqrt(max(0.0, energy - 2 * S.sum()) / 4) < 2 * DELTA_M:
                out.append((i, j, k, m))
    return out


def test_no_more_quads_than_asked_for_and_each_among_all() -> None:
    rng = np.random.default_rng(3)
    model = box_cloud(rng, 150)
    base = draw_base(model, diameter(model), DELTA_M, rng)
    assert base is not None
    pairs = DistanceTable.build(model)
    everything = {tuple(q) for q in congruent_quads(base, model, pairs, DELTA_M, ALL, rng).tolist()}
    some = [tuple(q) for q in congruent_quads(base, model, pairs, DELTA_M, 50, np.random.default_rng(0)).tolist()]
    others = [tuple(q) for q in congruent_quads(base, model, pairs, DELTA_M, 50, np.random.default_rng(1)).tolist()]
    assert len(some) == len(set(some)) == len(others) == 50
    assert set(some) < everything
    assert set(others) < everything
    assert set(some) != set(others)


@given(seed=seeds, n=st.integers(1, 300), radius_m=st.sampled_from([0.001, 0.0035, 0.02]))
def test_the_common_points_are_all_counted(seed: int, n: int, radius_m: float) -> None:
    rng = np.random.default_rng(seed)
    segment, model = box_cloud(rng, n) + 0.7, box_cloud(rng, 150)
    Ts = np.stack([transform(Rotation.from_rotvec(rng.normal(0, 0.3, 3)).as_matrix(), [0.7] * 3) for _ in range(5)])
    Ts = np.concatenate([Ts, np.eye(4)[None]])
    tree = KDTree(segment)
    expected = [(tree.query(apply(T, model))[0] <= radius_m).mean() for T in Ts]
    assert np.allclose(lcps(Ts, model, NearGrid.build(segment, radius_m)), expected)


def test_a_copy_lies_on_itself() -> None:
    cloud = box_cloud(np.random.default_rng(0), 300)
    assert lcps(np.eye(4)[None], cloud, NearGrid.build(cloud, 1e-6))[0] == 1.0


@given(seed=seeds, n=st.integers(1, 500))
def test_thinning_keeps_the_mean_of_each_cell(seed: int, n: int) -> None:
    points = box_cloud(np.random.default_rng(seed), n) - 0.3
    few = thinned(points, 0.02)
    cells: dict[tuple[int, ...], list[Float]] = {}
    for point in points:
        cells.setdefault(tuple(np.floor(point / 0.02).astype(int)), []).append(point)
    assert len(few) == len(cells)
    assert np.allclose(few, [np.mean(cells[c], axis=0) for c in sorted(cells)])


def test_small_parts_that_stand_alone_are_left_out() -> None:
    rng = np.random.default_rng(0)
    body = thinned(box_cloud(rng, 20_000), 0.005)
    stray = thinned(box_cloud(rng, 60), 0.005) + np.array([0, 0, 0.4])
    both = np.concatenate([stray, body])
    assert np.array_equal(large_parts(both, 0.005, 0.1), body)
    assert np.array_equal(large_parts(both, 0.005, 0.0), both)


@given(seed=seeds, n=st.integers(1, 120))
def test_spread_points_are_each_the_farthest_from_those_before(seed: int, n: int) -> None:
    cloud = box_cloud(np.random.default_rng(seed), 100)
    kept, distances = spread_out(cloud, n)
    chosen = cloud[kept]
    assert len(chosen) == min(n, 100)
    assert distances[0] == np.inf
    for k in range(1, len(chosen)):
        from_before = KDTree(chosen[:k]).query(cloud)[0]
        assert distances[k] == pytest.approx(from_before.max())
        assert np.linalg.norm(chosen[:k] - chosen[k], axis=1).min() == pytest.approx(distances[k])
