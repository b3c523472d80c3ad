"""How a pose changes from frame to frame of a sequence: how far, and where it flips or jumps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import angle_between

FLIP_DEG, NEAR_DEG = 30.0, 20.0
"""A flip turns by more than the first, and a near-symmetry of the shape explains it to less than the second."""
JUMP_DEG, JUMP_MM = 30.0, 50.0
"""A larger turn or shift between two frames that no near-symmetry explains is a jump."""

Kind = Literal["flip", "jump", "moved", "no pose"]


@dataclass(frozen=True)
class Motion:
    """What happened to the pose on the way to a frame."""

    frame: str
    kind: Kind
    """no pose: of this frame, or of all before it."""
    moved_mm: float = 0.0
    """Of the object's middle, relative to the camera, since the last frame with a pose."""
    turned_deg: float = 0.0


def motions(poses: Sequence[tuple[str, Float | None]], middle_m: Float, turns: Float) -> tuple[Motion, ...]:
    """One per frame.

    Args:
        poses: frame and T_cam_obj (4, 4) [m], or None, in order.
        middle_m: (3,) the object's middle in its own frame [m].
        turns: (N, 4, 4) turns of the object's frame after which its shape nearly looks the same; may be empty.
    """
    changes: list[Motion] = []
    before: Float | None = None
    for frame, T in poses:
        if T is None or before is None:
            changes.append(Motion(frame, "no pose" if T is None else "moved"))
        else:
            changes.append(_motion(frame, before, T, middle_m, turns))
        before = T if T is not None else before
    return tuple(changes)


def _motion(frame: str, before: Float, T: Float, middle_m: Float, turns: Float) -> Motion:
    moved_mm = 1e3 * float(np.linalg.norm((T - before)[:3, :3] @ middle_m + (T - before)[:3, 3]))
    turned_deg = float(np.degrees(angle_between(before[:3, :3], T[:3, :3])))
    left_deg = min(
        (float(np.degrees(angle_between((before @ turn)[:3, :3], T[:3, :3]))) for turn in turns), default=180.0
    )
    kind: Kind = "jump" if turned_deg > JUMP_DEG or moved_mm > JUMP_MM else "moved"
    if turned_deg > FLIP_DEG and left_deg < NEAR_DEG and moved_mm <= JUMP_MM:
        kind = "flip"
    return Motion(frame, kind, moved_mm, turned_deg)


def summary(changes: Sequence[Motion]) -> str:
    """In a sentence, as in: 5 frames, 2 flips (40 per 100), 0 jumps; median 1.2 mm and 0.3° a frame."""
    n = len(changes)
    count = {kind: sum(motion.kind == kind for motion in changes) for kind in ("flip", "jump", "no pose")}
    parts = [f"{n} frames", f"{_n(count['flip'], 'flip')} ({100 * count['flip'] / max(n, 1):.3g} per 100)"]
    parts += [_n(count["jump"], "jump")]
    parts += [f"{count['no pose']} without a pose"] if count["no pose"] else []
    plain = [motion for motion in changes[1:] if motion.kind == "moved"]
    if plain:
        mm, deg = (float(np.median(v)) for v in zip(*((m.moved_mm, m.turned_deg) for m in plain), strict=True))
        parts[-1] += f"; median {mm:.2g} mm and {deg:.2g}° a frame"
    return ", ".join(parts) + "."


def _n(n: int, one: str) -> str:
    return f"{n} {one}{'' if n == 1 else 's'}"
