"""Consecutive iterations, and their numbers as arrays."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float
from verefine_viz.core.kernels import kernel
from verefine_viz.core.records import NO_CONTACTS, Contacts, Iteration, Stage


class Block:
    """n iterations with s poses in all: each one's stages in order, iteration after iteration."""

    def __init__(self, iterations: Sequence[Iteration], errors: Float) -> None:
        """Take at least one iteration, with errors (n, 3) against ground truth: rotation [deg] and translation [mm] of
        the accepted pose, ADD(-S) of the best pose [mm]; NaN where there is no ground truth.
        """
        self.iterations = iterations
        self.errors = errors
        self.indices = [i.index for i in self.iterations]
        self.stages = [stage for i in self.iterations for stage in i.stages]
        """(s,)."""
        self.n_stages = [len(i.stages) for i in self.iterations]
        self._firsts = np.cumsum([0, *self.n_stages[:-1]])
        """(n,) where each iteration's poses begin."""
        self.Ts_cam_obj = np.array([stage.T_cam_obj for stage in self.stages])
        """(s, 4, 4) [m]."""
        self._moved_mm, self._turned_deg = _motions(
            self.Ts_cam_obj, np.repeat(self._firsts, self.n_stages), np.arange(len(self.stages))
        )
        """(s,) distance of each pose from the first of its iteration: origins [mm], angle [°]."""

    def motions(self) -> Iterator[tuple[list[float], list[float]]]:
        """Distance of each stage from the first one of its iteration: origins [mm], angle [°]."""
        moved_mm, turned_deg = self._moved_mm.tolist(), self._turned_deg.tolist()
        for first, n in zip(self._firsts.tolist(), self.n_stages, strict=True):
            yield moved_mm[first : first + n], turned_deg[first : first + n]

    def own(self, instance_id: int) -> list[int]:
        """Whether each iteration is about that object."""
        return [k for k, i in enumerate(self.iterations) if i.instance_id == instance_id]

    @cached_property
    def fit(self) -> Float:
        """(n, 4) f_d and f_n of the simulated and of the refined pose; NaN where there are none."""
        pairs = ((i.stage("simulated"), i.stage("refined")) for i in self.iterations)
        return np.array([(*_fits(simulated), *_fits(refined)) for simulated, refined in pairs])

    @cached_property
    def physics(self) -> Float:
        """(n, 6) moved [mm] and turned [°] by simulation and by refiner, contacts, deepest penetration [mm]."""
        simulated, mixed, refined = self._firsts + np.array([_simulator_and_refiner(i) for i in self.iterations]).T
        contacts = [last_contacts(i) for i in self.iterations]
        out = np.empty((len(self.iterations), 6))
        out[:, 0], out[:, 1] = self._moved_mm[simulated], self._turned_deg[simulated]
        out[:, 2], out[:, 3] = _motions(self.Ts_cam_obj, mixed, refined)
        out[:, 4] = [len(c.depths_m) for c in contacts]
        out[:, 5] = [1e3 * max([0.0, *c.depths_m.tolist()]) for c in contacts]
        return out

    @cached_property
    def best_scores(self) -> Float:
        """(n,) f̄ of the best pose of each one's object so far."""
        return np.array([i.best.score.score for i in self.iterations])


def last_contacts(iteration: Iteration) -> Contacts:
    """The contacts at the end of an iteration's simulation."""
    path = iteration.path
    return path.contacts[-1] if path is not None and path.contacts else NO_CONTACTS


def _simulator_and_refiner(iteration: Iteration) -> tuple[int, int, int]:
    """Indices of the poses with which an iteration's simulation ended, the refiner began, and the refiner ended; where
    one did not run, of the pose before.
    """
    at = {stage.name: k for k, stage in enumerate(iteration.stages)}
    mixed = at.get("mixed", 0)
    return at.get("simulated", 0), mixed, at.get("refined", mixed)


def _fits(stage: Stage | None) -> tuple[float, float]:
    if stage is None or stage.score is None:
        return math.nan, math.nan
    return stage.score.depth_fit, stage.score.normal_fit


@kernel()
def _motions(Ts: Float, starts: NDArray[np.int64], ends: NDArray[np.int64]) -> tuple[Float, Float]:
    """From pose ``starts[k]`` to pose ``ends[k]``: mm between the origins, degrees."""
    moved_mm, turned_deg = np.empty(len(starts)), np.empty(len(starts))
    for k in range(len(starts)):
        A, B = Ts[starts[k]], Ts[ends[k]]
        trace, square = 0.0, 0.0
        for i in range(3):
            square += (B[i, 3] - A[i, 3]) ** 2
            for j in range(3):
                trace += A[i, j] * B[i, j]
        moved_mm[k] = 1e3 * math.sqrt(square)
        turned_deg[k] = math.degrees(math.acos(min(1.0, max(-1.0, (trace - 1.0) / 2.0))))
    return moved_mm, turned_deg
