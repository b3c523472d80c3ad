"""Trimmed ICP: the refiner of the paper's Extended APC experiments and of PHYSIM-MCTS. docs/methods.md 4.2.

Every pass matches all observed points to the model and fits to the best-matching share of them, until the energy no
longer falls. No gate: a start may be far. One call runs to convergence.

As in :mod:`verefine_viz.refiners.icp`, observed points are moved into the model's frame, where one index of nearest
points per model serves all poses.
"""

from __future__ import annotations

from collections.abc import Sequence
from weakref import WeakKeyDictionary

import numpy as np

from verefine_viz.core.algorithm_settings import TricpSettings
from verefine_viz.core.arrays import Float, finite
from verefine_viz.core.geometry import transform
from verefine_viz.core.kernels import kernel
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.problem import Placed, Target
from verefine_viz.refiners.icp_kernel import apply, point_step
from verefine_viz.refiners.nearest import Leaves, NearestIndex, model_index, nearest_from_afar, nearest_of_all

FEWEST_POINTS = 3
"""Fewer points do not define a pose."""
NEAR_ONLY = -1.0
"""A limit that every distance exceeds: with it, the index gives up at once beyond its cubes."""


@kernel()
def trimmed_loop(
    source: np.ndarray, index: NearestIndex, leaves: Leaves, n_used: int, energy_ratio: float, max_passes: int
) -> tuple[np.ndarray, np.ndarray, int, float]:
    """Fits ``source`` onto the indexed cloud; returns R (3, 3), t (3,), passes and the energy of the last one [m²].

    Args:
        source: (N, 3) cloud that moves.
        index: of the cloud that stays.
        leaves: of the same cloud.
        n_used: how many of the source points, the best matching ones, a fit uses; 3 to N.
        energy_ratio: a pass that leaves more than this share of the previous energy is the last.
        max_passes: most passes.
    """
    n = len(source)
    R, t = np.eye(3), np.zeros(3)
    match = np.zeros(n, dtype=np.int64)
    squared = np.empty(n)
    moved = np.empty((n, 3))
    used = np.ones(n, dtype=np.bool_)
    energy, previous = 0.0, np.inf
    for k in range(max_passes):
        for i in range(n):
            moved[i, 0], moved[i, 1], moved[i, 2] = apply(R, t, source[i])
        nearest_of_all(moved, NEAR_ONLY, index, match, squared)
        for i in range(n):
            if squared[i] == np.inf:
                match[i], squared[i] = nearest_from_afar(moved[i, 0], moved[i, 1], moved[i, 2], leaves)
        energy = _use_best(squared, n_used, used)
        # From the points' first positions, not from those after the last pass: rounding does not add up.
        R, t = point_step(source, index.points, match, used)
        if not energy < energy_ratio * previous:
            return R, t, k + 1, energy
        previous = energy
    return R, t, max_passes, energy


@kernel()
def _use_best(squared: np.ndarray, n_used: int, used: np.ndarray) -> float:
    """Marks the ``n_used`` smallest, the first ones where several equal the last; returns their sum."""
    n = len(squared)
    if n_used >= n:
        return squared.sum()
    limit = _in_order(squared.copy(), n_used - 1)
    total, n_marked = 0.0, 0
    for i in range(n):
        used[i] = squared[i] < limit
        if used[i]:
            total += squared[i]
            n_marked += 1
    for i in range(n):
        if n_marked == n_used:
            break
        if squared[i] == limit:
            used[i] = True
            total += limit
            n_marked += 1
    return total


@kernel()
def _in_order(values: np.ndarray, k: int) -> float:
    """The number at place ``k`` of the sorted ``values``, which are rearranged (Hoare 1961).

    ``np.partition`` would give this number, too, but takes ten times as long to compile.
    """
    low, high = 0, len(values) - 1
    while low < high:
        pivot = values[(low + high) // 2]
        i, j = low, high
        while i <= j:
            while values[i] < pivot:
                i += 1
            while pivot < values[j]:
                j -= 1
            if i <= j:
                values[i], values[j] = values[j], values[i]
                i, j = i + 1, j - 1
        if k <= j:
            high = j
        elif k >= i:
            low = i
        else:
            break
    return values[k]


@kernel()
def unexplained(points: np.ndarray, index: NearestIndex, limit_m: float) -> np.ndarray:
    """Which of ``points`` (N, 3) have no point of the indexed cloud within ``limit_m``; (N,) bool."""
    limit_squared = limit_m * limit_m
    nearest, squared = np.empty(len(points), dtype=np.int64), np.empty(len(points))
    nearest_of_all(points, limit_squared, index, nearest, squared)
    return squared > limit_squared


class TrimmedIcp:
    """Refines a pose by trimmed ICP between the observed cloud and the model's."""

    def __init__(self, settings: TricpSettings) -> None:
        self.settings = settings
        self._leaves: WeakKeyDictionary[ObjectModel, Leaves] = WeakKeyDictionary()

    def refine(self, target: Target, T_cam_obj: Float, fixed: Sequence[Placed] = ()) -> Float:
        """The refined pose (4, 4); the given one where too few points are observed or left unexplained by ``fixed``.

        Raises:
            ShapeError: the pose is not finite.
        """
        if len(target.model.points) == 0:
            return T_cam_obj
        points_cam = self.unexplained(target.instance.points_cam, fixed)
        R_cam_obj, t_cam_obj = T_cam_obj[:3, :3], T_cam_obj[:3, 3]
        source = np.array(finite((points_cam - t_cam_obj) @ R_cam_obj, "source cloud", (None, 3)), order="C")
        n_used = int(self.settings.trim * len(source))
        if n_used < FEWEST_POINTS:
            return T_cam_obj
        index = model_index(target.model)
        leaves = self._leaves.get(target.model)
        if leaves is None:  # Of the index's points, so that both number them the same way.
            leaves = self._leaves[target.model] = Leaves.build(index.points)
        R, t, _, _ = trimmed_loop(source, index, leaves, n_used, self.settings.energy_ratio, self.settings.max_passes)
        # The observed points moved by G in the model's frame, so the model moves by its inverse: T · G⁻¹.
        R_new = R_cam_obj @ R.T
        return transform(R_new, t_cam_obj - R_new @ t)

    def unexplained(self, points_cam: Float, fixed: Sequence[Placed]) -> Float:
        """The points (N, 3) that are further than ``explained_m`` from all model points of ``fixed`` objects.

        With ``explained_m = 0`` these are all.
        """
        for placed in fixed if self.settings.explained_m > 0 else ():
            if len(points_cam) == 0 or len(placed.model.points) == 0:
                continue
            points_obj = (points_cam - placed.T_cam_obj[:3, 3]) @ placed.T_cam_obj[:3, :3]
            free = unexplained(points_obj, model_index(placed.model), self.settings.explained_m)
            points_cam = points_cam[free]
        return points_cam
