"""Reduces thousands of poses to a few that differ: bins, k-means on translation, then k-medoids on rotation."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.cluster.vq import ClusterError, kmeans2

from verefine_viz.core.arrays import Float
from verefine_viz.core.kernels import kernel

TRANSLATION_BIN_M = 0.01
"""Poses whose translations lie in one cell of this side, and … docs/methods.md 3.2."""
EULER_BIN_RAD = np.deg2rad(2.0)
"""… whose Euler angles lie in one cell of this side, are one. docs/methods.md 3.2."""
RESTARTS = 10
"""Starts of k-means; the tightest clusters win. docs/methods.md 3.2."""
MEANS_ROUNDS = 20
"""Rounds of k-means per restart."""
MEDOID_ROUNDS = 3
"""Rounds of k-medoids. docs/methods.md 3.2."""


def reduced(
    Ts: Float, lcps: Float, symmetry_Rs: Float, keep_share: float, most_bins: int, k: int, rng: np.random.Generator
) -> tuple[Float, Float]:
    """At most k² poses (n, 4, 4) that represent all, and their LCPs (n,), highest first.

    A pose has the translation of its cluster's middle and the rotation of a medoid inside, and the LCP of the medoid's
    bin; a cluster of no more than ``k`` bins lists them as they are.

    Args:
        Ts: (N, 4, 4) T_cam_obj [m].
        lcps: (N,) in [0, 1].
        symmetry_Rs: (S, 3, 3) of the object, the identity among them.
        keep_share: share of the highest LCP; poses below are left out, as are poses of LCP 0.
        most_bins: how many bins, the best ones, are clustered.
        k: clusters, and medoids in each.
        rng: for k-means and k-medoids.
    """
    highest = lcps.max(initial=0.0)
    high = (lcps >= keep_share * highest) & (lcps > 0)
    Ts, lcps = Ts[high], lcps[high]
    bins = best_of_bins(Ts, lcps)[:most_bins]
    if len(bins) == 0:
        return np.empty((0, 4, 4)), np.empty(0)
    Ts, lcps = Ts[bins], lcps[bins]
    quats, symmetries = quats_of(Ts[:, :3, :3]), quats_of(symmetry_Rs)
    label = clusters_of_translations(Ts[:, :3, 3], k, rng)
    poses, scores = [], []
    for cluster in range(k):
        members = np.flatnonzero(label == cluster)
        chosen = members[medoids(quats[members], symmetries, k, rng)]
        moved = Ts[chosen]
        if len(members) > k:
            moved[:, :3, 3] = Ts[members, :3, 3].mean(axis=0)
        poses.append(moved)
        scores.append(lcps[chosen])
    poses, scores = np.concatenate(poses), np.concatenate(scores)
    order = np.argsort(-scores, kind="stable")
    return poses[order], scores[order]


def euler_angles(Rs: Float) -> Float:
    """Angles (N, 3) [rad] about z, y and x of rotations (N, 3, 3) = Rz·Ry·Rx; each in (-π, π], the second in ±π/2."""
    return np.stack(
        [
            np.arctan2(Rs[:, 1, 0], Rs[:, 0, 0]),
            np.arcsin(np.clip(-Rs[:, 2, 0], -1.0, 1.0)),
            np.arctan2(Rs[:, 2, 1], Rs[:, 2, 2]),
        ],
        axis=1,
    )


def best_of_bins(Ts: Float, lcps: Float) -> NDArray[np.intp]:
    """Indices of the poses (N, 4, 4) that have the highest LCP of their bin, highest first.

    Bins are cells of 1 cm in translation and 2° in Euler angles. (The published code rounds towards zero, which makes
    the bins at zero twice as wide; these are all alike.)
    """
    cells = np.concatenate(
        [np.floor(Ts[:, :3, 3] / TRANSLATION_BIN_M), np.floor(euler_angles(Ts[:, :3, :3]) / EULER_BIN_RAD)], axis=1
    ).astype(np.int64)
    order = np.argsort(-lcps, kind="stable")
    _, first = np.unique(cells[order], axis=0, return_index=True)
    return order[np.sort(first)]


def clusters_of_translations(translations: Float, k: int, rng: np.random.Generator) -> NDArray[np.intp]:
    """The cluster (N,) in 0 … k - 1 of each translation (N, 3): k-means++ with 10 restarts.

    Where there are no more than ``k`` different translations, each of them is a cluster.
    """
    places, which = np.unique(translations, axis=0, return_inverse=True)
    if len(places) <= k:
        return which.ravel().astype(np.intp)
    best, least = np.zeros(len(translations), dtype=np.intp), np.inf
    for _ in range(RESTARTS):
        try:
            centres, labels = kmeans2(translations, k, MEANS_ROUNDS, minit="++", missing="raise", rng=rng)
        except ClusterError:  # a cluster ran empty; the next start will do better
            continue
        spread = float(((translations - centres[labels]) ** 2).sum())
        if spread < least:
            best, least = labels.astype(np.intp), spread
    return best


def medoids(quats_wxyz: Float, symmetry_quats_wxyz: Float, k: int, rng: np.random.Generator) -> NDArray[np.intp]:
    """Indices of k rotations (of N unit quaternions) that represent the others; all where N ≤ k.

    Distance is the smallest angle over the object's symmetries. (The published code takes the mean of three Euler
    differences, each folded by 90°, 180° or 360°: that depends on the frame, tears rotations apart near its poles and
    knows symmetries about the axes only.)

    Args:
        quats_wxyz: (N, 4) of R_cam_obj.
        symmetry_quats_wxyz: (S, 4) of the rotations that leave the object looking the same, the identity among them.
        k: how many.
        rng: draws the first medoids.
    """
    n = len(quats_wxyz)
    if n <= k:
        return np.arange(n)
    start = rng.choice(n, size=k, replace=False)
    quats, symmetries = np.ascontiguousarray(quats_wxyz), np.ascontiguousarray(symmetry_quats_wxyz)
    return np.sort(_medoids(quats, symmetries, start))


def quats_of(Rs: Float) -> Float:
    """Unit quaternions (N, 4) = (w, x, y, z) of rotations (N, 3, 3), up to sign."""
    return _quats(np.ascontiguousarray(Rs))


@kernel()
def _quats(Rs: np.ndarray) -> np.ndarray:
    out = np.empty((len(Rs), 4))
    for i in range(len(Rs)):
        m = Rs[i]
        # Four times the squares of the components; the largest is divided by.
        ww = 1.0 + m[0, 0] + m[1, 1] + m[2, 2]
        xx = 1.0 + m[0, 0] - m[1, 1] - m[2, 2]
        yy = 1.0 - m[0, 0] + m[1, 1] - m[2, 2]
        zz = 1.0 - m[0, 0] - m[1, 1] + m[2, 2]
        a, b, c = m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]
        d, e, f = m[1, 0] + m[0, 1], m[0, 2] + m[2, 0], m[2, 1] + m[1, 2]
        if ww >= xx and ww >= yy and ww >= zz:
            q = np.array([ww, a, b, c])
        elif xx >= yy and xx >= zz:
            q = np.array([a, xx, d, e])
        elif yy >= zz:
            q = np.array([b, d, yy, f])
        else:
            q = np.array([c, e, f, zz])
        out[i] = q / np.sqrt(q @ q)
    return out


@kernel()
def _closeness(p: np.ndarray, q: np.ndarray, symmetries: np.ndarray) -> float:
    """|cos(half the smallest angle)| between p and q·s over all symmetries s."""
    # p⁻¹·q once, then a dot product with each symmetry (whose inverses are symmetries too).
    w = p[0] * q[0] + p[1] * q[1] + p[2] * q[2] + p[3] * q[3]
    x = p[0] * q[1] - p[1] * q[0] - p[2] * q[3] + p[3] * q[2]
    y = p[0] * q[2] + p[1] * q[3] - p[2] * q[0] - p[3] * q[1]
    z = p[0] * q[3] - p[1] * q[2] + p[2] * q[1] - p[3] * q[0]
    best = 0.0
    for k in range(len(symmetries)):
        s = symmetries[k]
        best = max(best, abs(w * s[0] + x * s[1] + y * s[2] + z * s[3]))
    return best


@kernel()
def _medoids(quats: np.ndarray, symmetries: np.ndarray, start: np.ndarray) -> np.ndarray:
    n, k = len(quats), len(start)
    chosen = start.copy()
    label = np.zeros(n, dtype=np.int64)
    for _ in range(MEDOID_ROUNDS):
        for i in range(n):
            nearest = -1.0
            for m in range(k):
                c = _closeness(quats[chosen[m]], quats[i], symmetries)
                if c > nearest:
                    nearest, label[i] = c, m
        for m in range(k):
            members = np.flatnonzero(label == m)
            least = np.inf
            for i in members:
                total = 0.0
                for j in members:
                    total += np.arccos(min(1.0, _closeness(quats[i], quats[j], symmetries)))
                    if total >= least:
                        break
                if total < least:
                    least, chosen[m] = total, i
    return chosen
