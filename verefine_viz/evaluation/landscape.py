"""Computes the score around a pose: along twelve axes, and over two of them.

Answers depend on the arguments only: page and recording have the same bits.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from verefine_viz.core.problem import Placed, Target
from verefine_viz.core.protocols import Verifier
from verefine_viz.evaluation.allowed_poses import LONGEST_MM, AllowedPoses, Extent
from verefine_viz.evaluation.pose_landscape import Curve, Landscape, Slice

SHIFTS_MM = (1.0, 2.0, 4.0, 8.0, 16.0, LONGEST_MM)
TURNS_DEG = (1.5, 3.0, 6.0, 12.0, 25.0, 45.0, 70.0, 90.0, 115.0, 135.0, 160.0, 180.0)
"""Number of distances from the pose, to each side, at which it is scored."""
SLICE = 13
"""Poses along a side of a 2D slice."""


def landscape(verifier: Verifier, target: Target, allowed: AllowedPoses, placed: Sequence[Placed] = ()) -> Landscape:
    """The score along the axes of a pose whose :class:`AllowedPoses` are known, in one batch."""
    offsets = [_offsets(extent) for extent in allowed.extents]
    poses = [e.axis.moved(allowed.T_cam_obj, x) for e, own in zip(allowed.extents, offsets, strict=True) for x in own]
    scores = verifier.score(target, np.array([allowed.T_cam_obj, *poses]), placed).score
    curves: list[Curve] = []
    first = 1
    for extent, own in zip(allowed.extents, offsets, strict=True):
        values = scores[first : first + len(own)].copy()
        values[own == 0] = scores[0]
        curves.append(Curve(extent, own, values))
        first += len(own)
    return Landscape(allowed, tuple(curves))


def score_slice(
    verifier: Verifier, target: Target, allowed: AllowedPoses, across: int, up: int, placed: Sequence[Placed] = ()
) -> Slice:
    """The score over two of the axes of a pose, named by their numbers, in one batch.

    It reaches twice as far as what is undetermined, and at least 10 mm or 20°.
    """
    extents = allowed.extents[across], allowed.extents[up]
    axes = extents[0].axis, extents[1].axis
    columns, rows = (np.linspace(-1, 1, SLICE) * _reach(extent) for extent in extents)
    Ts = [axes[1].moved(axes[0].moved(allowed.T_cam_obj, a), b) for b in rows for a in columns]
    scores = verifier.score(target, np.array(Ts), placed).score.reshape(SLICE, SLICE)
    return Slice(*axes, columns, rows, scores)


def _offsets(extent: Extent) -> np.ndarray:
    steps = SHIFTS_MM if extent.axis.kind == "shift" else TURNS_DEG
    return np.array([*(-x for x in reversed(steps)), 0.0, *steps])


def _reach(extent: Extent) -> float:
    least, most = (10.0, LONGEST_MM) if extent.axis.kind == "shift" else (20.0, 180.0)
    return float(np.clip(2 * extent.width, least, most))
