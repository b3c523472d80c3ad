"""The refiner that changes nothing: what a method does by physics and choice alone."""

from __future__ import annotations

from collections.abc import Sequence

from verefine_viz.core.arrays import Float
from verefine_viz.core.problem import Placed, Target


class Identity:
    """Returns the pose it was given."""

    def refine(self, target: Target, T_cam_obj: Float, fixed: Sequence[Placed] = ()) -> Float:
        """The same pose (4, 4)."""
        return T_cam_obj
