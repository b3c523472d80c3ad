"""Rows that follow one another, and the numbers of all of them as arrays: made at once, they cost a fraction."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from functools import cached_property
from itertools import accumulate

import numpy as np
from numba import njit
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float
from verefine_viz.recording.row import Row

FIT = (("simulated", 1), ("simulated", 2), ("refined", 1), ("refined", 2))
"""Stage and column of ``Row.scores``: f_d and f_n of both candidates."""


class Block:
    """n rows with s poses in all: each row's stages in order, row after row."""

    def __init__(self, rows: Sequence[Row]) -> None:
        """There must be at least one."""
        self.rows = rows
        self.iterations = [r.index for r in rows]
        self.n_stages = [len(r.stages) for r in rows]
        self.firsts = np.fromiter(accumulate(self.n_stages[:-1], initial=0), np.int64, len(rows))
        """(n,) where each row's poses begin."""
        self.Ts_cam_obj: Float = np.concatenate([r.Ts_cam_obj for r in rows])
        """(s, 4, 4) [m]."""
        self.scores: Float = np.concatenate([r.scores for r in rows])
        """(s, 3) as ``Row.scores``."""
        self.moved_mm, self.turned_deg = _ways(
            self.Ts_cam_obj, np.repeat(self.firsts, self.n_stages), np.arange(len(self.Ts_cam_obj))
        )
        """(s,) how far each pose is from the first of its row: origins, angle."""

    def ways(self) -> Iterator[tuple[list[float], list[float]]]:
        """``moved_mm`` and ``turned_deg`` of each row."""
        moved_mm, turned_deg = self.moved_mm.tolist(), self.turned_deg.tolist()
        for first, n in zip(self.firsts.tolist(), self.n_stages, strict=True):
            yield moved_mm[first : first + n], turned_deg[first : first + n]

    def own(self, instance_id: int) -> list[int]:
        """Which rows are about that object."""
        return [k for k, row in enumerate(self.rows) if row.instance_id == instance_id]

    @cached_property
    def fit(self) -> Float:
        """(n, 4) the scores of :data:`FIT`; NaN where there are none."""
        out = np.full((len(self.rows), len(FIT)), np.nan)
        for k, (stage, column) in enumerate(FIT):
            places = self._places(stage)
            known = places >= 0
            out[known, k] = self.scores[places[known], column]
        return out

    @cached_property
    def physics(self) -> Float:
        """(n, 6) moved [mm] and turned [°] by simulation and by refiner, contacts, deepest penetration [mm]."""
        simulated, mixed, refined = (self._places(stage) for stage in ("simulated", "mixed", "refined"))
        simulated, mixed = np.where(simulated < 0, self.firsts, simulated), np.where(mixed < 0, self.firsts, mixed)
        out = np.empty((len(self.rows), 6))
        out[:, 0], out[:, 1] = self.moved_mm[simulated], self.turned_deg[simulated]
        out[:, 2], out[:, 3] = _ways(self.Ts_cam_obj, mixed, np.where(refined < 0, mixed, refined))
        out[:, 4] = [len(r.contacts) for r in self.rows]
        out[:, 5] = [1e3 * max([0.0, *r.contacts[:, 6].tolist()]) for r in self.rows]
        return out

    @cached_property
    def errors(self) -> Float:
        """(n, 3) as ``Row.errors``."""
        return np.array([r.errors for r in self.rows])

    @cached_property
    def best_scores(self) -> Float:
        """(n, 3) as ``Row.best_score``."""
        return np.array([r.best_score for r in self.rows])

    def _places(self, stage: str) -> NDArray[np.int64]:
        """(n,) where the poses of that stage are; −1 in rows without it."""
        found = [r.stages.index(stage) if stage in r.stages else -1 for r in self.rows]
        within = np.array(found, np.int64)
        return np.where(within < 0, within, within + self.firsts)


@njit(cache=True)
def _ways(Ts: Float, starts: NDArray[np.int64], ends: NDArray[np.int64]) -> tuple[Float, Float]:
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
