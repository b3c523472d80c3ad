"""Initial poses from congruent point sets (Super4PCS, Mellado 2014), as the system the paper starts from uses them.

Four points of the segment are a base; four points of the model that a rigid motion can lay on it are a match, and
each match is a pose. Poses are ranked by how many of the model's points lie on the segment (LCP, the largest common
point set: counted, not estimated). Thousands of them are reduced to a few that differ. docs/methods.md 3.1 and 3.2.
"""

from __future__ import annotations

import math
from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.algorithm_settings import PcsSettings
from verefine_viz.core.arrays import Float
from verefine_viz.core.kernels import kernel
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.problem import Hypothesis, Target
from verefine_viz.core.progress_token import NEVER_CANCELLED, ProgressToken
from verefine_viz.estimators.clouds import large_parts, segment_cloud, spread_out, thinned
from verefine_viz.estimators.pcs_bases import diameter, draw_base
from verefine_viz.estimators.pcs_quads import TOLERANCE, DistanceTable, congruent_quads, fitted
from verefine_viz.estimators.pcs_reduction import reduced

MIN_POINTS = 20
"""Least number of thinned points of a segment that can be matched."""
MIN_PAIRED = 50
"""Least number of model points that make up quads, also where fewer lie as far apart as asked, as on a small object."""
POOL = 25
"""Poses that are chosen where as many or fewer are wanted; the answer is the best of them. docs/methods.md 3.2."""
MOST_QUADS = 1000
"""Most quads of a base that are tried, chosen at random."""
MOST_BINS = 2000
"""Most bins, the best ones, that go into the clusters."""
AT_ONCE = 10_000
"""Poses whose LCP is counted between two checkpoints: a tenth of a second."""
MAX_CELLS = 2**22
"""Most cells of the LCP's grid; around a larger segment they grow beyond δ, which costs time only."""


class PcsModel(NamedTuple):
    """Data made once per model."""

    points: Float
    """(samples, 3) evenly spread points that the LCP counts [m]."""
    pairs: DistanceTable
    """Pairs of the first of these points, of which quads are made."""

    @staticmethod
    def build(model: ObjectModel, settings: PcsSettings) -> PcsModel:
        cloud = thinned(model.points, settings.grid_m)
        chosen, distances = spread_out(cloud, settings.samples)
        points, n = cloud[chosen], max(MIN_PAIRED, int((distances >= settings.spacing_m).sum()))
        return PcsModel(points, DistanceTable.build(points[:n]))


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
        ready = self._models.get(model)
        if ready is None:
            ready = self._models[model] = PcsModel.build(model, s)
        rng = np.random.default_rng(s.seed)
        Ts, scores = candidates(segment, ready, model.diameter_m, s, rng, progress)
        progress.checkpoint(f"Choosing poses of {model.name} that differ among {len(Ts):,}.")
        k = math.ceil(math.sqrt(max(n, POOL)))
        Ts, scores = reduced(Ts, scores, model.symmetries[:, :3, :3], s.keep_share, MOST_BINS, k, rng)
        best = zip(Ts[:n], scores[:n], strict=True)
        return tuple(Hypothesis(T, float(lcp), f"pcs #{i}") for i, (T, lcp) in enumerate(best, start=1))


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
        Cancelled: through ``progress``.
    """
    grid = NearGrid.build(segment, settings.delta_m)
    longest_m = min(diameter(segment), model_diameter_m)
    poses = [np.empty((0, 4, 4))]
    for _ in progress.over(range(settings.bases)):
        base = draw_base(segment, longest_m, settings.delta_m, rng)
        if base is None:
            continue
        quads = congruent_quads(base, model.points, model.pairs, settings.delta_m, MOST_QUADS, rng)
        poses.append(fitted(base.points, model.points, quads, TOLERANCE * settings.delta_m)[0])
    Ts = np.concatenate(poses)
    batches = range(0, len(Ts), AT_ONCE)
    scores = [lcps(Ts[k : k + AT_ONCE], model.points, grid) for k in progress.over(batches)]
    return Ts, np.concatenate([np.empty(0), *scores])


class NearGrid(NamedTuple):
    """Cells around a cloud, each with the points that are near to some place in it."""

    points: Float
    """(N, 3) [m]."""
    radius_m: float
    """What "near" means: δ."""
    low: Float
    """(3,) where the cells begin."""
    side: float
    counts: NDArray[np.int64]
    """(3,) cells along x, y, z."""
    starts: NDArray[np.int32]
    """(cells + 1,) where each cell's points begin."""
    candidates: NDArray[np.int32]
    """Indices into ``points``."""

    @staticmethod
    def build(points: Float, radius_m: float) -> NearGrid:
        """The grid of a cloud (N, 3) of at least one point."""
        points = np.array(points, dtype=np.float64, order="C")
        low = points.min(axis=0) - radius_m
        extents = points.max(axis=0) + radius_m - low
        side = max(radius_m, float((extents.prod() / MAX_CELLS) ** (1 / 3)))
        counts = (extents / side).astype(np.int64) + 1
        starts, candidates = _fill(points, radius_m, low, side, counts)
        return NearGrid(points, radius_m, low, side, counts, starts, candidates)


def lcps(Ts_cam_obj: Float, model_points: Float, grid: NearGrid) -> Float:
    """Share of the model's points (M, 3) that lie within δ of a segment point, at each of the poses (N, 4, 4)."""
    points = np.array(model_points, dtype=np.float64, order="C")
    Ts = np.array(Ts_cam_obj, dtype=np.float64, order="C")
    return _counts(Ts, points, grid) / len(points)


@kernel()
def _counts(Ts: np.ndarray, points: np.ndarray, grid: NearGrid) -> np.ndarray:
    out = np.empty(len(Ts), dtype=np.int64)
    for i in range(len(Ts)):
        out[i] = count_near(Ts[i, :3, :3], Ts[i, :3, 3], points, grid)
    return out


@kernel()
def count_near(R: np.ndarray, t: np.ndarray, points: np.ndarray, grid: NearGrid) -> int:
    """How many of ``points`` (M, 3), turned by R (3, 3) and moved by t (3,), lie within δ of a point of the grid."""
    # Everything in locals: in the loop, reading a tuple or a strided matrix costs more than the arithmetic.
    r00, r01, r02, r10, r11, r12 = R[0, 0], R[0, 1], R[0, 2], R[1, 0], R[1, 1], R[1, 2]
    r20, r21, r22, tx, ty, tz = R[2, 0], R[2, 1], R[2, 2], t[0], t[1], t[2]
    cloud, starts, candidates = grid.points, grid.starts, grid.candidates
    lx, ly, lz, per_side = grid.low[0], grid.low[1], grid.low[2], 1.0 / grid.side
    nx, ny, nz = grid.counts[0], grid.counts[1], grid.counts[2]
    limit = grid.radius_m * grid.radius_m
    n = 0
    for i in range(len(points)):
        a, b, c = points[i, 0], points[i, 1], points[i, 2]
        x = r00 * a + r01 * b + r02 * c + tx
        y = r10 * a + r11 * b + r12 * c + ty
        z = r20 * a + r21 * b + r22 * c + tz
        u, v, w = (x - lx) * per_side, (y - ly) * per_side, (z - lz) * per_side
        if u >= 0.0 and v >= 0.0 and w >= 0.0 and u < nx and v < ny and w < nz:
            cell = (int(u) * ny + int(v)) * nz + int(w)
            for k in range(starts[cell], starts[cell + 1]):
                p = candidates[k]
                dx, dy, dz = cloud[p, 0] - x, cloud[p, 1] - y, cloud[p, 2] - z
                if dx * dx + dy * dy + dz * dz <= limit:
                    n += 1
                    break
    return n


@kernel()
def _fill(
    points: np.ndarray, radius: float, low: np.ndarray, side: float, counts: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Where each cell's points begin, and the points: a first pass counts them, a second enters them."""
    nx, ny, nz = counts[0], counts[1], counts[2]
    starts = np.zeros(nx * ny * nz + 1, dtype=np.int32)
    candidates = np.empty(0, dtype=np.int32)
    cursor = starts
    for entering in range(2):
        if entering == 1:
            for cell in range(nx * ny * nz):
                starts[cell + 1] += starts[cell]
            candidates = np.empty(starts[-1], dtype=np.int32)
            cursor = starts[:-1].copy()
        for p in range(len(points)):
            x, y, z = points[p, 0] - low[0], points[p, 1] - low[1], points[p, 2] - low[2]
            for i in range(max(0, int((x - radius) / side)), min(nx - 1, int((x + radius) / side)) + 1):
                dx = max(i * side - x, x - (i + 1) * side, 0.0)
                for j in range(max(0, int((y - radius) / side)), min(ny - 1, int((y + radius) / side)) + 1):
                    dy = max(j * side - y, y - (j + 1) * side, 0.0)
                    for k in range(max(0, int((z - radius) / side)), min(nz - 1, int((z + radius) / side)) + 1):
                        dz = max(k * side - z, z - (k + 1) * side, 0.0)
                        # Slightly more than δ, so that rounding loses no point at a cell's border.
                        if dx * dx + dy * dy + dz * dz <= radius * radius * (1.0 + 1e-9):
                            cell = (i * ny + j) * nz + k
                            if entering == 1:
                                candidates[cursor[cell]] = p
                                cursor[cell] += 1
                            else:
                                starts[cell + 1] += 1
    return starts, candidates
