"""The score around an answer as SVG: small curves, one for each axis, and a heat map over two axes.

Text and lines take the colour of the page around them. Samples stand at equal distances, whatever their offsets: what
lies near the answer needs the most room, and a click falls on a sample.
"""

from __future__ import annotations

from html import escape

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.palette import EVENT_COLORS, STAGE_COLORS
from verefine_viz.evaluation.landscape import CANNOT_TELL, Curve, Landscape

LINE, FREE = STAGE_COLORS["best"], EVENT_COLORS["edited"]
"""Colours of a curve, and of what is undetermined."""
LEAST_SPAN = 0.02
"""A curve's scale covers at least so much of the score, so that noise is not drawn as mountains."""
MOST_SPAN = 0.3
"""And at most so much below the answer's score: what falls further leaves the picture."""


def curve_svg(curve: Curve, width: int = 168, height: int = 74, click: str = "") -> str:
    """The score along an axis, with what is undetermined shaded and twice the noise as a band below the answer's score.

    Args:
        curve: three samples or more.
        width: of the drawing [px].
        height: [px].
        click: attributes that make it send a command on a click, whose pixels are samples; empty = it is only shown.
    """
    n, top, bottom = len(curve.offsets), 13.0, height - 11.0
    x = (np.arange(n) + 0.5) * width / n
    here = float(curve.scores[np.flatnonzero(curve.offsets == 0)[0]])
    highest = float(curve.scores.max())
    lowest = max(float(curve.scores.min()), here - MOST_SPAN)
    lowest = min(lowest, highest - LEAST_SPAN)

    def y(score: Float) -> Float:
        return np.clip(bottom - (score - lowest) / (highest - lowest) * (bottom - top), top, bottom)

    left, right = np.interp([curve.low, curve.high], curve.offsets, x)
    band = [
        *zip(x, y(np.full(n, here)), strict=True),
        *zip(x[::-1], y(here - CANNOT_TELL * curve.noise[::-1]), strict=True),
    ]
    middle = float(np.interp(0, curve.offsets, x))
    ticks = "".join(
        f'<text x="{x[k]:.1f}" y="{height - 1}" text-anchor="{anchor}">{curve.offsets[k]:+g}</text>'
        for k, anchor in ((0, "start"), (n - 1, "end"))
    )
    frame = f'viewBox="0 0 {width} {height}" width="{width}" height="{height}"'
    return (
        f'<svg {frame} {click} role="img" aria-label="{escape(curve.axis.words)}">'
        f"<title>{escape(curve.in_words())}</title>"
        f'<rect width="{width}" height="{height}" fill="transparent"/>'
        f'<rect x="{left:.1f}" y="{top}" width="{max(right - left, 1.5):.1f}" height="{bottom - top:.1f}" '
        f'fill="rgb{FREE}" opacity="0.3"/>'
        f'<polygon points="{_points(band)}" fill="currentColor" opacity="0.15"/>'
        f'<path d="M{middle:.1f} {top}V{bottom}M0 {bottom}H{width}" stroke="currentColor" opacity="0.35" fill="none"/>'
        f'<polyline points="{_points(list(zip(x, y(curve.scores), strict=True)))}" fill="none" stroke="rgb{LINE}" '
        f'stroke-width="1.5"/>'
        f'<g font-size="10" fill="currentColor" stroke="none"><text x="2" y="9">{escape(curve.axis.words)}</text>'
        f'<text x="{width - 2}" y="9" text-anchor="end">{curve.width_text}</text>'
        f'<g opacity="0.7">{ticks}<text x="{middle:.1f}" y="{height - 1}" text-anchor="middle">0 {curve.axis.unit}'
        "</text></g></g></svg>"
    )


def worst_curves(around: Landscape) -> tuple[Curve, Curve]:
    """Where the observation cannot tell for longest: of the shifts, and of the turns."""
    shifts, turns = ([c for c in around.curves if c.axis.kind == kind] for kind in ("shift", "turn"))
    return max(shifts, key=lambda c: c.width), max(turns, key=lambda c: c.width)


def _points(points: list[tuple[float, float]]) -> str:
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
