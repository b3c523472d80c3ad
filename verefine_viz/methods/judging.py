"""The scores of one iteration's poses; what others are computed from is scored meanwhile."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from verefine_viz.core.problem import Placed, Target
from verefine_viz.core.protocols import Verifier
from verefine_viz.core.records import Stage, StageName
from verefine_viz.core.scores import Scores
from verefine_viz.methods.chain import Draft


@dataclass(frozen=True, eq=False)
class Judging:
    """Judges the poses of one iteration."""

    verifier: Verifier
    target: Target
    placed: Sequence[Placed]
    """Other objects, which may hide parts."""
    _begun: dict[StageName, Callable[[], Scores]] = field(default_factory=dict)

    def begin(self, stage: Stage) -> None:
        """Has a pose scored while the next one is computed, where the verifier can do that."""
        scores = self.verifier.begin(self.target, stage.T_cam_obj[None], self.placed)
        if scores is not None:
            self._begun[stage.name] = scores

    def judged(self, draft: Draft) -> tuple[Stage, ...]:
        """The stages with their scores: what was begun, and one call for all others.

        The mixed pose is judged only where it may be kept, since it only starts the refiner.
        """
        not_judged = () if "mixed" in draft.candidates else ("mixed",)
        left = [s for s in draft.stages if s.name not in (*self._begun, *not_judged)]
        scores = self.verifier.score(self.target, np.array([s.T_cam_obj for s in left]), self.placed)
        of_stage = {s.name: scores[i] for i, s in enumerate(left)}
        of_stage |= {name: begun()[0] for name, begun in self._begun.items()}
        return tuple(s.judged(of_stage.get(s.name)) for s in draft.stages)
