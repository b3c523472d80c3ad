"""Made-up sequences in which it is known where objects flip, jump, are lost and recovered."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import axis_angle, random_unit_vector, transform
from verefine_viz.core.records import MarkKind

Z = np.array([0.0, 0, 1])
HALF_TURN = transform(axis_angle(Z, np.pi), np.zeros(3))[None]
"""After which the shape nearly looks the same."""
AROUND = np.array([transform(axis_angle(Z, np.radians(k)), np.zeros(3)) for k in range(0, 360, 5)])
"""Declared symmetries of a bowl."""
WAY_M = 0.004
"""How far an object moves from frame to frame."""


@dataclass(frozen=True)
class Planted:
    """An object over the frames."""

    poses: tuple[Float | None, ...]
    """(4, 4) [m]; None = lost."""
    marks: tuple[tuple[int, MarkKind], ...]
    """What a frame must be marked with, in order."""


def planted(n: int, n_events: int, seed: int, mm: float = 2.0, deg: float = 2.0, is_bowl: bool = False) -> Planted:
    """An object that moves on smoothly, with events at random frames.

    Args:
        n: frames.
        n_events: flips, jumps and spells without a pose together.
        seed: of the events and the noise.
        mm: noise of the poses (sigma along each axis).
        deg: noise of their turns (sigma).
        is_bowl: turns by any angle about Z at each frame, and flips nowhere.
    """
    rng = np.random.default_rng(seed)
    kinds: list[MarkKind] = ["jump", "lost"] if is_bowl else ["flip", "jump", "lost"]
    # Events lie apart, so that each is one: the longest spell takes 30 frames.
    places = 20 + 60 * np.sort(rng.choice((n - 60) // 60, n_events, replace=False))
    events = {int(place): str(rng.choice(kinds)) for place in places}
    turn, shift, until = np.eye(4), np.zeros(3), 0
    poses: list[Float | None] = []
    marks: list[tuple[int, MarkKind]] = []
    for i in range(n):
        kind = events.get(i)
        if kind == "flip":
            turn = turn @ HALF_TURN[0]
            marks.append((i, "flip"))
        elif kind == "jump":
            by = random_unit_vector(rng)
            shift = shift + (0.12 if is_bowl or rng.random() < 0.5 else 0.0) * by
            if not is_bowl:
                turn = turn @ transform(axis_angle(Z, np.radians(75 + 20 * rng.random())), np.zeros(3))
            marks.append((i, "jump"))
        elif kind == "lost":
            until = i + int(rng.integers(1, 30))
            marks.append((i, "lost"))
            marks.append((until, "recovered"))
        if i < until:
            poses.append(None)
            continue
        way = np.array([0.5 * np.sin(i * WAY_M / 0.5), 0.05 * np.cos(i / 40), 0.8]) + shift
        spin = axis_angle(Z, rng.uniform(0, 2 * np.pi) if is_bowl else np.radians(1.0 * i))
        R = spin @ axis_angle(random_unit_vector(rng), np.radians(deg) * rng.normal())
        poses.append(transform(np.eye(3), mm * 1e-3 * rng.normal(size=3)) @ transform(R, way) @ turn)
    return Planted(tuple(poses), tuple(marks))
