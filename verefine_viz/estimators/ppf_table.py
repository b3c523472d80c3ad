"""All point pairs of a model by their feature: what votes are looked up in."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float
from verefine_viz.core.progress_token import NEVER_CANCELLED, ProgressToken
from verefine_viz.estimators.ppf_cloud import Oriented

# What two oriented points have in common wherever they are, and the angle that is left. docs/methods.md 6.


@njit(cache=True)
def angle(cosine: float) -> float:
    """The angle of a cosine that rounding may have pushed beyond 1 [rad]; π where it is NaN: it becomes an index."""
    return np.arccos(min(1.0, max(-1.0, cosine)))  # In this order: NaN is not larger than −1.


@njit(cache=True)
def pair_feature(p1: np.ndarray, n1: np.ndarray, p2: np.ndarray, n2: np.ndarray) -> tuple[float, float, float, float]:
    """Distance [m] and the angles n1-d, n2-d, n1-n2 [rad], where d points from the first to the second."""
    x, y, z = p2[0] - p1[0], p2[1] - p1[1], p2[2] - p1[2]
    distance = np.sqrt(x * x + y * y + z * z)
    if distance == 0.0:
        return 0.0, 0.0, 0.0, 0.0
    return (
        distance,
        angle((n1[0] * x + n1[1] * y + n1[2] * z) / distance),
        angle((n2[0] * x + n2[1] * y + n2[2] * z) / distance),
        angle(n1[0] * n2[0] + n1[1] * n2[1] + n1[2] * n2[2]),
    )


@njit(cache=True)
def local_rotation(normal: np.ndarray) -> np.ndarray:
    """The rotation (3, 3) that turns ``normal`` onto +x; which one of the many is fixed by the normal alone."""
    x, y, z = normal[0], normal[1], normal[2]
    # Duff et al. 2017: an orthonormal basis without a singular direction.
    sign = 1.0 if z >= 0.0 else -1.0
    a = -1.0 / (sign + z)
    b = x * y * a
    return np.array([[x, y, z], [1.0 + sign * x * x * a, sign * b, -sign * x], [b, sign + y * y * a, -y]])


@njit(cache=True)
def turn_about_normal(rotation: np.ndarray, p1: np.ndarray, p2: np.ndarray) -> float:
    """The angle of ``p2`` about the x axis of p1's local frame [rad], in (-π, π]."""
    x, y, z = p2[0] - p1[0], p2[1] - p1[1], p2[2] - p1[2]
    return np.arctan2(
        rotation[2, 0] * x + rotation[2, 1] * y + rotation[2, 2] * z,
        rotation[1, 0] * x + rotation[1, 1] * y + rotation[1, 2] * z,
    )


@njit(cache=True)
def pose_of_match(
    p_cam: np.ndarray, rotation_cam: np.ndarray, p_obj: np.ndarray, rotation_obj: np.ndarray, turn_rad: float
) -> np.ndarray:
    """``T_cam_obj`` (4, 4) that lays p_obj and its normal on p_cam and its normal, turned about them."""
    c, s = np.cos(turn_rad), np.sin(turn_rad)
    about_x = np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
    R = rotation_cam.T @ about_x @ rotation_obj
    T = np.eye(4)
    T[:3, :3] = R
    T[:3, 3] = p_cam - R @ p_obj
    return T


AT_ONCE = 100
"""First points whose pairs are made between two looks at whether somebody still waits: a tenth of a second."""


class PairTable(NamedTuple):
    """The pairs of one model, bin by bin."""

    points: Float
    """(M, 3) thinned model points, object frame [m]."""
    normals: Float
    """(M, 3) their outward normals."""
    rotations: Float
    """(M, 3, 3) that turn each normal onto +x."""
    starts: NDArray[np.int64]
    """(bins + 1,) where the pairs of each bin begin."""
    weights: NDArray[np.float32]
    """(bins,) for how many pairs each one in the bin stands: 1, or more where only some were kept."""
    first: NDArray[np.uint16]
    """(pairs,) the pair's first point."""
    turn_rad: NDArray[np.float32]
    """(pairs,) angle of the pair's second point about the first one's normal [rad]."""
    distance_bin_m: float
    angle_bin_rad: float
    n_distances: int
    n_angles: int


def pair_table(
    cloud: Oriented,
    distance_bin_m: float,
    angle_bin_rad: float,
    bin_limit: int,
    progress: ProgressToken = NEVER_CANCELLED,
) -> PairTable:
    """The table of a thinned model cloud.

    Args:
        cloud: (M, 3) points and outward normals, M < 65536.
        distance_bin_m: bin of the distance [m].
        angle_bin_rad: bin of each of the three angles [rad].
        bin_limit: most pairs kept in a bin, evenly spread over its pairs in order of their points; flat faces fill few
            bins with very many pairs, which would take nearly all of the time.
        progress: asked on the way; the finest table of a large model takes seconds.

    Raises:
        Cancelled: nobody waits for it any more.
    """
    points, normals = cloud
    n_angles = int(np.pi / angle_bin_rad) + 1
    n_distances = int(np.linalg.norm(np.ptp(points, axis=0)) / distance_bin_m) + 1
    rotations = np.stack([local_rotation(n) for n in normals])
    n = len(points)
    key = np.empty(n * (n - 1), dtype=np.int64)
    first = np.empty(n * (n - 1), dtype=np.uint16)
    turn = np.empty(n * (n - 1), dtype=np.float32)
    for begin in progress.over(range(0, n, AT_ONCE)):
        end = min(begin + AT_ONCE, n)
        _pairs(points, normals, rotations, distance_bin_m, angle_bin_rad, n_angles, begin, end, key, first, turn)
    sizes = np.bincount(key, minlength=n_distances * n_angles**3)
    progress.checkpoint()
    before = np.concatenate([[0], np.cumsum(sizes)])
    order = _in_bins(key, before)
    progress.checkpoint()
    kept = np.minimum(sizes, bin_limit)
    starts = np.concatenate([[0], np.cumsum(kept)])
    # The m-th pair kept of a bin is number ⌊m · size / kept⌋ of it.
    of_bin = np.repeat(np.arange(len(sizes)), kept)
    within = np.arange(len(of_bin)) - starts[of_bin]
    order = order[before[of_bin] + within * sizes[of_bin] // kept[of_bin]]
    weights = (sizes / np.maximum(kept, 1)).astype(np.float32)
    return PairTable(
        points, normals, rotations, starts, weights, first[order], turn[order],
        distance_bin_m, angle_bin_rad, n_distances, n_angles,
    )  # fmt: skip


@njit(cache=True)
def bin_of(
    feature: tuple[float, float, float, float], distance_bin_m: float, angle_bin_rad: float, n_angles: int
) -> int:
    """Number of the bin that a feature falls into."""
    distance_m, at_first, at_second, between = feature
    key = int(distance_m / distance_bin_m) * n_angles + int(at_first / angle_bin_rad)
    return (key * n_angles + int(at_second / angle_bin_rad)) * n_angles + int(between / angle_bin_rad)


@njit(cache=True)
def _pairs(
    points: np.ndarray,
    normals: np.ndarray,
    rotations: np.ndarray,
    distance_bin_m: float,
    angle_bin_rad: float,
    n_angles: int,
    begin: int,
    end: int,
    key: np.ndarray,
    first: np.ndarray,
    turn: np.ndarray,
) -> None:
    """Enters bin, first point and turn of every ordered pair of different points whose first is one of begin … end."""
    n = len(points)
    k = begin * (n - 1)
    for i in range(begin, end):
        for j in range(n):
            if i != j:
                feature = pair_feature(points[i], normals[i], points[j], normals[j])
                key[k] = bin_of(feature, distance_bin_m, angle_bin_rad, n_angles)
                first[k] = i
                turn[k] = turn_about_normal(rotations[i], points[i], points[j])
                k += 1


@njit(cache=True)
def _in_bins(key: np.ndarray, starts: np.ndarray) -> np.ndarray:
    """The pairs, as indices, bin by bin and in their order within each; ``starts`` is where each bin begins."""
    cursor = starts.copy()
    order = np.empty(len(key), dtype=np.int64)
    for k in range(len(key)):
        order[cursor[key[k]]] = k
        cursor[key[k]] += 1
    return order
