"""Where the answers of a batch lie in the plot of score over error, and which of them a click is about."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from verefine_viz.viewer.state.gallery import ALL, Entry, Gallery

WIDTH, HEIGHT = 272, 150
LEFT, RIGHT, TOP, BOTTOM = 26, 6, 5, 26
"""Room for labels."""
SMALLEST, LARGEST = 0.003, 2.0
"""Ends of the axis of errors, as a share of the diameter; what lies beyond is drawn at the end."""
REACH_PX = 14.0
"""A click further away than this from any point is about none."""


class ScorePlot:
    """The plot of some answers; those without a score or without ground truth have no point."""

    def __init__(self, entries: Sequence[Entry]) -> None:
        self.entries = tuple(e for e in entries if e.row.relative_error is not None and e.row.score is not None)
        lowest = min((e.row.score or 0.0 for e in self.entries), default=0.0)
        self.low = min(math.floor(lowest * 10) / 10, 0.9)
        """Where the axis of scores begins."""

    def place(self, entry: Entry) -> tuple[float, float] | None:
        """Where an answer's point is [px of the plot]."""
        error, score = entry.row.relative_error, entry.row.score
        return None if error is None or score is None else (x_of(error), self.y(score))

    def nearest(self, u: float, v: float) -> Entry | None:
        """The answer whose point a click is about."""
        found = [(math.dist(at, (u, v)), entry) for entry in self.entries if (at := self.place(entry)) is not None]
        distance, entry = min(found, key=lambda pair: pair[0], default=(math.inf, None))
        return entry if distance <= REACH_PX else None

    def y(self, score: float) -> float:
        """Where a score is [px from the top]."""
        share = (min(max(score, self.low), 1.0) - self.low) / (1.0 - self.low)
        return HEIGHT - BOTTOM - share * (HEIGHT - TOP - BOTTOM)


def plot_of(gallery: Gallery, only: Mapping[str, str]) -> ScorePlot:
    """The plot of a gallery: right and wrong answers, of the object, method and run that are chosen."""
    chosen = {by: value for by, value in only.items() if by in ("object", "method", "run")}
    return ScorePlot(gallery.matching({**chosen, "result": ALL}))


def x_of(error: float) -> float:
    """Where an error is, as a share of the diameter [px from the left]."""
    share = math.log(min(max(error, SMALLEST), LARGEST) / SMALLEST) / math.log(LARGEST / SMALLEST)
    return LEFT + share * (WIDTH - LEFT - RIGHT)
