"""The objects of a group as columns, and what they come to by frame and seed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float, Mask
from verefine_viz.methods.registry import method_of
from verefine_viz.report.groups import Group, Seeds, seeds_of
from verefine_viz.report.loaded import error_or_infinite
from verefine_viz.report.numbers import THRESHOLDS
from verefine_viz.report.spread import FEWEST_SCENES, Cells

Index = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class Axes:
    """The frames and seeds of all groups."""

    frames: tuple[str, ...]
    seeds: tuple[Seeds, ...]

    @cached_property
    def by_scene(self) -> bool:
        """Whether what is drawn are scenes rather than frames."""
        return len({_scene(frame) for frame in self.frames}) >= FEWEST_SCENES

    @cached_property
    def unit_of(self) -> dict[str, int]:
        """Frame → row of the cells."""
        units = [_scene(frame) if self.by_scene else frame for frame in self.frames]
        place = {unit: k for k, unit in enumerate(dict.fromkeys(units))}
        return {frame: place[unit] for frame, unit in zip(self.frames, units, strict=True)}

    @cached_property
    def seed_of(self) -> dict[Seeds, int]:
        """Seeds of a run → column of the cells."""
        return {seeds: k for k, seeds in enumerate(self.seeds)}

    @property
    def shape(self) -> tuple[int, int]:
        """Of cells."""
        return max(self.unit_of.values()) + 1, len(self.seeds)


@dataclass(frozen=True, eq=False)
class Outcomes:
    """N objects of one group. NaN = unknown."""

    shape: tuple[int, int]
    unit: Index
    """(N,) row of the cells."""
    seed: Index
    """(N,) column of the cells."""
    frame: Index
    """(N,) index into the axes' frames."""
    truth: Mask
    """(N,) whether it can be right or wrong."""
    right: Mask
    """(N,) ADD(-S) below 10 % of the diameter."""
    relative: Float
    """(N,) ADD(-S) as a share of the diameter; infinite without an answer."""
    add_s_mm: Float
    rotation_deg: Float
    translation_mm: Float
    score: Float
    ms: Float
    """(N,) unknown in failed frames."""
    calls: Float
    """(N,) refiner calls of an answer."""

    @property
    def recall(self) -> Cells:
        """Share of objects that are right."""
        return self.cells(self.right, self.truth)

    @property
    def frame_times(self) -> tuple[Float, Index, Index]:
        """Computing time of the iterations for each frame and seed [ms], with its row and column of the cells."""
        timed = np.isfinite(self.ms)
        unit, seed, frame = self.unit[timed], self.seed[timed], self.frame[timed]
        _, first, place = np.unique(np.stack([frame, seed]), axis=1, return_index=True, return_inverse=True)
        return np.bincount(place.ravel(), self.ms[timed]).astype(np.float64), unit[first], seed[first]

    @property
    def hits(self) -> Float:
        """(U, S, T) objects below each of the thresholds of the recall curve."""
        found = np.zeros((*self.shape, len(THRESHOLDS)))
        # An error counts from the first threshold above it on.
        place = np.searchsorted(THRESHOLDS, self.relative, side="right")
        counts = self.truth & (place < len(THRESHOLDS))
        np.add.at(found, (self.unit[counts], self.seed[counts], place[counts]), 1.0)
        return np.cumsum(found, axis=2)

    def cells(self, values: NDArray[np.generic], counts: Mask | None = None) -> Cells:
        """Sums of (N,) ``values`` over what counts, by default what is known."""
        column = np.asarray(values, np.float64)
        valid = np.isfinite(column) if counts is None else counts
        return Cells(self._sum(np.where(valid, column, 0.0)), self._sum(valid))

    def _sum(self, values: NDArray[np.generic]) -> Float:
        out = np.zeros(self.shape)
        np.add.at(out, (self.unit, self.seed), np.asarray(values, np.float64))
        return out


def axes_of(groups: Sequence[Group]) -> Axes:
    """The frames and seeds that occur in some run."""
    runs = [run for group in groups for run in group.runs]
    frames = dict.fromkeys(frame for run in runs for frame in run.frames)
    return Axes(tuple(frames), tuple(sorted({seeds_of(run) for run in runs})))


def outcomes_of(group: Group, axes: Axes) -> Outcomes:
    """The objects of a group; those of failed frames have no answer."""
    rows = group.objects
    frames = [row.frame for row in rows]
    place = {frame: k for k, frame in enumerate(axes.frames)}
    solved = [row.status == "ok" for row in rows]
    is_counted = not method_of(group.method).has_tree
    calls = [row.n_iterations if ok and is_counted else None for row, ok in zip(rows, solved, strict=True)]
    return Outcomes(
        axes.shape,
        np.array([axes.unit_of[frame] for frame in frames], np.intp),
        np.array([axes.seed_of[seeds_of(run)] for run in group.runs for _ in run.objects], np.intp),
        np.array([place[frame] for frame in frames], np.intp),
        np.array([row.has_truth or row.add_s_mm is not None for row in rows], np.bool_),
        np.array([row.is_correct is True for row in rows], np.bool_),
        np.array([error_or_infinite(row) for row in rows]),
        _known([row.add_s_mm if ok else None for row, ok in zip(rows, solved, strict=True)]),
        _known([row.rotation_deg for row in rows]),
        _known([row.translation_mm for row in rows]),
        _known([row.score if ok else None for row, ok in zip(rows, solved, strict=True)]),
        _known([None if row.status == "failed" else row.ms_total for row in rows]),
        _known(calls),
    )


def _known(values: Sequence[float | None]) -> Float:
    return np.array([np.nan if value is None else value for value in values], np.float64)


def _scene(frame: str) -> str:
    return frame.partition("/")[0]
