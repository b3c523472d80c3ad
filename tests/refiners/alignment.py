"""ICP and trimmed ICP of two clouds, as the refiners run them: for comparison with other libraries."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from verefine_viz.core.algorithm_settings import IcpSettings, TricpSettings
from verefine_viz.core.arrays import Float, writable
from verefine_viz.core.geometry import transform
from verefine_viz.refiners.icp import STOP_RULES, gate_schedule_m, largest_extent_m, n_shrinking
from verefine_viz.refiners.icp_kernel import icp_loop
from verefine_viz.refiners.nearest import Leaves, NearestIndex
from verefine_viz.refiners.trimmed_icp import FEWEST_POINTS, trimmed_loop


@dataclass(frozen=True, eq=False)
class Aligned:
    T_target_source: Float
    """(4, 4) moves the source onto the target [m]."""
    n_iterations: int
    n_matches: int
    """In the last iteration; trimmed: used by each fit."""
    rms_m: float
    """Of those matches before the last step."""


class Cloud:
    """A cloud (M, 3) [m] that sources are aligned to, and its outward unit normals (M, 3), made ready once."""

    def __init__(self, points: Float, normals: Float | None = None) -> None:
        self.index = NearestIndex.build(points)
        self.leaves = Leaves.build(self.index.points)
        self.normals = writable(np.empty((0, 3)) if normals is None else normals[self.index.order])


def icp_align(
    source: Float,
    target: Float | Cloud,
    settings: IcpSettings,
    target_normals: Float | None = None,
    source_normals: Float | None = None,
    extent_m: float | None = None,
) -> Aligned:
    """Aligns a cloud (N, 3) to another, starting where they are.

    ``target_normals`` are needed for ``metric = "plane"``; ``extent_m`` is what the gate is a share of.
    """
    target = target if isinstance(target, Cloud) else Cloud(target, target_normals)
    checks_sides = settings.matches == "same_side" and len(target.normals) > 0 and source_normals is not None
    gates_m = gate_schedule_m(largest_extent_m(source) if extent_m is None else extent_m, settings)
    R, t, n_iterations, n_matches, mse = icp_loop(
        writable(source),
        writable(source_normals if checks_sides and source_normals is not None else np.empty((0, 3))),
        target.index,
        target.normals,
        gates_m,
        n_shrinking(gates_m, settings),
        STOP_RULES[settings.stop],
        settings.metric == "plane",
        np.zeros(3),
    )
    return Aligned(transform(R, t), n_iterations, n_matches, float(np.sqrt(mse)))


def trimmed_align(source: Float, target: Float | Cloud, settings: TricpSettings) -> Aligned:
    """Aligns a cloud (N, 3) to another by trimmed ICP, starting where they are."""
    n_used = int(settings.trim * len(source))
    if n_used < FEWEST_POINTS or (not isinstance(target, Cloud) and len(target) == 0):
        return Aligned(np.eye(4), 0, 0, 0.0)
    target = target if isinstance(target, Cloud) else Cloud(target)
    R, t, n_passes, energy = trimmed_loop(
        writable(source), target.index, target.leaves, n_used, settings.energy_ratio, settings.max_passes
    )
    return Aligned(transform(R, t), n_passes, n_used, float(np.sqrt(energy / n_used)))
