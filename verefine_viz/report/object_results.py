"""The objects of groups: as columns that are summed by frame and seed, by model, and the hardest ones."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float, Mask
from verefine_viz.methods.registry import method_of
from verefine_viz.report.bootstrap import FEWEST_SCENES, Cells
from verefine_viz.report.groups import Group, Seeds, seeds_of
from verefine_viz.report.run_results import THRESHOLDS, Key, error_or_infinite, key
from verefine_viz.run.record import Answer

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
    can_be_right: Mask
    """(N,) whether there is ground truth."""
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
    lifted: Float
    """(N,) 1 where a simulated grasp by the answer succeeds, 0 where it does not."""

    @property
    def recall(self) -> Cells:
        """Share of objects that are right."""
        return self.cells(self.right, self.can_be_right)

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
        hits = np.zeros((*self.shape, len(THRESHOLDS)))
        # An error counts from the first threshold above it on.
        place = np.searchsorted(THRESHOLDS, self.relative, side="right")
        counts = self.can_be_right & (place < len(THRESHOLDS))
        np.add.at(hits, (self.unit[counts], self.seed[counts], place[counts]), 1.0)
        return np.cumsum(hits, axis=2)

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
        np.array([row.can_be_right for row in rows], np.bool_),
        np.array([row.is_correct is True for row in rows], np.bool_),
        np.array([error_or_infinite(row) for row in rows]),
        _known([row.add_s_mm if ok else None for row, ok in zip(rows, solved, strict=True)]),
        _known([row.rotation_deg for row in rows]),
        _known([row.translation_mm for row in rows]),
        _known([row.score if ok else None for row, ok in zip(rows, solved, strict=True)]),
        _known([None if row.status == "failed" else row.ms_total for row in rows]),
        _known(calls),
        _known([float(row.grasp == "success") if row.grasp else None for row in rows]),
    )


def _known(values: Sequence[float | None]) -> Float:
    return np.array([np.nan if value is None else value for value in values], np.float64)


def _scene(frame: str) -> str:
    return frame.partition("/")[0]


MOST_HARD = 40
"""Objects that are listed as hard."""


@dataclass
class Share:
    """How many of some answers are right."""

    right: int = 0
    n: int = 0

    def add(self, is_right: bool) -> None:
        self.right += is_right
        self.n += 1

    @property
    def value(self) -> float | None:
        """In [0, 1]; None of none."""
        return self.right / self.n if self.n else None


@dataclass(frozen=True)
class HeatRow:
    """One object model."""

    obj_id: int
    name: str
    total: Share
    by_group: tuple[Share, ...]


@dataclass
class ObjectOverGroups:
    """One object of one frame over all groups and seeds."""

    row: Answer
    """One of its rows, for names."""
    total: Share
    by_group: dict[str, Share] = field(default_factory=dict)
    causes: Counter[str] = field(default_factory=Counter)

    @property
    def frame(self) -> str:
        return self.row.frame

    @property
    def wrong_groups(self) -> int:
        """Groups that get it wrong with most seeds."""
        return sum(2 * share.right < share.n for share in self.by_group.values())

    @property
    def best(self) -> tuple[str, Share]:
        """The group that gets it right most often."""
        return max(self.by_group.items(), key=lambda item: item[1].value or 0.0)

    @property
    def cause(self) -> str:
        """The most frequent one; empty where none is known."""
        return self.causes.most_common(1)[0][0] if self.causes else ""


def heat(groups: Sequence[Group]) -> tuple[HeatRow, ...]:
    """Recall of each object model, by group in their order; only objects with ground truth."""
    rows: dict[int, HeatRow] = {}
    for k, group in enumerate(groups):
        for run in group.runs:
            for row in run.with_truth:
                if row.obj_id is not None:
                    fresh = HeatRow(row.obj_id, row.name, Share(), tuple(Share() for _ in groups))
                    mine = rows.setdefault(row.obj_id, fresh)
                    mine.total.add(row.is_correct is True)
                    mine.by_group[k].add(row.is_correct is True)
    return tuple(rows[obj_id] for obj_id in sorted(rows))


def by_frame(groups: Sequence[Group]) -> dict[Key, ObjectOverGroups]:
    """Each object of each frame over all groups and seeds; only objects with ground truth."""
    instances: dict[Key, ObjectOverGroups] = {}
    for group in groups:
        for run in group.runs:
            for row in run.with_truth:
                instance = instances.setdefault(key(row), ObjectOverGroups(row, Share()))
                instance.total.add(row.is_correct is True)
                instance.by_group.setdefault(group.name, Share()).add(row.is_correct is True)
                if row.cause:
                    instance.causes[row.cause] += 1
    return instances


def hardest(objects: Iterable[ObjectOverGroups]) -> tuple[ObjectOverGroups, ...]:
    """Those that most groups get wrong with most seeds, the hardest first."""
    most = [hard for hard in objects if 2 * hard.wrong_groups > len(hard.by_group)]
    return tuple(sorted(most, key=lambda hard: (-hard.wrong_groups, hard.total.value or 0.0, key(hard.row))))
