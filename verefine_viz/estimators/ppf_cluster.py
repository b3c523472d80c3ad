"""Many votes for poses become few: those that are nearly the same, or look nearly the same, count together."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import apply, nearest_rotation, transform


class Nearness(NamedTuple):
    """When two poses of a model count as the same."""

    symmetries: Float
    """(S, 4, 4) transforms of the object frame that leave it looking the same, the identity first."""
    center_obj: Float
    """(3,) the point whose distance is measured [m]; an object's origin may lie far outside it."""
    near_m: float
    """Centres nearer than this, and …"""
    near_rad: float
    """… rotations that differ by less than this [rad]."""


def clustered(Ts: Float, votes: Float, nearness: Nearness) -> tuple[Float, Float]:
    """Poses (C, 4, 4) and their votes (C,), most votes first, of poses (N, 4, 4) and votes (N,).

    Greedy, in falling order of votes: a pose joins the first cluster whose founder, turned by any symmetry, is near;
    else it founds one. A cluster's pose is the mean of its members, weighted by their votes.
    """
    order = np.argsort(-votes, kind="stable")
    R_sums, c_sums, v_sums = _clustered(
        np.ascontiguousarray(Ts[order]),
        votes[order],
        np.array(nearness.symmetries),
        np.array(nearness.center_obj),
        nearness.near_m,
        float(np.cos(nearness.near_rad)),
    )
    means = np.empty((len(v_sums), 4, 4))
    for k, (R_sum, c_sum, v) in enumerate(zip(R_sums, c_sums, v_sums, strict=True)):
        R = nearest_rotation(R_sum)
        means[k] = transform(R, c_sum / v - R @ nearness.center_obj)
    best_first = np.argsort(-v_sums, kind="stable")
    return means[best_first], v_sums[best_first]


def distinct(Ts: Float, n: int, nearness: Nearness) -> list[int]:
    """Indices of the first ``n`` of ``Ts`` (N, 4, 4) that are not near an earlier one of them.

    Means of clusters may have come nearer to each other than their founders were.
    """
    chosen: list[int] = []
    for k, T in enumerate(Ts):
        if len(chosen) == n:
            break
        if not any(_is_near(Ts[i], T, nearness) for i in chosen):
            chosen.append(k)
    return chosen


def _is_near(T_a: Float, T_b: Float, nearness: Nearness) -> bool:
    turned = T_a @ nearness.symmetries
    gap = turned[:, :3, :3] @ nearness.center_obj + turned[:, :3, 3] - apply(T_b, nearness.center_obj)
    cosine = 0.5 * (np.einsum("sij,ij->s", turned[:, :3, :3], T_b[:3, :3]) - 1)
    near = (np.linalg.norm(gap, axis=1) <= nearness.near_m) & (cosine > np.cos(nearness.near_rad))
    return bool(near.any())


@njit(cache=True)
def _clustered(
    Ts: np.ndarray, votes: np.ndarray, symmetries: np.ndarray, center: np.ndarray, near: float, cosine: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Sums of rotations, centres and votes of each cluster."""
    n = len(Ts)
    founders = np.empty((n, len(symmetries), 4, 4))
    R_sums, c_sums, v_sums = np.zeros((n, 3, 3)), np.zeros((n, 3)), np.zeros(n)
    used = 0
    for i in range(n):
        mine, turned = _cluster_of(Ts[i], founders[:used], center, near, cosine)
        if mine == used:
            for s in range(len(symmetries)):
                founders[used, s] = Ts[i] @ symmetries[s]
            used += 1
        # The member, turned back by the symmetry that brought the founder near it: member ≈ founder · S.
        S = symmetries[turned]
        for a in range(3):
            c_sums[mine, a] += votes[i] * Ts[i, a, 3]
            for b in range(3):
                R_ab = 0.0
                for m in range(3):
                    R_ab += Ts[i, a, m] * S[b, m]
                R_sums[mine, a, b] += votes[i] * R_ab
                c_sums[mine, a] += votes[i] * R_ab * (center[b] - S[b, 3])
        v_sums[mine] += votes[i]
    return R_sums[:used], c_sums[:used], v_sums[:used]


@njit(cache=True)
def _cluster_of(T: np.ndarray, founders: np.ndarray, center: np.ndarray, near: float, cosine: float) -> tuple[int, int]:
    """The first cluster that is near, and by which symmetry it is nearest; (their number, 0) if none is."""
    for k in range(founders.shape[0]):
        nearest, best = -1, cosine
        for s in range(founders.shape[1]):
            F = founders[k, s]
            squared, trace = 0.0, 0.0
            for a in range(3):
                gap = F[a, 3] - T[a, 3]
                for b in range(3):
                    gap += (F[a, b] - T[a, b]) * center[b]
                    trace += F[a, b] * T[a, b]
                squared += gap * gap
            if squared <= near * near and 0.5 * (trace - 1.0) > best:
                nearest, best = s, 0.5 * (trace - 1.0)
        if nearest >= 0:
            return k, nearest
    return founders.shape[0], 0
