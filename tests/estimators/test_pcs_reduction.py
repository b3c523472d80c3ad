"""Laws of the reduction of thousands of poses to a few."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from verefine_viz.core.arrays import Float
from verefine_viz.estimators.pcs_reduction import (
    best_of_bins,
    clusters_of_translations,
    euler_angles,
    medoids,
    quats_of,
    reduced,
)

seeds = st.integers(0, 2**32 - 1)
NO_SYMMETRY = np.eye(3)[None]


def poses(rng: np.random.Generator, n: int, spread_m: float = 0.05, spread_rad: float = 3.0) -> Float:
    Ts = np.tile(np.eye(4), (n, 1, 1))
    Ts[:, :3, :3] = Rotation.from_rotvec(rng.uniform(-spread_rad, spread_rad, (n, 3)) / np.sqrt(3)).as_matrix()
    Ts[:, :3, 3] = np.array([0.1, -0.05, 0.8]) + rng.normal(0, spread_m, (n, 3))
    return Ts


def apart_rad(R: Float, others: Float, symmetries: Float) -> Float:
    """Smallest angle between R and each of the others over the symmetries."""
    rest = np.einsum("ji,njk,skl->nsil", R, others, symmetries)
    return np.arccos(np.clip((np.trace(rest, axis1=2, axis2=3) - 1) / 2, -1, 1)).min(axis=1)


@given(seed=seeds, n=st.integers(0, 400), k=st.integers(1, 6), keep=st.sampled_from([0.2, 0.7, 1.0]))
@settings(max_examples=40)
def test_few_poses_each_with_the_rotation_and_the_lcp_of_a_bin_that_was_kept(
    seed: int, n: int, k: int, keep: float
) -> None:
    rng = np.random.default_rng(seed)
    Ts, lcps = poses(rng, n), rng.uniform(0, 0.5, n)
    few, scores = reduced(Ts, lcps, NO_SYMMETRY, keep, 2000, k, np.random.default_rng(0))
    assert len(few) == len(scores) <= k * k
    assert (len(few) == 0) == (n == 0)
    assert (np.diff(scores) <= 0).all()
    bins = best_of_bins(Ts, lcps)
    for T, score in zip(few, scores, strict=True):
        assert score >= keep * lcps.max()
        source = bins[lcps[bins] == score]
        assert (Ts[source, :3, :3] == T[:3, :3]).all(axis=(1, 2)).any()
    if len(few):
        low, high = Ts[:, :3, 3].min(axis=0) - 1e-12, Ts[:, :3, 3].max(axis=0) + 1e-12
        assert ((few[:, :3, 3] >= low) & (few[:, :3, 3] <= high)).all()


def test_poses_of_lcp_zero_are_none_and_few_bins_are_listed_as_they_are() -> None:
    assert len(reduced(poses(np.random.default_rng(0), 30), np.zeros(30), NO_SYMMETRY, 0.2, 100, 5,
                       np.random.default_rng(0))[0]) == 0  # fmt: skip
    rng = np.random.default_rng(0)
    Ts, lcps = poses(rng, 4), np.array([0.2, 0.4, 0.3, 0.35])
    few, scores = reduced(Ts, lcps, NO_SYMMETRY, 0.1, 2000, 5, rng)
    assert scores.tolist() == [0.4, 0.35, 0.3, 0.2]
    assert np.array_equal(few, Ts[[1, 3, 2, 0]])


@given(seed=seeds, n=st.integers(1, 300))
def test_a_bin_keeps_its_best_pose(seed: int, n: int) -> None:
    rng = np.random.default_rng(seed)
    Ts, lcps = poses(rng, n, 0.01, 0.05), rng.uniform(0, 1, n)
    angles = Rotation.from_matrix(Ts[:, :3, :3]).as_euler("ZYX", degrees=True)
    best: dict[tuple[int, ...], int] = {}
    for i in np.argsort(lcps):
        cell = (*np.floor(Ts[i, :3, 3] / 0.01).astype(int), *np.floor(angles[i] / 2).astype(int))
        best[tuple(map(int, cell))] = int(i)
    found = best_of_bins(Ts, lcps)
    assert sorted(found.tolist()) == sorted(best.values())
    assert (np.diff(lcps[found]) <= 0).all()


@given(seed=seeds)
def test_angles_and_quaternions_are_those_of_scipy(seed: int) -> None:
    rotations = Rotation.random(20, rng=np.random.default_rng(seed))
    Rs = rotations.as_matrix()
    assert np.allclose(euler_angles(Rs), rotations.as_euler("ZYX"), atol=1e-7)
    expected = rotations.as_quat(scalar_first=True)
    assert np.allclose(np.abs((quats_of(Rs) * expected).sum(axis=1)), 1)


def test_half_turns_have_quaternions_too() -> None:
    Rs = np.stack([np.diag(d).astype(float) for d in ((1, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1))])
    assert np.allclose(np.abs(quats_of(Rs)), np.eye(4))


def test_clusters_that_lie_apart_are_reported_apart() -> None:
    rng = np.random.default_rng(0)
    truth = rng.integers(0, 5, 300)
    middle = np.array([[0, 0, 1], [0.2, 0, 1], [0, 0.2, 1], [0.2, 0.2, 1], [0.1, 0.1, 1.3]])
    label = clusters_of_translations(middle[truth] + rng.normal(0, 0.005, (300, 3)), 5, rng)
    assert len(set(zip(truth.tolist(), label.tolist(), strict=True))) == 5


def test_no_more_translations_than_clusters() -> None:
    for n in (1, 3, 5):
        translations = np.repeat(np.arange(n, dtype=float)[:, None] @ np.ones((1, 3)), 4, axis=0)
        label = clusters_of_translations(translations, 5, np.random.default_rng(0))
        assert np.array_equal(label, np.repeat(np.arange(n), 4)), n


@given(seed=seeds)
@settings(max_examples=25)
def test_medoids_are_better_than_where_they_began_and_see_symmetries(seed: int) -> None:
    rng = np.random.default_rng(seed)
    # A shape that looks the same after each quarter turn about an axis that is none of x, y, z.
    axis = rng.normal(size=3)
    axis /= np.linalg.norm(axis)
    symmetries = Rotation.from_rotvec(axis * np.pi / 2 * np.arange(4)[:, None]).as_matrix()
    truth = Rotation.random(3, rng=rng).as_matrix()
    which = rng.integers(0, 3, 90)
    Rs = (
        truth[which]
        @ symmetries[rng.integers(0, 4, 90)]
        @ Rotation.from_rotvec(rng.normal(0, 0.02, (90, 3))).as_matrix()
    )
    chosen = medoids(quats_of(Rs), quats_of(symmetries), 3, np.random.default_rng(seed))
    start = np.random.default_rng(seed).choice(90, size=3, replace=False)

    def cost(indices: Float) -> float:
        return float(np.min([apart_rad(Rs[i], Rs, symmetries) for i in indices], axis=0).sum())

    assert len(chosen) == 3
    assert cost(chosen) <= cost(start) + 1e-9
    one = medoids(quats_of(Rs[which == 0]), quats_of(symmetries), 1, rng)
    if (which == 0).sum() > 1:
        assert apart_rad(Rs[which == 0][one[0]], truth[:1], symmetries)[0] < 0.1  # a quarter turn is 1.57
