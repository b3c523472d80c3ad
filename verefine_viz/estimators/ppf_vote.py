"""Votes of scene pairs for where a reference point lies on the model, and how far turned about its normal."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float
from verefine_viz.core.patience import ENDLESS, Patience
from verefine_viz.estimators.ppf_cloud import Oriented
from verefine_viz.estimators.ppf_features import local_rotation, pair_feature, pose_of_match, turn_about_normal
from verefine_viz.estimators.ppf_table import PairTable, bin_of


def voted_poses(
    scene: Oriented,
    references: NDArray[np.intp],
    table: PairTable,
    turn_bins: int,
    peaks: int,
    patience: Patience = ENDLESS,
) -> tuple[Float, Float]:
    """Poses ``Ts_cam_obj`` (N, 4, 4) that got most votes, and their votes (N,); N ≤ references · peaks.

    Every reference makes pairs with all other scene points. Each pair looks up the model's pairs with the same feature,
    and each of these says: the reference is this model point, turned so far about the normal.

    Args:
        scene: (S, 3) thinned points and normals, camera frame.
        references: indices of the scene points that vote.
        table: the model's pairs.
        turn_bins: bins of the turn about the normal, 360° together.
        peaks: most poses per reference.
        patience: asked before each reference, a tenth of a second on the finest grid.

    Raises:
        Cancelled: nobody waits for them any more.
    """
    found = [(np.empty((0, 4, 4)), np.empty(0))]
    for k in patience.over(range(len(references))):
        found.append(_voted(scene.points, scene.normals, references[k : k + 1], table, turn_bins, peaks))
    poses, votes = zip(*found, strict=True)
    return np.concatenate(poses), np.concatenate(votes)


@njit(cache=True)
def _voted(
    points: np.ndarray, normals: np.ndarray, references: np.ndarray, table: PairTable, turn_bins: int, peaks: int
) -> tuple[np.ndarray, np.ndarray]:
    side = 2.0 * np.pi / turn_bins
    poses = np.empty((len(references) * peaks, 4, 4))
    votes = np.empty(len(references) * peaks)
    counts = np.empty((len(table.points), turn_bins), dtype=np.float32)
    used = 0
    for r in references:
        counts[:] = 0.0
        rotation = local_rotation(normals[r])
        for j in range(len(points)):
            feature = pair_feature(points[r], normals[r], points[j], normals[j])
            if not 0.0 < feature[0] / table.distance_bin_m < table.n_distances:
                continue
            turn = turn_about_normal(rotation, points[r], points[j])
            if not np.isfinite(turn):  # No normal.
                continue
            key = bin_of(feature, table.distance_bin_m, table.angle_bin_rad, table.n_angles)
            weight = table.weights[key]
            for k in range(table.starts[key], table.starts[key + 1]):
                # A turn between two bins is shared by them, so that no vote hangs on where a border is.
                place = (turn - table.turn_rad[k]) / side
                if place < 0.0:
                    place += turn_bins
                low = int(place)
                share = np.float32(place - low)
                if low >= turn_bins:
                    low -= turn_bins
                high = low + 1 if low + 1 < turn_bins else 0
                counts[table.first[k], low] += weight * (np.float32(1.0) - share)
                counts[table.first[k], high] += weight * share
        for _ in range(peaks):
            best, point, at = np.float32(0.0), -1, -1
            for i in range(len(counts)):
                for t in range(turn_bins):
                    if counts[i, t] > best:
                        best, point, at = counts[i, t], i, t
            if point < 0:
                break
            low, high = (at - 1) % turn_bins, (at + 1) % turn_bins
            total = counts[point, low] + best + counts[point, high]
            turn = (at + (counts[point, high] - counts[point, low]) / total) * side
            poses[used] = pose_of_match(points[r], rotation, table.points[point], table.rotations[point], turn)
            votes[used] = total
            used += 1
            counts[point, low], counts[point, at], counts[point, high] = 0.0, 0.0, 0.0
    return poses[:used], votes[:used]
