"""Two runs, object by object: who got better, who got worse."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from verefine_viz.report.run_results import LoadedRun, error_or_infinite, key
from verefine_viz.run.record import Answer

SAME = 0.005
"""Errors that differ by less than this share of the diameter count as the same."""


@dataclass(frozen=True)
class Change:
    """One object of one frame in both runs."""

    a: Answer
    b: Answer

    @property
    def frame(self) -> str:
        return self.a.frame

    @property
    def error_a(self) -> float:
        """As a share of the diameter; infinite without an answer."""
        return error_or_infinite(self.a)

    @property
    def error_b(self) -> float:
        return error_or_infinite(self.b)

    @property
    def by(self) -> float:
        """Error of B less that of A, as a share of the diameter: negative where B is better."""
        if math.isinf(self.error_a) or math.isinf(self.error_b):
            return 0.0 if self.error_a == self.error_b else math.copysign(math.inf, self.error_b - self.error_a)
        return self.error_b - self.error_a

    @property
    def turned(self) -> str:
        """Whether it became right or wrong."""
        before, after = self.a.is_correct is True, self.b.is_correct is True
        return "" if before == after else ("now right" if after else "now wrong")


@dataclass(frozen=True)
class FrameChange:
    """One frame in both runs."""

    frame: str
    n_objects: int
    mean_a: float
    """Mean error over the objects that both runs have an answer for, as a share of the diameter; NaN without any."""
    mean_b: float
    n_right_a: int
    n_right_b: int


@dataclass(frozen=True)
class Difference:
    """All objects that both runs are about, with ground truth."""

    changes: tuple[Change, ...]
    """Most improved first."""
    frames: tuple[FrameChange, ...]
    """Most improved first."""
    only_a: int
    """Objects that the other run does not have."""
    only_b: int

    @property
    def better(self) -> tuple[Change, ...]:
        """Objects that B has clearly better, by how much."""
        return tuple(c for c in self.changes if c.by < -SAME)

    @property
    def worse(self) -> tuple[Change, ...]:
        """Objects that B has clearly worse, the worst first."""
        return tuple(c for c in reversed(self.changes) if c.by > SAME)


def difference(a: LoadedRun, b: LoadedRun) -> Difference:
    """What changed from A to B."""
    of_a, of_b = ({key(row): row for row in run.objects} for run in (a, b))
    with_truth = {key(row) for row in (*a.with_truth, *b.with_truth)}
    both = [Change(row, of_b[k]) for k, row in of_a.items() if k in of_b and k in with_truth]
    changes = sorted(both, key=lambda change: (change.by, change.frame))
    groups: dict[str, list[Change]] = {}
    for change in changes:
        groups.setdefault(change.frame, []).append(change)
    frames = sorted((_frame(frame, group) for frame, group in groups.items()), key=_frame_order)
    return Difference(tuple(changes), tuple(frames), len(of_a.keys() - of_b.keys()), len(of_b.keys() - of_a.keys()))


def _frame(frame: str, group: Sequence[Change]) -> FrameChange:
    both = [(c.error_a, c.error_b) for c in group if math.isfinite(c.error_a) and math.isfinite(c.error_b)]
    mean_a, mean_b = np.mean(both, axis=0).tolist() if both else (math.nan, math.nan)
    right_a = sum(c.a.is_correct is True for c in group)
    right_b = sum(c.b.is_correct is True for c in group)
    return FrameChange(frame, len(group), mean_a, mean_b, right_a, right_b)


def _frame_order(frame: FrameChange) -> tuple[float, str]:
    by = frame.mean_b - frame.mean_a
    return 0.0 if math.isnan(by) else by, frame.frame
