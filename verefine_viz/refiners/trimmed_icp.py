"""Trimmed ICP: the refiner of the paper's Extended APC experiments and of PHYSIM-MCTS. docs/methods.md 4.2.

Every pass matches all observed points to the model, fits to the share of them that match best, and goes on while that
lowers the energy. No gate: a start may be far. One call runs to convergence.

As in :mod:`verefine_viz.refiners.icp`, observed points are moved into the model's frame, where one index of nearest
points per model lasts for ever.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from numba import njit
from numpy.typing import NDArray

from verefine_viz.core.algorithm_settings import TricpSettings
from verefine_viz.core.arrays import Float, finite
from verefine_viz.core.geometry import transform
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.problem import Placed, Target
from verefine_viz.refiners.icp_kernel import apply, point_step
from verefine_viz.refiners.nearest import NearestIndex, model_index, nearest_of_all

# Exact nearest neighbours of points that lie far from the cloud, where :mod:`nearest` compares every point.
#
# The cloud is halved again and again into leaves of a few points; a query looks only into leaves whose box is not too
# far to hold the nearest. Trimmed ICP has no gate, so that any observed point may lie anywhere.

LEAF = 32
"""Most points of a leaf."""


class Leaves(NamedTuple):
    """What a query needs."""

    points: Float
    """(N, 3) the cloud."""
    bounds: Float
    """(L, 2, 3) lowest and highest coordinates of each leaf's points."""
    starts: NDArray[np.int64]
    """(L + 1,) where each leaf's members begin."""
    members: NDArray[np.int64]
    """(N,) indices into ``points``, leaf by leaf."""

    @staticmethod
    def build(points: Float) -> Leaves:
        """The leaves of a cloud (N, 3) of at least one point."""
        points = np.array(points, dtype=np.float64, order="C")
        leaves = [np.arange(len(points))]
        while max(map(len, leaves)) > LEAF:
            halves: list[NDArray[np.int64]] = []
            for leaf in leaves:
                axis = int(np.argmax(np.ptp(points[leaf], axis=0)))
                halves += np.array_split(leaf[np.argsort(points[leaf, axis], kind="stable")], 2)
            leaves = halves
        bounds = np.array([[points[leaf].min(axis=0), points[leaf].max(axis=0)] for leaf in leaves])
        return Leaves(points, bounds, np.cumsum([0, *map(len, leaves)]), np.concatenate(leaves))


@njit(cache=True)
def nearest_from_afar(x: float, y: float, z: float, leaves: Leaves) -> tuple[int, float]:
    """The nearest point's index and squared distance to (x, y, z); the first in the cloud on ties."""
    first, least = 0, np.inf
    for leaf in range(len(leaves.bounds)):
        bound = _to_box(x, y, z, leaves.bounds[leaf])
        if bound < least:
            first, least = leaf, bound
    best, best_squared = _better(x, y, z, leaves, first, 0, np.inf)
    for leaf in range(len(leaves.bounds)):
        if leaf != first and _to_box(x, y, z, leaves.bounds[leaf]) <= best_squared:
            best, best_squared = _better(x, y, z, leaves, leaf, best, best_squared)
    return best, best_squared


@njit(cache=True)
def _to_box(x: float, y: float, z: float, bounds: np.ndarray) -> float:
    """Squared distance of a point to a box (2, 3); 0 inside."""
    dx = max(bounds[0, 0] - x, x - bounds[1, 0], 0.0)
    dy = max(bounds[0, 1] - y, y - bounds[1, 1], 0.0)
    dz = max(bounds[0, 2] - z, z - bounds[1, 2], 0.0)
    return dx * dx + dy * dy + dz * dz


@njit(cache=True)
def _better(
    x: float, y: float, z: float, leaves: Leaves, leaf: int, best: int, best_squared: float
) -> tuple[int, float]:
    """The nearer of the best so far and the leaf's points."""
    points = leaves.points
    for k in range(leaves.starts[leaf], leaves.starts[leaf + 1]):
        i = leaves.members[k]
        dx, dy, dz = points[i, 0] - x, points[i, 1] - y, points[i, 2] - z
        squared = dx * dx + dy * dy + dz * dz
        if squared < best_squared or (squared == best_squared and i < best):
            best, best_squared = i, squared
    return best, best_squared


# The loop of trimmed ICP, compiled as one call. docs/methods.md 4.2. Single-threaded, same bits every time.

NEAR_ONLY = -1.0
"""A limit that no distance keeps: beyond its cubes the index then gives up at once."""


@njit(cache=True)
def trimmed_loop(
    source: np.ndarray, index: NearestIndex, leaves: Leaves, n_used: int, energy_ratio: float, max_passes: int
) -> tuple[np.ndarray, np.ndarray, int, float]:
    """Fits ``source`` onto the indexed cloud; returns R (3, 3), t (3,), passes and the energy of the last one [m²].

    Args:
        source: (N, 3) cloud that moves.
        index: of the cloud that stays.
        leaves: of the same cloud.
        n_used: how many of the source points, the best matching ones, a fit uses; 3 to N.
        energy_ratio: a pass that leaves more than this share of the energy before is the last.
        max_passes: most passes.
    """
    n = len(source)
    R, t = np.eye(3), np.zeros(3)
    match = np.zeros(n, dtype=np.int64)
    squared = np.empty(n)
    moved = np.empty((n, 3))
    kept = np.ones(n, dtype=np.bool_)
    energy, previous = 0.0, np.inf
    for k in range(max_passes):
        for i in range(n):
            moved[i, 0], moved[i, 1], moved[i, 2] = apply(R, t, source[i])
        nearest_of_all(moved, NEAR_ONLY, index, match, squared)
        for i in range(n):
            if squared[i] == np.inf:
                match[i], squared[i] = nearest_from_afar(moved[i, 0], moved[i, 1], moved[i, 2], leaves)
        energy = _keep_best(squared, n_used, kept)
        # From where the points were at first, not from where the last pass left them: errors do not add up.
        R, t = point_step(source, index.points, match, kept, n_used)
        if not energy < energy_ratio * previous:
            return R, t, k + 1, energy
        previous = energy
    return R, t, max_passes, energy


@njit(cache=True)
def _keep_best(squared: np.ndarray, n_used: int, kept: np.ndarray) -> float:
    """Marks the ``n_used`` smallest, the first ones where several are as large as the last; their sum."""
    n = len(squared)
    if n_used >= n:
        return squared.sum()
    limit = np.partition(squared, n_used - 1)[n_used - 1]
    total, n_kept = 0.0, 0
    for i in range(n):
        kept[i] = squared[i] < limit
        if kept[i]:
            total += squared[i]
            n_kept += 1
    for i in range(n):
        if n_kept == n_used:
            break
        if squared[i] == limit:
            kept[i] = True
            total += limit
            n_kept += 1
    return total


@njit(cache=True)
def unexplained(points: np.ndarray, index: NearestIndex, limit_m: float) -> np.ndarray:
    """Which of ``points`` (N, 3) have no point of the indexed cloud within ``limit_m``; (N,) bool."""
    limit_squared = limit_m * limit_m
    found, squared = np.empty(len(points), dtype=np.int64), np.empty(len(points))
    nearest_of_all(points, limit_squared, index, found, squared)
    return squared > limit_squared


FEWEST_POINTS = 3
"""Fewer points do not define a pose."""


@dataclass(frozen=True, eq=False)
class TrimmedTarget:
    """A cloud that sources are aligned to, made ready once."""

    index: NearestIndex
    leaves: Leaves

    @staticmethod
    def build(points: Float) -> TrimmedTarget:
        """The target of a cloud (M, 3) [m], M ≥ 1."""
        return TrimmedTarget.of(NearestIndex.build(points))

    @staticmethod
    def of(index: NearestIndex) -> TrimmedTarget:
        """The target of a cloud that has an index: both number its points the same way."""
        return TrimmedTarget(index, Leaves.build(index.points))


@dataclass(frozen=True, eq=False)
class TrimmedResult:
    """What one alignment came to."""

    T_target_source: Float
    """(4, 4) moves the source onto the target [m]."""
    n_passes: int
    n_used: int
    """Source points that a fit used; 0 where there were too few to fit anything."""
    rms_m: float
    """Root mean square distance of those to their matches before the last fit [m]."""


_NOTHING = TrimmedResult(np.eye(4), 0, 0, 0.0)


def trimmed_align(source: Float, target: Float | TrimmedTarget, settings: TricpSettings) -> TrimmedResult:
    """Aligns a cloud to another by trimmed ICP, starting where they are.

    Args:
        source: (N, 3) the cloud that moves [m].
        target: (M, 3) the cloud that stays, in the same frame [m], or one made ready.
        settings: trim, when to stop.

    Returns:
        The identity and no passes where the target is empty or trimming leaves fewer than 3 points.

    Raises:
        ShapeError: a cloud is not (n, 3) and finite.
    """
    source = finite(source, "source cloud", (None, 3))
    if not isinstance(target, TrimmedTarget):
        target = finite(target, "target cloud", (None, 3))
        if len(target) == 0:
            return _NOTHING
        target = TrimmedTarget.build(target)
    n_used = int(settings.trim * len(source))
    if n_used < FEWEST_POINTS:
        return _NOTHING
    R, t, n_passes, energy = trimmed_loop(
        np.array(source, order="C"), target.index, target.leaves, n_used, settings.energy_ratio, settings.max_passes
    )
    return TrimmedResult(transform(R, t), n_passes, n_used, float(np.sqrt(energy / n_used)))


class TrimmedIcp:
    """Refines a pose by trimmed ICP between the observed cloud and the model's."""

    def __init__(self, settings: TricpSettings) -> None:
        self.settings = settings
        self._targets: WeakKeyDictionary[ObjectModel, TrimmedTarget] = WeakKeyDictionary()

    def refine(self, target: Target, T_cam_obj: Float, fixed: Sequence[Placed] = ()) -> Float:
        """The refined pose (4, 4); the given one where too few points are observed or left unexplained by ``fixed``."""
        if len(target.model.points) == 0:
            return T_cam_obj
        points_cam = self.unexplained(target.instance.points_cam, fixed)
        R_cam_obj, t_cam_obj = T_cam_obj[:3, :3], T_cam_obj[:3, 3]
        result = trimmed_align((points_cam - t_cam_obj) @ R_cam_obj, self._target(target.model), self.settings)
        if result.n_passes == 0:
            return T_cam_obj
        # The observed points moved by G in the model's frame, so the model moves by its inverse: T · G⁻¹.
        R, t = result.T_target_source[:3, :3], result.T_target_source[:3, 3]
        R_new = R_cam_obj @ R.T
        return transform(R_new, t_cam_obj - R_new @ t)

    def unexplained(self, points_cam: Float, fixed: Sequence[Placed]) -> Float:
        """Those of the points (N, 3) that are further than ``explained_m`` from all model points of ``fixed`` objects.

        ``explained_m = 0`` keeps every point.
        """
        for placed in fixed if self.settings.explained_m > 0 else ():
            if len(points_cam) == 0 or len(placed.model.points) == 0:
                continue
            points_obj = (points_cam - placed.T_cam_obj[:3, 3]) @ placed.T_cam_obj[:3, :3]
            free = unexplained(points_obj, self._target(placed.model).index, self.settings.explained_m)
            points_cam = points_cam[free]
        return points_cam

    def _target(self, model: ObjectModel) -> TrimmedTarget:
        ready = self._targets.get(model)
        if ready is None:
            ready = self._targets[model] = TrimmedTarget.of(model_index(model))
        return ready
