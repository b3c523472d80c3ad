"""The frames of a sequence as a strip: how the pose changes, and below it scores, what is undetermined, missing depth.

A click opens a frame; moving the mouse with its button held opens one after the other (``assets/page.js``).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from verefine_viz.core.palette import EVENT_COLORS, RGB, STAGE_COLORS
from verefine_viz.evaluation.pose_motion import JUMP_DEG, JUMP_MM, Motion, counted
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.drawing.markup import carries, text
from verefine_viz.viewer.snapshot.frame_track import TrackFrame

WIDTH, MOTION_PX, ROW_PX, GAP_PX, MOST = 290, 28, 18, 3, 145
"""Size [px], and columns that have room: of more frames each stands for several, and shows the largest of each row."""
COLORS: dict[str, RGB] = {
    "flip": EVENT_COLORS["flipped"],
    "jump": EVENT_COLORS["score_fell"],
    "moved": (110, 150, 190),
    "no pose": (120, 120, 120),
}
UNDETERMINED_MM = 30.0
"""What fills the row: as far as is looked."""
Column = Sequence[TrackFrame]


@dataclass(frozen=True)
class Bars:
    """A row of the strip: a bar for each column."""

    label: str
    hint: str
    color: RGB
    share: Callable[[TrackFrame], float | None]
    """How much of the row's height a frame fills, from 0 to 1; None = unknown."""


def _undetermined(one: TrackFrame) -> float | None:
    return None if one.undetermined_mm is None else one.undetermined_mm / UNDETERMINED_MM


ROWS = (
    Bars("no depth", "share of the object's mask without depth", (170, 140, 90), lambda f: f.missing_depth),
    Bars("± mm", "how far the answer may be shifted: full at 30 mm", (150, 120, 190), _undetermined),
)


def frame_strip(track: Column, frame: str) -> str:
    """The summary and the strip, with the open frame marked; empty where the frames are no sequence."""
    if len(track) < 2:
        return ""
    n = -(-len(track) // MOST)
    columns = [track[k : k + n] for k in range(0, len(track), n)]
    width = WIDTH / len(columns)
    parts = ["".join(_motion(column, k * width, width) for k, column in enumerate(columns))]
    top = MOTION_PX + GAP_PX
    for row in (_scores(columns, width), *(_bars(row, columns, width) for row in ROWS)):
        if row:
            parts.append(f'<g transform="translate(0 {top})">{row}</g>')
            top += ROW_PX + GAP_PX
    for k, column in enumerate(columns):
        if any(one.frame == frame for one in column):
            parts.append(f'<rect x="{k * width:.1f}" width="{max(width, 1.5):.1f}" height="{top}" class="open"/>')
    targets = "".join(_target(column, k * width, width, top) for k, column in enumerate(columns))
    return (
        f'<p class="dim">{text(counted([one.motion for one in track]).in_words)}</p>'
        f'<svg class="frames" data-scrub="" width="{WIDTH}" height="{top}" viewBox="0 0 {WIDTH} {top}" role="img" '
        f'aria-label="the object from frame to frame">{"".join(parts)}{targets}</svg>'
    )


def _motion(column: Column, x: float, width: float) -> str:
    """The largest change, as a share of what counts as a jump."""
    largest = max((one.motion for one in column), key=_size)
    height = 0.0 if largest.kind == "no pose" else max(2.0, MOTION_PX * min(_size(largest), 1.0))
    if largest.kind == "no pose":
        return f'<rect x="{x:.1f}" y="{MOTION_PX - 1}" width="{width:.1f}" height="1" fill="rgb{COLORS["no pose"]}"/>'
    return _bar(x, width, MOTION_PX, height, COLORS[largest.kind])


def _bar(x: float, width: float, floor: float, height: float, color: RGB) -> str:
    return (
        f'<rect x="{x + 0.1 * width:.1f}" y="{floor - height:.1f}" width="{0.8 * width:.1f}" height="{height:.1f}" '
        f'fill="rgb{color}"/>'
    )


def _scores(columns: Sequence[Column], width: float) -> str:
    """Our score as a line from 0 to 1 and the recorded one from its lowest to its highest; empty without any."""
    lines = []
    for label, color, dash, value in (
        ("score", STAGE_COLORS["best"], "", lambda f: f.score),
        ("theirs", STAGE_COLORS["edited"], ' stroke-dasharray="3 2"', lambda f: f.recorded_score),
    ):
        # Of several frames the worst, which is what is looked for.
        of_columns = [[v for one in column if (v := value(one)) is not None] for column in columns]
        known = [(k, min(values)) for k, values in enumerate(of_columns) if values]
        if not known:
            continue
        low, high = (0.0, 1.0) if label == "score" else (min(v for _, v in known), max(v for _, v in known))
        points = [((k + 0.5) * width, _height(v, low, high)) for k, v in known]
        drawn = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
        lines.append(f'<polyline points="{drawn}" fill="none" stroke="rgb{color}" stroke-width="1.3"{dash}/>')
        if len(points) <= MOST // 4:
            lines += [f'<circle cx="{x:.1f}" cy="{y:.1f}" r="1.6" fill="rgb{color}"/>' for x, y in points]
        x = 1 if label == "score" else 30
        lines.append(f'<text x="{x}" y="8" fill="rgb{color}" font-size="9">{label}</text>')
    return "".join(lines)


def _height(value: float, low: float, high: float) -> float:
    """From the top of a row."""
    share = (value - low) / (high - low) if high > low else 1.0
    return ROW_PX - 1 - (ROW_PX - 2) * min(max(share, 0.0), 1.0)


def _bars(row: Bars, columns: Sequence[Column], width: float) -> str:
    """A bar per column, the largest of its frames; empty where nothing is known."""
    bars = []
    for k, column in enumerate(columns):
        shares = [share for one in column if (share := row.share(one)) is not None]
        if shares:
            bars.append(_bar(k * width, width, ROW_PX, (ROW_PX - 1) * min(max(shares), 1.0), row.color))
    label = f'<text x="1" y="8" fill="currentColor" font-size="9" opacity="0.7">{text(row.label)}</text>'
    return "".join(bars) + label if bars else ""


def _target(column: Column, x: float, width: float, height: float) -> str:
    """What is clicked, and says what the column's frame is about: where it flips or jumps, else the largest change."""
    chosen = max(column, key=lambda one: _size(one.motion))
    return (
        f'<rect x="{x:.1f}" width="{width:.2f}" height="{height}" fill="transparent" '
        f"{carries(c.OpenFrame(chosen.frame))}><title>{text(_words(chosen))}</title></rect>"
    )


def _words(one: TrackFrame) -> str:
    motion = one.motion
    parts = ["no pose" if motion.kind == "no pose" else f"{motion.moved_mm:.1f} mm, {motion.turned_deg:.1f}°"]
    parts[0] += f" ({motion.kind})" if motion.kind in ("flip", "jump") else ""
    if motion.lifted_mm is not None and motion.tilted_deg is not None:
        parts.append(f"on the table {motion.lifted_mm:+.1f} mm, {motion.tilted_deg:.1f}°")
    parts += [f"score {one.score:.2f}"] if one.score is not None else []
    parts += [f"theirs {one.recorded_score:.3g}"] if one.recorded_score is not None else []
    if one.undetermined_mm is not None and one.undetermined_deg is not None:
        parts.append(f"undetermined by {one.undetermined_mm:.0f} mm, {one.undetermined_deg:.0f}°")
    parts += [f"{one.missing_depth:.0%} without depth"] if one.missing_depth is not None else []
    return f"frame {one.frame}: {'; '.join(parts)}"


def _size(motion: Motion) -> float:
    """Flips and jumps before all others."""
    share = max(motion.moved_mm / JUMP_MM, motion.turned_deg / JUMP_DEG)
    return share + 1.0 if motion.kind in ("flip", "jump") else min(share, 1.0)
