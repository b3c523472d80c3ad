"""Initial poses from point pair features (Drost 2010), our own. docs/methods.md 6.

Pairs of oriented points look the same from everywhere: distance, and three angles. Pairs of the segment vote for poses
of the model whose pairs look alike; near votes are one pose; the depth image ranks what is left.
"""

from __future__ import annotations

import math
from pathlib import Path
from weakref import WeakKeyDictionary

import numpy as np
from numba import njit
from numpy.typing import NDArray

from verefine_viz.core.algorithm_settings import PpfSettings
from verefine_viz.core.arrays import Float
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.problem import Hypothesis, Target
from verefine_viz.core.progress_token import NEVER_CANCELLED, ProgressToken
from verefine_viz.estimators.ppf_agreement import agreement
from verefine_viz.estimators.ppf_cache import Learnt, cache_file, learn, read, write
from verefine_viz.estimators.ppf_cloud import Oriented, segment_surface, thinned
from verefine_viz.estimators.ppf_cluster import Nearness, clustered, distinct
from verefine_viz.estimators.ppf_table import (
    PairTable,
    bin_of,
    local_rotation,
    pair_feature,
    pose_of_match,
    turn_about_normal,
)

# Votes of scene pairs for where a reference point lies on the model, and how far turned about its normal.


def voted_poses(
    scene: Oriented,
    references: NDArray[np.intp],
    table: PairTable,
    turn_bins: int,
    peaks: int,
    progress: ProgressToken = NEVER_CANCELLED,
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
        progress: checked before each reference, a tenth of a second on the finest grid.

    Raises:
        Cancelled: nobody waits for them any more.
    """
    found = [(np.empty((0, 4, 4)), np.empty(0))]
    for k in progress.over(range(len(references))):
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


MIN_POINTS = 10
"""Thinned points below which a segment says nothing."""


class Ppf:
    """Estimator by point pair features. The answer depends on the arguments of each call only.

    Args:
        settings: of the method.
        cache_folder: where tables of models are kept; None = in the user's cache folder.
    """

    def __init__(self, settings: PpfSettings, cache_folder: Path | None = None) -> None:
        self.settings = settings
        self._folder = cache_folder
        self._learnt: WeakKeyDictionary[ObjectModel, Learnt] = WeakKeyDictionary()

    def hypotheses(self, target: Target, n: int, progress: ProgressToken = NEVER_CANCELLED) -> tuple[Hypothesis, ...]:
        """At most ``n`` poses, best first, no two of which look the same; see :class:`core.protocols.Estimator`.

        The confidence is in (0, 1]: see :func:`ppf_agreement.agreement`.
        """
        s, model = self.settings, target.model
        d = model.diameter_m
        segment = thinned(segment_surface(target), s.step * d)
        if len(segment.points) < MIN_POINTS:
            return ()
        learnt = self._of(model, progress)
        references = np.arange(0, len(segment.points), s.reference_every)
        progress.checkpoint(f"Looking for {model.name} in its segment by votes of {len(references)} of its points.")
        Ts, votes = voted_poses(segment, references, learnt.table, s.turn_bins, s.peaks, progress)
        center_obj = learnt.table.points.mean(axis=0)
        nearness = Nearness(model.symmetries, center_obj, s.cluster_share * d, math.radians(s.cluster_deg))
        progress.checkpoint(f"Choosing poses of {model.name} that differ among {len(Ts):,}.")
        candidates = clustered(Ts, votes, nearness)[0][: s.candidates]
        progress.checkpoint()
        agree = agreement(target, learnt.cloud, learnt.field, segment, candidates, s.tolerance * d)
        order = np.argsort(-agree, kind="stable")
        order = order[agree[order] > 0]
        chosen = order[distinct(candidates[order], n, nearness)]
        return tuple(Hypothesis(candidates[i], float(agree[i]), f"ppf #{k}") for k, i in enumerate(chosen, start=1))

    def _of(self, model: ObjectModel, progress: ProgressToken) -> Learnt:
        """What is known of the model: from memory, else from disk, else learnt now."""
        known = self._learnt.get(model)
        if known is None:
            path = cache_file(model, self.settings, self._folder)
            known = read(path)
            if known is None:
                progress.checkpoint(f"Learning the point pairs of {model.name}.")
                known = learn(model, self.settings, progress)
                write(path, known)
            self._learnt[model] = known
        return known
