"""The baseline: the refiner alone, again and again (paper Tables I-III, rows without VeREFINE)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from verefine_viz.core.arrays import Float
from verefine_viz.core.problem import Placed, Target
from verefine_viz.core.protocols import Refiner
from verefine_viz.methods.chain import Draft, Judge, refined


@dataclass(frozen=True)
class Refine:
    """T ← REF(T)."""

    refiner: Refiner

    def draft(self, target: Target, T_cam_obj: Float, k: int, fixed: Sequence[Placed], judge: Judge) -> Draft:
        return Draft((refined(self.refiner, target, T_cam_obj, fixed),), ("refined",))
