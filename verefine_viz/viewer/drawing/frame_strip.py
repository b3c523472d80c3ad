"""The frames of a sequence as a strip: how the recorded pose changes from one to the next; a click opens a frame."""

from __future__ import annotations

from collections.abc import Sequence

from verefine_viz.core.palette import EVENT_COLORS
from verefine_viz.evaluation.near_symmetry import flips
from verefine_viz.evaluation.pose_motion import JUMP_DEG, JUMP_MM, Motion, PosedFrame, counted, motions
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.drawing.markup import carries, text
from verefine_viz.viewer.snapshot.snapshot import Snapshot

WIDTH, HEIGHT, MOST = 290, 34, 145
"""Size [px], and bars that have room: of more frames each stands for several, and shows the largest change."""
COLORS = {
    "flip": EVENT_COLORS["flipped"],
    "jump": EVENT_COLORS["score_fell"],
    "moved": (110, 150, 190),
    "no pose": (120, 120, 120),
}


def frame_strip(snapshot: Snapshot) -> str:
    """The summary and the strip; empty where the frames are no sequence."""
    if len(snapshot.track) < 2:
        return ""
    model = snapshot.target.model
    turns = flips(snapshot.near_symmetries or ())
    poses = [PosedFrame(frame, T) for frame, T in snapshot.track]
    changes = motions(poses, model.middle_m, turns)
    n = -(-len(changes) // MOST)
    groups = [changes[k : k + n] for k in range(0, len(changes), n)]
    width = WIDTH / len(groups)
    bars = "".join(_bar(group, k * width, width, snapshot.frame) for k, group in enumerate(groups))
    return (
        f'<p class="dim">{text(counted(changes).in_words)}</p><svg width="{WIDTH}" height="{HEIGHT}" '
        f'viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="change of the pose from frame to frame">{bars}</svg>'
    )


def _bar(group: Sequence[Motion], x: float, width: float, shown: str) -> str:
    """The largest change of some frames, as a share of what counts as a jump."""
    largest = max(group, key=_size)
    height = 0.0 if largest.kind == "no pose" else max(2.0, (HEIGHT - 8) * min(_size(largest), 1.0))
    change = largest.kind if largest.kind == "no pose" else f"{largest.moved_mm:.1f} mm, {largest.turned_deg:.1f}°"
    kind = f" ({largest.kind})" if largest.kind in ("flip", "jump") else ""
    is_open = any(motion.frame == shown for motion in group)
    mark = f'<rect x="{x:.1f}" y="{HEIGHT - 4}" width="{width:.1f}" height="4" fill="white"/>' if is_open else ""
    return (
        f'<g style="cursor:pointer" {carries(c.OpenFrame(largest.frame))}><title>frame {text(largest.frame)}: '
        f'{change}{kind}</title><rect x="{x:.1f}" y="0" width="{width:.1f}" height="{HEIGHT}" fill="transparent"/>'
        f'<rect x="{x + 0.1 * width:.1f}" y="{HEIGHT - 5 - height:.1f}" width="{0.8 * width:.1f}" '
        f'height="{height:.1f}" fill="rgb{COLORS[largest.kind]}"/>{mark}</g>'
    )


def _size(motion: Motion) -> float:
    """Flips and jumps before all others."""
    share = max(motion.moved_mm / JUMP_MM, motion.turned_deg / JUMP_DEG)
    return share + 1.0 if motion.kind in ("flip", "jump") else min(share, 1.0)
