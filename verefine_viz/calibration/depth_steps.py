"""Whether a depth image was stored in too few steps, as its values show without any model or pose."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.doubt import Doubt, DoubtKind

STEPS, FEWEST_STEPS, STEP_M = 255, 12, 1.5e-3
"""Depth of 8 bits: so many steps at most, so many that differ at least, each at least so large [m]: sensors have steps
of a millimetre, and cameras for close views no more than 255 of them."""
FULL_STEPS, ROUND_M, ROUND = 60, 1e-4, 0.05
"""Smaller steps are those of 8 bits where at least so many values differ, the largest is at the last step, and a step
is off a multiple of a tenth of a millimetre by this share of it: no sensor has such steps."""
NEAR_STEP = 0.1
"""Values this near to a step, as a share of it, are on it."""


def coarse_depth(depth_m: NDArray[np.floating]) -> tuple[Doubt, ...]:
    """A doubt where depth (H, W) [m] is a small multiple of one large step everywhere, as 8 bits hold it."""
    values_m = np.unique(depth_m).astype(np.float64)
    values_m = values_m[values_m > 0]
    if not FEWEST_STEPS <= len(values_m) <= STEPS:
        return ()
    steps_m = values_m[-1] / np.arange(len(values_m), STEPS + 1)
    in_steps = values_m / steps_m[:, None]
    # Each value on a step of its own: near a large value anything is once a large step.
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
