"""Checks whether the colour image is registered to the depth image, by the colours of models in their poses.

The colours of a model in its pose correlate best with the image without a shift if both are registered. The peak may be
a pixel off, as poses are; where it is further off, and in the same direction for all objects, the colour image is
displaced.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from verefine_viz.core.arrays import Float
from verefine_viz.core.doubt import Doubt, DoubtKind
from verefine_viz.core.problem import Placed, Problem, Target
from verefine_viz.rendering.colour import SIGMA_PX, opponent
from verefine_viz.rendering.rendered_scene import render_scene

REACH_PX = 10
"""Largest displacement that is tried [px]."""
OFF_PX, BETTER = 2.0, 0.05
"""Least displacement that is reported [px], and least gain in correlation by it."""
SURE, FEWEST = 0.4, 2
"""Least correlation of an object whose colours are evidence; and fewest such objects, as the print of a single one may
lie elsewhere on its model, or its pose be off."""
NEAR_M = 0.02
"""Largest difference of measured and drawn depth of a pixel that shows the model [m]."""
FEWEST_PX = 400
"""Fewest pixels of an object that are evidence."""


def registration_doubts(problem: Problem, poses: Sequence[Float | None]) -> tuple[Doubt, ...]:
    """A doubt where the colours of all objects together lie beside the objects, by more than ``OFF_PX``.

    Args:
        problem: the frame.
        poses: T_cam_obj (4, 4) of each target; None = it has no pose.
    """
    sure = colour_fits(problem, poses)
    if len(sure) < FEWEST:
        return ()
    together = np.mean(sure, axis=0)
    v, u = np.unravel_index(int(together.argmax()), together.shape)
    right, down = int(u) - REACH_PX, int(v) - REACH_PX
    gain = float(together[v, u] - together[REACH_PX, REACH_PX])
    if np.hypot(right, down) <= OFF_PX or gain < BETTER:
        return ()
    where = f"{abs(right)} px {'right' if right > 0 else 'left'} and {abs(down)} px {'down' if down > 0 else 'up'}"
    text = (
        f"the colours of {len(sure)} objects lie {where} of where depth has them: the colour image is not registered "
        "to the depth image; register it, or score without colour (score.colour_weight = 0)"
    )
    numbers = {"right_px": right, "down_px": down, "gain": gain}
    return (Doubt(DoubtKind.COLOUR, text, numbers=numbers, other_settings={"score.colour_weight": 0.0}),)


def colour_fits(problem: Problem, poses: Sequence[Float | None]) -> list[NDArray[np.float64]]:
    """Correlations (2 R + 1, 2 R + 1) by displacement of each object whose colours are evidence; the check needs
    ``FEWEST``. The arguments are those of :func:`registration_doubts`.
    """
    fits = [_fits(t, T) for t, T in zip(problem.targets, poses, strict=True) if T is not None]
    return [one for one in fits if one is not None and one.max() >= SURE]


def _fits(target: Target, T_cam_obj: Float) -> NDArray[np.float64] | None:
    """Correlation (2 R + 1, 2 R + 1) of an object's colours with the image displaced down and right by −R … R px, R =
    ``REACH_PX``; None where too few pixels show the object.
    """
    observation = target.observation
    if observation.rgb is None or not target.model.has_colors:
        return None
    drawn = render_scene([Placed(0, target.model, T_cam_obj)], observation.camera)
    depth_m = observation.depth_m
    seen = (drawn.depth_m > 0) & (depth_m > 0) & (np.abs(drawn.depth_m - depth_m) < NEAR_M) & target.instance.mask
    rows, columns = np.nonzero(seen)
    h, w = seen.shape
    inner = (rows >= REACH_PX) & (rows < h - REACH_PX) & (columns >= REACH_PX) & (columns < w - REACH_PX)
    rows, columns = rows[inner], columns[inner]
    if len(rows) < FEWEST_PX:
        return None
    image = _smooth(observation.rgb)
    model = _smooth(drawn.rgb)[rows, columns]
    model -= model.mean(axis=0)
    shifts = range(-REACH_PX, REACH_PX + 1)
    return np.array([[_correlation(model, image[rows + v, columns + u]) for u in shifts] for v in shifts])


def _smooth(rgb: NDArray[np.uint8]) -> NDArray[np.floating]:
    return opponent(gaussian_filter(rgb.astype(np.float32) / 255, (SIGMA_PX, SIGMA_PX, 0)))


def _correlation(centred: NDArray[np.floating], colours: NDArray[np.floating]) -> float:
    """Correlation of colours (N, 3), the first with zero mean."""
    other = colours - colours.mean(axis=0)
    squares = float((centred**2).sum() * (other**2).sum())
    return float((centred * other).sum()) / squares**0.5 if squares > 0 else 0.0
