"""Iterative closest points: the paper's refiner for point pair features (Sec. V). docs/methods.md 4.1.

The observed cloud is the source and the model's cloud the target, so that parts of the model that the sensor did not
see do not pull. It runs in the model's frame: the observed points are moved there, and one index of nearest points per
model serves all poses.

The default gate starts at half of the observed cloud's largest extent and shrinks, by the same factor each iteration,
to the published 0.1 of it; and a match counts only where the observed and the model's normal lie within 90°, which
keeps the seen front from being pulled to the model's back. docs/methods.md 4.1 gives the gain.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np

from verefine_viz.core.algorithm_settings import IcpSettings
from verefine_viz.core.arrays import Float, finite, writable
from verefine_viz.core.geometry import transform
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.observation import Observation
from verefine_viz.core.problem import Placed, Target
from verefine_viz.refiners.icp_kernel import ALL_ITERATIONS, PUBLISHED, TOLERANCE, refined_pose
from verefine_viz.refiners.nearest import NearestIndex, model_index, neighbours_first

FINAL_GATE = 0.1
"""Largest distance of a match as a share of the source's largest extent: the published one."""
FIRST_GATE = 0.5
"""Largest distance of a match in the first iteration of the shrinking gate."""
SHRINKING_ITERATIONS = 10
"""Iterations over which the gate shrinks."""
PUBLISHED_ITERATIONS = 2
"""Number of iterations of the published stop rule."""

STOP_RULES = {"max_iterations": ALL_ITERATIONS, "tolerance": TOLERANCE, "published": PUBLISHED}
"""The kernel's code for ``IcpSettings.stop``."""


@dataclass(frozen=True, eq=False)
class _Observed:
    """Data of a target that do not depend on the pose."""

    points_cam: Float
    """(N, 3) [m], neighbours first."""
    normals_cam: Float
    """(N, 3), or (0, 3) where sides are not checked."""
    gates_m: Float
    """(max_iterations,)."""
    n_shrinking: int
    """Number of iterations during which a small step does not end the loop."""


class Icp:
    """Refines a pose by ICP between the instance's observed cloud and its model's."""

    def __init__(self, settings: IcpSettings) -> None:
        self.settings = settings
        self._models: WeakKeyDictionary[ObjectModel, tuple[NearestIndex, Float]] = WeakKeyDictionary()
        """The index of each model's points, and their normals (M, 3)."""
        self._observed: WeakKeyDictionary[Target, _Observed] = WeakKeyDictionary()

    def refine(self, target: Target, T_cam_obj: Float, fixed: Sequence[Placed] = ()) -> Float:
        """The refined pose (4, 4); the given one where the observed cloud is empty or nothing lies within the gate."""
        if len(target.instance.points_cam) == 0 or len(target.model.points) == 0:
            return T_cam_obj
        observed, (index, normals) = self._seen(target), self._model(target.model)
        pose = finite(T_cam_obj, "pose to refine", (4, 4))
        R, t, n_iterations = refined_pose(
            pose[:3, :3].copy(),
            pose[:3, 3].copy(),
            observed.points_cam,
            observed.normals_cam,
            index,
            normals,
            observed.gates_m,
            observed.n_shrinking,
            STOP_RULES[self.settings.stop],
            self.settings.metric == "plane",
        )
        return T_cam_obj if n_iterations == 0 else transform(R, t)

    def _seen(self, target: Target) -> _Observed:
        observed = self._observed.get(target)
        if observed is None:
            points_cam = target.instance.points_cam
            points_cam = points_cam[neighbours_first(points_cam)]
            checks_sides = self.settings.matches == "same_side"
            normals_cam = observed_normals(target.observation, points_cam) if checks_sides else np.empty((0, 3))
            gates_m = gate_schedule_m(largest_extent_m(points_cam), self.settings)
            observed = _Observed(
                writable(points_cam), writable(normals_cam), gates_m, n_shrinking(gates_m, self.settings)
            )
            self._observed[target] = observed
        return observed

    def _model(self, model: ObjectModel) -> tuple[NearestIndex, Float]:
        ready = self._models.get(model)
        if ready is None:
            index = model_index(model)
            ready = self._models[model] = index, writable(model.point_normals[index.order])
        return ready


def largest_extent_m(points: Float) -> float:
    """The longest side of the axis-aligned box around points (N, 3), N ≥ 1 [m]."""
    return max(float(np.ptp(points[:, k])) for k in range(3))


def gate_schedule_m(extent_m: float, settings: IcpSettings) -> Float:
    """Largest distance of a match in each inner iteration, (max_iterations,) [m], for a source of this extent."""
    gates = np.full(settings.max_iterations, FINAL_GATE)
    if settings.gate == "shrinking":
        n = min(PUBLISHED_ITERATIONS if settings.stop == "published" else SHRINKING_ITERATIONS, settings.max_iterations)
        gates[:n] = FIRST_GATE * (FINAL_GATE / FIRST_GATE) ** (np.arange(n) / max(n - 1, 1))
    return gates * extent_m


def n_shrinking(gates_m: Float, settings: IcpSettings) -> int:
    """Number of iterations during which a small step does not end the loop, because the gate still changes."""
    return 0 if settings.stop == "published" else int(gates_m.argmin())


def observed_normals(observation: Observation, points_cam: Float) -> Float:
    """The observation's normals (N, 3) at the pixels where points (N, 3) of the camera frame appear; 0 if unknown."""
    height, width = observation.camera.shape
    u, v = np.rint(observation.camera.project(points_cam)).astype(np.int64).T
    inside = (u >= 0) & (u < width) & (v >= 0) & (v < height)
    normals = np.zeros((len(points_cam), 3))
    normals[inside] = observation.normals_cam[v[inside], u[inside]]
    return normals
