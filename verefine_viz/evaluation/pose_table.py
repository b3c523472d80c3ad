"""The estimates of one method as columns: what a BOP results file says, or a run's own answers."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.scenes.results import ResultRow, method_of, read_lines

Image = tuple[int, int]
"""(scene_id, im_id)."""


@dataclass(frozen=True, eq=False)
class PoseTable:
    """N estimates in the order of their file; poses are used as they are written, also where R is no exact rotation."""

    name: str
    """The method's."""
    ids: tuple[tuple[int, int, int], ...]
    """(scene_id, im_id, obj_id) of each."""
    scores: Float
    """(N,)."""
    R: Float
    """(N, 3, 3)."""
    t_mm: Float
    """(N, 3) [mm]."""
    time_s: Float
    """(N,) seconds for the whole image; negative = unknown."""

    def __len__(self) -> int:
        return len(self.ids)

    @cached_property
    def by_image(self) -> Mapping[Image, Mapping[int, Sequence[int]]]:
        """Rows of each image and object, in the order of the file."""
        found: dict[Image, dict[int, list[int]]] = {}
        for row, (scene_id, im_id, obj_id) in enumerate(self.ids):
            found.setdefault((scene_id, im_id), {}).setdefault(obj_id, []).append(row)
        return found

    @property
    def mean_time_s(self) -> float:
        """Mean time of the images that occur [s]; -1 as soon as one time is negative, as the toolkit has it."""
        if not len(self) or (self.time_s < 0).any():
            return -1.0
        first: dict[Image, float] = {}
        for (scene_id, im_id, _), seconds in zip(self.ids, self.time_s, strict=True):
            first.setdefault((scene_id, im_id), float(seconds))
        return float(np.mean(list(first.values())))

    def best_first(self, rows: Iterable[int]) -> list[int]:
        """Rows by descending score; equal ones keep their order."""
        return sorted(rows, key=lambda row: self.scores[row], reverse=True)


def read_pose_table(path: Path | str) -> PoseTable:
    """A results file as the official toolkit reads it.

    Raises:
        InputError: the official format check refuses it; the line and the reason are named.
    """
    lines = read_lines(path)
    return PoseTable(
        method_of(path),
        tuple((line.scene_id, line.im_id, line.obj_id) for line in lines),
        np.array([line.score for line in lines]),
        np.stack([line.R for line in lines]),
        np.stack([line.t_mm for line in lines]),
        np.array([line.time_s for line in lines]),
    )


def pose_table(name: str, rows: Sequence[ResultRow]) -> PoseTable:
    """Estimates that are in memory, such as a batch's own answers; there may be none."""
    Ts_cam_obj = np.array([row.T_cam_obj for row in rows]).reshape(-1, 4, 4)
    return PoseTable(
        name,
        tuple((row.scene_id, row.im_id, row.obj_id) for row in rows),
        np.array([row.score for row in rows], dtype=np.float64),
        np.ascontiguousarray(Ts_cam_obj[:, :3, :3]),
        Ts_cam_obj[:, :3, 3] * 1e3,
        np.array([row.time_s for row in rows], dtype=np.float64),
    )
