"""Initial poses from congruent point sets (Super4PCS, Mellado 2014), as the system the paper starts from uses them.

Four points of the segment are a base; what a rigid motion cannot change about them is looked for among the model's
points; each match is a pose; how many of the model's points then lie on the segment (LCP) ranks it; and of the
thousands of poses a few that differ are kept. docs/methods.md 3.1 and 3.2.
"""

from __future__ import annotations

import math
from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from verefine_viz.core.algorithm_settings import PcsSettings
from verefine_viz.core.arrays import Float
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.problem import Hypothesis, Target
from verefine_viz.core.progress_token import NEVER_CANCELLED, ProgressToken
from verefine_viz.estimators.pcs_bases import diameter, draw_base
from verefine_viz.estimators.pcs_lcp import NearGrid, lcps
from verefine_viz.estimators.pcs_quads import TOLERANCE, PairTable, congruent_quads, fitted
from verefine_viz.estimators.pcs_reduction import reduced

# The two clouds that are compared: the segment and the model, each thinned by a grid. docs/methods.md 3.1.

NEIGHBOUR = 2.0
"""Points of one part of the segment are linked by steps of at most this many sides of the grid."""


def segment_cloud(target: Target) -> Float:
    """Every measured pixel of the instance's mask, (N, 3) in the camera frame [m]."""
    observation = target.observation
    v, u = np.nonzero(target.instance.mask & (observation.depth_m > 0))
    z = observation.depth_m[v, u].astype(np.float64)
    camera = observation.camera
    return np.stack([(u - camera.cx) / camera.fx * z, (v - camera.cy) / camera.fy * z, z], axis=-1)


def thinned(points: Float, side_m: float) -> Float:
    """One point per occupied cell of a grid: the mean of those inside. (N, 3) to (n, 3), ordered by cell."""
    if len(points) == 0:
        return points
    cell = np.floor(points / side_m).astype(np.int64)
    cell -= cell.min(axis=0)
    counts = cell.max(axis=0) + 1
    key = (cell[:, 0] * counts[1] + cell[:, 1]) * counts[2] + cell[:, 2]
    _, which, n = np.unique(key, return_inverse=True, return_counts=True)
    which = which.ravel()
    sums = np.stack([np.bincount(which, weights=points[:, k]) for k in range(3)], axis=1)
    return sums / n[:, None]


def large_parts(points: Float, side_m: float, share: float) -> Float:
    """The points without those parts, apart from the rest, that hold less than ``share`` of all."""
    if share == 0 or len(points) == 0:
        return points
    i, j = KDTree(points).query_pairs(NEIGHBOUR * side_m, output_type="ndarray").T
    links = coo_array((np.ones(len(i), dtype=bool), (i, j)), shape=(len(points), len(points)))
    part = connected_components(links, directed=False)[1]
    return points[np.bincount(part)[part] >= share * len(points)]


def spread_out(points: Float, n: int) -> tuple[Float, Float]:
    """At most ``n`` of the points, evenly spread, and how far each is from the nearest of those before it [m].

    The first is the cloud's first; each further one is the farthest from all before, so that any beginning of the list
    is evenly spread too, and the distances never grow.
    """
    points = np.array(points, dtype=np.float64, order="C")
    chosen, distances = _farthest(points, min(n, len(points)))
    return points[chosen], distances


@njit(cache=True)
def _farthest(points: np.ndarray, n: int) -> tuple[NDArray[np.int64], np.ndarray]:
    squared = np.full(len(points), np.inf)
    chosen, distances = np.empty(n, dtype=np.int64), np.empty(n)
    last = 0
    for m in range(n):
        chosen[m], distances[m] = last, np.sqrt(squared[last])
        farthest, next_one = -1.0, 0
        for i in range(len(points)):
            dx, dy, dz = points[i, 0] - points[last, 0], points[i, 1] - points[last, 1], points[i, 2] - points[last, 2]
            squared[i] = min(squared[i], dx * dx + dy * dy + dz * dz)
            if squared[i] > farthest:
                farthest, next_one = squared[i], i
        last = next_one
    return chosen, distances


MIN_POINTS = 20
"""Thinned points below which a segment says nothing."""
MIN_PAIRED = 50
"""Points of the model that make up quads, however far apart they should be: a small object has few that far apart."""
POOL = 25
"""Poses that are kept for whoever wants as many or fewer; he gets the best of them. docs/methods.md 3.2."""
AT_ONCE = 10_000
"""Poses that are counted between two looks at whether somebody still waits: a tenth of a second."""


class PcsModel(NamedTuple):
    """What is made once per model."""

    points: Float
    """(samples, 3) evenly spread [m]: what the LCP counts."""
    pairs: PairTable
    """Of the first of them: what quads are made of."""

    @staticmethod
    def build(model: ObjectModel, settings: PcsSettings) -> PcsModel:
        points, distances = spread_out(thinned(model.points, settings.grid_m), settings.samples)
        n = max(MIN_PAIRED, int((distances >= settings.spacing_m).sum()))
        return PcsModel(points, PairTable.build(points[:n]))


class Pcs:
    """Estimator by congruent point sets. The answer depends on the arguments of each call only.

    Args:
        settings: of the method.
    """

    def __init__(self, settings: PcsSettings) -> None:
        self.settings = settings
        self._models: WeakKeyDictionary[ObjectModel, PcsModel] = WeakKeyDictionary()

    def hypotheses(self, target: Target, n: int, progress: ProgressToken = NEVER_CANCELLED) -> tuple[Hypothesis, ...]:
        """At most ``n`` poses, highest LCP first; see :class:`core.protocols.Estimator`.

        The confidence is the LCP of the pose that a hypothesis stands for, in (0, 1]: of a model whose front alone is
        seen, about the share of its surface that is seen.
        """
        s, model = self.settings, target.model
        segment = large_parts(thinned(segment_cloud(target), s.grid_m), s.grid_m, s.part_share)
        if len(segment) < MIN_POINTS:
            return ()
        progress.checkpoint(f"Looking for {model.name} in its segment by {s.bases:,} bases of four points.")
        known = self._models.get(model)
        if known is None:
            known = self._models[model] = PcsModel.build(model, s)
        rng = np.random.default_rng(s.seed)
        Ts, scores = candidates(segment, known, model.diameter_m, s, rng, progress)
        progress.checkpoint(f"Choosing poses of {model.name} that differ among {len(Ts):,}.")
        k = math.ceil(math.sqrt(max(n, POOL)))
        Ts, scores = reduced(Ts, scores, model.symmetries[:, :3, :3], s.keep_share, s.bins, k, rng)
        found = zip(Ts[:n], scores[:n], strict=True)
        return tuple(Hypothesis(T, float(lcp), f"pcs #{i}") for i, (T, lcp) in enumerate(found, start=1))


def candidates(
    segment: Float,
    model: PcsModel,
    model_diameter_m: float,
    settings: PcsSettings,
    rng: np.random.Generator,
    progress: ProgressToken = NEVER_CANCELLED,
) -> tuple[Float, Float]:
    """Every pose (N, 4, 4) that lays a quad of the model on a base of the segment, and its LCP (N,).

    Args:
        segment: (n, 3) [m].
        model: its points and pairs.
        model_diameter_m: no base is larger.
        settings: of the method.
        rng: draws bases and quads.
        progress: checked before each base, and before each batch of poses is counted.

    Raises:
        Cancelled: nobody waits for them any more.
    """
    grid = NearGrid.build(segment, settings.delta_m)
    longest_m = min(diameter(segment), model_diameter_m)
    poses = [np.empty((0, 4, 4))]
    for _ in progress.over(range(settings.bases)):
        base = draw_base(segment, longest_m, settings.delta_m, rng)
        if base is None:
            continue
        quads = congruent_quads(base, model.points, model.pairs, settings.delta_m, settings.quads, rng)
        poses.append(fitted(base.points, model.points, quads, TOLERANCE * settings.delta_m)[0])
    Ts = np.concatenate(poses)
    batches = range(0, len(Ts), AT_ONCE)
    scores = [lcps(Ts[k : k + AT_ONCE], model.points, grid) for k in progress.over(batches)]
    return Ts, np.concatenate([np.empty(0), *scores])
