"""Score over error, a point per answer: what is wrong and yet scored high lies in the upper right."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from verefine_viz.batch.misled import misled
from verefine_viz.evaluation.answers import CORRECT
from verefine_viz.viewer.commands import OpenPoint
from verefine_viz.viewer.drawing.markup import carries, text
from verefine_viz.viewer.drawing.plausibility import LIGHTS
from verefine_viz.viewer.state.gallery import ALL, Entry, Gallery

WIDTH, HEIGHT = 272, 150
LEFT, RIGHT, TOP, BOTTOM = 26, 6, 5, 26
"""Room for labels."""
SMALLEST, LARGEST = 0.003, 2.0
"""Ends of the axis of errors, as a share of the diameter; what lies beyond is drawn at the end."""
REACH_PX = 14.0
"""A click further away than this from any point is about none."""
_TICKS = (0.01, 0.03, 0.1, 0.3, 1.0)


class ScorePlot:
    """The plot of some answers; those without a score or without ground truth have no point."""

    def __init__(self, entries: Sequence[Entry]) -> None:
        self.entries = tuple(e for e in entries if e.row.relative_error is not None and e.row.score is not None)
        lowest = min((e.row.score or 0.0 for e in self.entries), default=0.0)
        self._low = min(math.floor(lowest * 10) / 10, 0.9)
        """Where the axis of scores begins."""

    def place(self, entry: Entry) -> tuple[float, float] | None:
        """Where an answer's point is [px of the plot]."""
        error, score = entry.row.relative_error, entry.row.score
        return None if error is None or score is None else (_x(error), self._y(score))

    def nearest(self, u: float, v: float) -> Entry | None:
        """The answer whose point a click is about."""
        found = [(math.dist(at, (u, v)), entry) for entry in self.entries if (at := self.place(entry)) is not None]
        distance, entry = min(found, key=lambda pair: pair[0], default=(math.inf, None))
        return entry if distance <= REACH_PX else None

    def words(self) -> str:
        """How far the score can be trusted, in a sentence."""
        share = misled(entry.row for entry in self.entries)
        if share is None:
            return "Score over error. Whether the score lies shows once there are right and wrong answers."
        verdict = "it tells them apart" if share < 0.05 else "it knows nothing" if share > 0.45 else "it lies at times"
        return f"In {share:.0%} of pairs the score ranks a wrong answer above a right one: {verdict} (chance: 50%)."

    def svg(self, opened: Entry | None) -> str:
        """The drawing; a click opens the nearest point, and a ring marks the answer that is open."""
        points: dict[bool, list[str]] = {True: [], False: []}
        for entry in self.entries:
            at = self.place(entry)
            if at is not None:
                points[bool(entry.row.is_correct)].append(f"M{at[0]:.1f} {at[1]:.1f}h0")
        size = 5 if len(self.entries) < 300 else 3.5
        drawn = "".join(
            f'<path d="{"".join(points[is_right])}" stroke="rgb{LIGHTS["green" if is_right else "red"]}" '
            f'stroke-width="{size}" stroke-linecap="round" opacity="0.75"/>'
            for is_right in (True, False)
        )
        at = self.place(opened) if opened is not None else None
        if at is not None:
            ring = f'cx="{at[0]:.1f}" cy="{at[1]:.1f}" r="5.5" fill="none"'
            drawn += f'<circle {ring} stroke="black" stroke-width="4"/><circle {ring} stroke="white" stroke-width="2"/>'
        title = (
            "A point per object: green is right, red is wrong, the ring is the one that is open. Click one to open it."
        )
        box = f'width="{WIDTH}" height="{HEIGHT}"'
        return (
            f'<svg {box} viewBox="0 0 {WIDTH} {HEIGHT}" style="cursor:crosshair" {carries(OpenPoint(0, 0))} '
            f'data-crop="[0,0,{WIDTH},{HEIGHT}]" role="img" aria-label="score over error"><title>{text(title)}</title>'
            f'<rect {box} fill="transparent"/>{self._axes()}{drawn}</svg>'
        )

    def _axes(self) -> str:
        low, high = HEIGHT - BOTTOM, TOP
        parts = [f'<path d="M{LEFT} {high}V{low}H{WIDTH - RIGHT}" stroke="currentColor" opacity="0.5" fill="none"/>']
        for error in _TICKS:
            x = _x(error)
            parts.append(f'<text x="{x:.1f}" y="{low + 11}" text-anchor="middle">{100 * error:g}%</text>')
            parts.append(f'<path d="M{x:.1f} {low}v3" stroke="currentColor" opacity="0.5"/>')
        for score in (self._low, (self._low + 1) / 2, 1.0):
            y = self._y(score)
            parts.append(f'<text x="{LEFT - 4}" y="{y + 3:.1f}" text-anchor="end">{score:.3g}</text>')
            parts.append(f'<path d="M{LEFT} {y:.1f}H{WIDTH - RIGHT}" stroke="currentColor" opacity="0.12"/>')
        x = _x(CORRECT)
        parts.append(f'<path d="M{x:.1f} {high}V{low}" stroke="currentColor" stroke-dasharray="4 3" opacity="0.6"/>')
        parts.append(f'<text x="{(LEFT + WIDTH - RIGHT) / 2}" y="{low + 22}" text-anchor="middle">')
        parts.append("score over ADD(-S) as a share of the diameter</text>")
        return f'<g font-size="9" fill="currentColor" stroke="none">{"".join(parts)}</g>'

    def _y(self, score: float) -> float:
        share = (min(max(score, self._low), 1.0) - self._low) / (1.0 - self._low)
        return HEIGHT - BOTTOM - share * (HEIGHT - TOP - BOTTOM)


def plot_of(gallery: Gallery, only: Mapping[str, str]) -> ScorePlot:
    """The plot of a gallery: right and wrong answers, of the object, method and run that are chosen."""
    chosen = {by: value for by, value in only.items() if by in ("object", "method", "run")}
    return ScorePlot(gallery.matching({**chosen, "result": ALL}))


def _x(error: float) -> float:
    share = math.log(min(max(error, SMALLEST), LARGEST) / SMALLEST) / math.log(LARGEST / SMALLEST)
    return LEFT + share * (WIDTH - LEFT - RIGHT)
