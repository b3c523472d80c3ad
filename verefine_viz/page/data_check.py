"""What of a frame's data does not fit together, worked out when it is first asked for: the frame is shown before."""

from __future__ import annotations

from verefine_viz.core.doubt import Doubt
from verefine_viz.core.problem import Problem


class DataCheck:
    """Doubts about the data of a frame; one for all runs that begin with the same data.

    Args:
        problem: the frame as it was read.
        is_labelled: whether poses and masks are those of labels, which have lights of their own.
    """

    def __init__(self, problem: Problem, is_labelled: bool = False) -> None:
        self._problem = problem
        self._doubts: tuple[Doubt, ...] | None = () if is_labelled else None

    @property
    def is_done(self) -> bool:
        """Whether :meth:`doubts` takes no time any more."""
        return self._doubts is not None

    def doubts(self) -> tuple[Doubt, ...]:
        """What does not fit together: units and conventions, else camera and images, else nothing single."""
        if self._doubts is None:
            from verefine_viz.calibration.consistency import data_doubts  # Loads what draws models.

            self._doubts = data_doubts(self._problem)
        return self._doubts
