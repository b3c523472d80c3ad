"""Samples of the poses that the image allows: spread along the least certain motion, and isolated ones that look
alike.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.causes import Cause
from verefine_viz.evaluation.allowed_poses import AllowedPoses, Extent
from verefine_viz.page.run_messages import AllowedByImage
from verefine_viz.page.wire import pose_numbers

MOST = 12
"""Most poses that are drawn at once."""
ALONG = 7
"""Most ghosts along a motion."""
SEEN = 0.02
"""A pose nearer to the answer than this would be drawn on top of it [ADD(-S), share of the diameter]."""
FAR_DEG = 20.0
"""A turn that is undetermined by more than this is drawn unasked."""


def allowed_ghosts(
    allowed: AllowedPoses, apart_mm: Callable[[Float], float], causes: Sequence[Cause | str], least_score: float
) -> AllowedByImage | None:
    """Choose the poses; None where all allowed poses look like the answer, as for a can that turns about its axis.

    Args:
        allowed: the poses that the image allows besides an answer.
        apart_mm: ADD(-S) between a pose (4, 4) and the answer [mm].
        causes: those that the verdict names.
        least_score: an answer that scores less fits its image too badly to tell what else fits.
    """
    least_mm = SEEN * 2 * allowed.radius_mm
    widest, along = None, list[Float]()
    for extent in sorted(allowed.extents, key=lambda one: _reach_mm(one, allowed), reverse=True):
        along = [T for T in _spread(list(extent.along()), ALONG) if apart_mm(T) > least_mm]
        if along:
            widest = extent
            break
    alike = [one.T_cam_obj for one in allowed.alike if one.apart_mm > least_mm]
    poses = [*along, *alike][:MOST]
    if not poses:
        return None
    turns_far = widest is not None and widest.axis.kind == "turn" and widest.width > FAR_DEG
    turns_far = turns_far and allowed.score >= least_score
    return AllowedByImage(
        poses=[pose_numbers(T) for T in poses],
        words=widest.describe() if widest is not None else "other poses fit as well",
        unasked=turns_far or Cause.AMBIGUOUS in causes,
    )


def _reach_mm(extent: Extent, allowed: AllowedPoses) -> float:
    """Return how far a motion moves the surface."""
    return extent.width if extent.axis.kind == "shift" else np.deg2rad(extent.width) * allowed.radius_mm


def _spread(poses: Sequence[Float], n: int) -> list[Float]:
    """Return n of the poses, evenly spaced, both ends included; all where there are fewer."""
    places = np.unique(np.linspace(0, len(poses) - 1, min(n, len(poses))).round().astype(int))
    return [poses[k] for k in places]
