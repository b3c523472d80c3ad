"""The plot of score over error, a point per answer: what is wrong and yet scored high lies in the upper right."""

from __future__ import annotations

from verefine_viz.batch.totals import misranked_share
from verefine_viz.evaluation.answers import CORRECT
from verefine_viz.viewer.commands import OpenPoint
from verefine_viz.viewer.drawing.markup import carries, text
from verefine_viz.viewer.drawing.plausibility import LIGHTS
from verefine_viz.viewer.snapshot.score_plot import BOTTOM, HEIGHT, LEFT, RIGHT, TOP, WIDTH, ScorePlot, x_of
from verefine_viz.viewer.state.gallery import Entry

_TICKS = (0.01, 0.03, 0.1, 0.3, 1.0)


def words(plot: ScorePlot) -> str:
    """How far the score can be trusted, in a sentence."""
    share = misranked_share(entry.row for entry in plot.entries)
    if share is None:
        return "Score over error. Whether the score lies shows once there are right and wrong answers."
    verdict = "it tells them apart" if share < 0.05 else "it knows nothing" if share > 0.45 else "it lies at times"
    return f"In {share:.0%} of pairs the score ranks a wrong answer above a right one: {verdict} (chance: 50%)."


def svg(plot: ScorePlot, opened: Entry | None) -> str:
    """The drawing; a click opens the nearest point, and a ring marks the answer that is open."""
    points: dict[bool, list[str]] = {True: [], False: []}
    for entry in plot.entries:
        at = plot.place(entry)
        if at is not None:
            points[bool(entry.row.is_correct)].append(f"M{at[0]:.1f} {at[1]:.1f}h0")
    size = 5 if len(plot.entries) < 300 else 3.5
    drawn = "".join(
        f'<path d="{"".join(points[is_right])}" stroke="rgb{LIGHTS["green" if is_right else "red"]}" '
        f'stroke-width="{size}" stroke-linecap="round" opacity="0.75"/>'
        for is_right in (True, False)
    )
    at = plot.place(opened) if opened is not None else None
    if at is not None:
        ring = f'cx="{at[0]:.1f}" cy="{at[1]:.1f}" r="5.5" fill="none"'
        drawn += f'<circle {ring} stroke="black" stroke-width="4"/><circle {ring} stroke="white" stroke-width="2"/>'
    title = "A point per object: green is right, red is wrong, the ring is the one that is open. Click one to open it."
    box = f'width="{WIDTH}" height="{HEIGHT}"'
    return (
        f'<svg {box} viewBox="0 0 {WIDTH} {HEIGHT}" style="cursor:crosshair" {carries(OpenPoint(0, 0))} '
        f'data-crop="[0,0,{WIDTH},{HEIGHT}]" role="img" aria-label="score over error"><title>{text(title)}</title>'
        f'<rect {box} fill="transparent"/>{_axes(plot)}{drawn}</svg>'
    )


def _axes(plot: ScorePlot) -> str:
    low, high = HEIGHT - BOTTOM, TOP
    parts = [f'<path d="M{LEFT} {high}V{low}H{WIDTH - RIGHT}" stroke="currentColor" opacity="0.5" fill="none"/>']
    for error in _TICKS:
        x = x_of(error)
        parts.append(f'<text x="{x:.1f}" y="{low + 11}" text-anchor="middle">{100 * error:g}%</text>')
        parts.append(f'<path d="M{x:.1f} {low}v3" stroke="currentColor" opacity="0.5"/>')
    for score in (plot.low, (plot.low + 1) / 2, 1.0):
        y = plot.y(score)
        parts.append(f'<text x="{LEFT - 4}" y="{y + 3:.1f}" text-anchor="end">{score:.3g}</text>')
        parts.append(f'<path d="M{LEFT} {y:.1f}H{WIDTH - RIGHT}" stroke="currentColor" opacity="0.12"/>')
    x = x_of(CORRECT)
    parts.append(f'<path d="M{x:.1f} {high}V{low}" stroke="currentColor" stroke-dasharray="4 3" opacity="0.6"/>')
    parts.append(f'<text x="{(LEFT + WIDTH - RIGHT) / 2}" y="{low + 22}" text-anchor="middle">')
    parts.append("score over ADD(-S) as a share of the diameter</text>")
    return f'<g font-size="9" fill="currentColor" stroke="none">{"".join(parts)}</g>'
