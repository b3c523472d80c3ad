"""Checks by its values alone whether a depth image was stored in too few steps."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.doubt import Doubt, DoubtKind

STEPS, FEWEST_STEPS, STEP_M = 255, 12, 1.5e-3
"""Depth stored in 8 bits: most steps, fewest different values, and least size of a step [m]. Sensors have steps of a
millimetre, and cameras for close views no more than 255 of them."""
FULL_STEPS, ROUND_M, ROUND = 60, 1e-4, 0.05
"""Smaller steps come from 8 bits where at least so many values differ, the largest is at the last step, and the step
differs by this share from every multiple of 0.1 mm: no sensor has such steps."""
NEAR_STEP = 0.1
"""Distance from a step, as a share of its size, within which a value is on it."""


def coarse_depth(depth_m: NDArray[np.floating]) -> tuple[Doubt, ...]:
    """A doubt where all depths (H, W) [m] are multiples of one large step, as 8 bits would store them."""
    values_m = np.unique(depth_m).astype(np.float64)
    values_m = values_m[values_m > 0]
    if not FEWEST_STEPS <= len(values_m) <= STEPS:
        return ()
    steps_m = values_m[-1] / np.arange(len(values_m), STEPS + 1)
    in_steps = values_m / steps_m[:, None]
    # Each value needs a step of its own, as one large step comes near any large value.
    is_on_step = np.abs(in_steps - np.round(in_steps)).max(axis=1) < NEAR_STEP
    is_large = steps_m > STEP_M
    is_odd = abs(steps_m[-1] / ROUND_M - round(steps_m[-1] / ROUND_M)) > ROUND and steps_m[-1] > ROUND_M
    is_large[-1] |= len(values_m) >= FULL_STEPS and is_odd
    fits = is_on_step & (np.diff(np.round(in_steps), axis=1).min(axis=1) >= 1) & is_large
    if not fits.any():
        return ()
    step_m = steps_m[fits][0]
    text = (
        f"depth has {len(values_m)} different values only, {1e3 * step_m:.3g} mm apart: it looks as if it was stored "
        "in 8 bits, store it in 16"
    )
    return (Doubt(DoubtKind.DEPTH_STEPS, text, numbers={"values": len(values_m), "step_mm": 1e3 * float(step_m)}),)
