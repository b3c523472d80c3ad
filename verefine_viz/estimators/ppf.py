"""Initial poses from point pair features (Drost 2010), our own. docs/methods.md 6.

Pairs of oriented points look the same from everywhere: distance, and three angles. Pairs of the segment vote for poses
of the model whose pairs look alike; near votes are one pose; the depth image ranks what is left.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.algorithm_settings import PpfSettings
from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import apply, nearest_rotation, transform
from verefine_viz.core.kernels import kernel
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.problem import Hypothesis, Target
from verefine_viz.core.progress_token import NEVER_CANCELLED, ProgressToken
from verefine_viz.estimators.clouds import Oriented, segment_surface, thinned_surface
from verefine_viz.estimators.ppf_agreement import agreement
from verefine_viz.estimators.ppf_model import (
    FeatureTable,
    PpfModel,
    bin_of,
    cache_file,
    learn,
    local_rotation,
    pair_feature,
    pose_of_match,
    read,
    turn_about_normal,
    write,
)

MIN_POINTS = 10
"""Least number of thinned points of a segment that can be matched."""
TURN_BINS = 36
"""Bins of the turn about a reference's normal, 360° together."""
PEAKS = 4
"""Most poses that a reference proposes."""
ALIKE_SHARE, ALIKE_DEG = 0.1, 18.0
"""Poses nearer than this share of the diameter, and turned by less, are one hypothesis [deg]."""


class Ppf:
    """Estimator by point pair features. The answer depends on the arguments of each call only.

    Args:
        settings: of the method.
        cache_folder: where tables of models are cached; None = in the user's cache folder.
    """

    def __init__(self, settings: PpfSettings, cache_folder: Path | None = None) -> None:
        self.settings = settings
        self._folder = cache_folder
        self._models: WeakKeyDictionary[ObjectModel, PpfModel] = WeakKeyDictionary()

    def hypotheses(self, target: Target, n: int, progress: ProgressToken = NEVER_CANCELLED) -> tuple[Hypothesis, ...]:
        """At most ``n`` poses, best first, no two of which look the same; see :class:`core.protocols.Estimator`.

        The confidence is in (0, 1]: see :func:`ppf_agreement.agreement`.
        """
        s, model = self.settings, target.model
        d = model.diameter_m
        segment = thinned_surface(segment_surface(target), s.step * d)
        if len(segment.points) < MIN_POINTS:
            return ()
        ready = self._model(model, progress)
        references = np.arange(0, len(segment.points), s.reference_every)
        progress.checkpoint(f"Looking for {model.name} in its segment by votes of {len(references)} of its points.")
        Ts, votes = _voted_poses(segment, references, ready.table, TURN_BINS, PEAKS, progress)
        center_obj = ready.table.points.mean(axis=0)
        same = SamePose(model.symmetries, center_obj, ALIKE_SHARE * d, math.radians(ALIKE_DEG))
        progress.checkpoint(f"Choosing poses of {model.name} that differ among {len(Ts):,}.")
        candidates = clustered(Ts, votes, same)[0][: s.candidates]
        progress.checkpoint()
        agree = agreement(target, ready.cloud, ready.field, segment, candidates, s.tolerance * d)
        order = np.argsort(-agree, kind="stable")
        order = order[agree[order] > 0]
        chosen = order[distinct(candidates[order], n, same)]
        return tuple(Hypothesis(candidates[i], float(agree[i]), f"ppf #{k}") for k, i in enumerate(chosen, start=1))

    def _model(self, model: ObjectModel, progress: ProgressToken) -> PpfModel:
        """The model's tables: from memory, else from disk, else learnt now."""
        ready = self._models.get(model)
        if ready is None:
            path = cache_file(model, self.settings, self._folder)
            ready = read(path)
            if ready is None:
                progress.checkpoint(f"Learning the point pairs of {model.name}.")
                ready = learn(model, self.settings, progress)
                write(path, ready)
            self._models[model] = ready
        return ready


def _voted_poses(
    scene: Oriented,
    references: NDArray[np.intp],
    table: FeatureTable,
    turn_bins: int,
    peaks: int,
    progress: ProgressToken = NEVER_CANCELLED,
) -> tuple[Float, Float]:
    """Poses ``Ts_cam_obj`` (N, 4, 4) that got most votes, and their votes (N,); N ≤ references · peaks.

    Every reference makes pairs with all other scene points. Each pair looks up the model's pairs with the same feature,
    and each of these is a vote: the reference is this model point, turned so far about the normal.

    Args:
        scene: (S, 3) thinned points and normals, camera frame.
        references: indices of the scene points that vote.
        table: the model's pairs.
        turn_bins: bins of the turn about the normal, 360° together.
        peaks: most poses per reference.
        progress: checked before each reference, a tenth of a second on the finest grid.

    Raises:
        Cancelled: through ``progress``.
    """
    peaks_of = [(np.empty((0, 4, 4)), np.empty(0))]
    for k in progress.over(range(len(references))):
        peaks_of.append(_voted(scene.points, scene.normals, references[k : k + 1], table, turn_bins, peaks))
    poses, votes = zip(*peaks_of, strict=True)
    return np.concatenate(poses), np.concatenate(votes)


@kernel()
def _voted(
    points: np.ndarray, normals: np.ndarray, references: np.ndarray, table: FeatureTable, turn_bins: int, peaks: int
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


class SamePose(NamedTuple):
    """When two poses of a model count as the same."""

    symmetries: Float
    """(S, 4, 4) transforms of the object frame that leave it looking the same, the identity first."""
    center_obj: Float
    """(3,) the point whose distance is measured [m]; an object's origin may lie far outside it."""
    near_m: float
    """Centres nearer than this, and …"""
    near_rad: float
    """… rotations that differ by less than this [rad]."""


def clustered(Ts: Float, votes: Float, same: SamePose) -> tuple[Float, Float]:
    """Poses (C, 4, 4) and their votes (C,), most votes first, of poses (N, 4, 4) and votes (N,).

    Greedy, in falling order of votes: a pose joins the first cluster whose founder, turned by any symmetry, is near;
    else it founds one. A cluster's pose is the mean of its members, weighted by their votes.
    """
    order = np.argsort(-votes, kind="stable")
    R_sums, c_sums, v_sums = _clustered(
        np.ascontiguousarray(Ts[order]),
        votes[order],
        np.array(same.symmetries),
        np.array(same.center_obj),
        same.near_m,
        float(np.cos(same.near_rad)),
    )
    means = np.empty((len(v_sums), 4, 4))
    for k, (R_sum, c_sum, v) in enumerate(zip(R_sums, c_sums, v_sums, strict=True)):
        R = nearest_rotation(R_sum)
        means[k] = transform(R, c_sum / v - R @ same.center_obj)
    best_first = np.argsort(-v_sums, kind="stable")
    return means[best_first], v_sums[best_first]


def distinct(Ts: Float, n: int, same: SamePose) -> list[int]:
    """Indices of the first ``n`` of ``Ts`` (N, 4, 4) that are not near an earlier one of them.

    Means of clusters may have come nearer to each other than their founders were.
    """
    chosen: list[int] = []
    for k, T in enumerate(Ts):
        if len(chosen) == n:
            break
        if not any(_is_near(Ts[i], T, same) for i in chosen):
            chosen.append(k)
    return chosen


def _is_near(T_a: Float, T_b: Float, same: SamePose) -> bool:
    turned = T_a @ same.symmetries
    gap = turned[:, :3, :3] @ same.center_obj + turned[:, :3, 3] - apply(T_b, same.center_obj)
    cosine = 0.5 * (np.einsum("sij,ij->s", turned[:, :3, :3], T_b[:3, :3]) - 1)
    near = (np.linalg.norm(gap, axis=1) <= same.near_m) & (cosine > np.cos(same.near_rad))
    return bool(near.any())


@kernel()
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


@kernel()
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
