"""Trimmed ICP: the refiner of the paper's Extended APC experiments and of PHYSIM-MCTS. docs/methods.md 4.2.

Every pass matches all observed points to the model, fits to the share of them that match best, and goes on while that
lowers the energy. No gate: a start may be far. One call runs to convergence.

As in :mod:`verefine_viz.refiners.icp`, observed points are moved into the model's frame, where one index of nearest
points per model lasts for ever.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np

from verefine_viz.core.arrays import Float, finite
from verefine_viz.core.geometry import transform
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.problem import Placed, Target
from verefine_viz.core.refiner_settings import TricpSettings
from verefine_viz.refiners.nearest import NearestIndex, model_index
from verefine_viz.refiners.trimmed_afar import Leaves
from verefine_viz.refiners.trimmed_kernel import trimmed_loop, unexplained

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
