"""Initial poses whose translations are written in another unit."""

from __future__ import annotations

import numpy as np

from verefine_viz.core.arrays import Float

UNITS = {"metres": 1000.0, "centimetres": 10.0}
"""By what a translation would have to be multiplied, where millimetres are expected."""


def of_another_unit(T_est: Float, T_true: Float, diameter_m: float) -> str:
    """The unit that the translation of a pose (4, 4) seems to have, where it would lie on the object with it; else "".

    Args:
        T_est: the pose, as it was read.
        T_true: (4, 4) ground truth.
        diameter_m: of the object; a pose nearer to the truth than this is taken as it is.
    """
    t, true = T_est[:3, 3], T_true[:3, 3]
    if np.linalg.norm(t - true) < diameter_m:
        return ""
    return next((unit for unit, factor in UNITS.items() if np.linalg.norm(factor * t - true) < diameter_m), "")
