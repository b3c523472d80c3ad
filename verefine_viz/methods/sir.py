"""SIR: supervised iterative refinement (paper Sec. III-B).

The iteration of PIR, supervised by the verification score: the better of the simulated and the refined pose is kept,
and the answer is the best of all poses on the way, the initial one included.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

from verefine_viz.core.arrays import Float
from verefine_viz.core.problem import Placed, Target
from verefine_viz.core.records import StageName
from verefine_viz.methods.chain import Draft, Judge
from verefine_viz.methods.pir import Pir


@dataclass(frozen=True)
class Sir:
    """Keeps T_ref if f(T_ref) ≥ f(T_sim), else T_sim."""

    pir: Pir
    sim_candidate: Literal["full", "rotation_only"] = "full"
    """Whether the simulator's whole pose may be kept (authors' code) or its rotation only."""

    def draft(self, target: Target, T_cam_obj: Float, k: int, fixed: Sequence[Placed], judge: Judge) -> Draft:
        # T_sim, [R_sim | t_cur] and T_ref of Sec. III-A; which one is kept: ObjectMethod._keep.
        draft = self.pir.draft(target, T_cam_obj, k, fixed, judge)
        simulated: StageName = "simulated" if self.sim_candidate == "full" else "mixed"
        return replace(draft, candidates=(simulated, "refined"))
