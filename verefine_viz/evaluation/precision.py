"""Average precision of the BOP'24 detection task."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float
from verefine_viz.evaluation.recalls import PIXEL_THRESHOLDS, RELATIVE_THRESHOLDS

MILLIMETRE_THRESHOLDS = np.arange(2.0, 21.0, 2.0)
"""Of MSSD in the BOP'25 variant for industrial parts [mm]."""

THRESHOLDS = np.stack([RELATIVE_THRESHOLDS, MILLIMETRE_THRESHOLDS, PIXEL_THRESHOLDS])
"""(3, 10) for MSSD as a share of the diameter, MSSD [mm] and MSPD."""

WRONG, RIGHT, IGNORED = 0, 1, 2
"""What became of an estimate: without an instance, with one, or with one that is hardly visible."""


@dataclass(frozen=True)
class Precision:
    """Mean average precision over objects and thresholds."""

    n_targets: int
    mssd: float
    """Thresholds in shares of the diameter: BOP'25's ``bop25_mAP``, too."""
    mssd_mm: float
    """Thresholds of 2 to 20 mm (``bop25_mAP_mm``)."""
    mspd: float

    @property
    def map(self) -> float:
        """``bop24_mAP``, the mean of MSSD and MSPD."""
        return float(np.mean([self.mssd, self.mspd]))


@dataclass
class Detections:
    """Collects what became of all estimates, by object."""

    n_targets: dict[int, int] = field(default_factory=dict)
    """Instances that are at least 10 % visible."""
    scores: dict[int, list[Float]] = field(default_factory=dict)
    outcomes: dict[int, list[NDArray[np.int64]]] = field(default_factory=dict)

    def add(self, obj_id: int, n_targets: int, scores: Float, outcomes: NDArray[np.int64]) -> None:
        """One object of one image: E scores and what became of each estimate, (C, T, E)."""
        self.n_targets[obj_id] = self.n_targets.get(obj_id, 0) + n_targets
        self.scores.setdefault(obj_id, []).append(scores)
        self.outcomes.setdefault(obj_id, []).append(outcomes)

    @property
    def obj_ids(self) -> tuple[int, ...]:
        """Objects with at least one instance to find; others do not count."""
        return tuple(sorted(obj_id for obj_id, n in self.n_targets.items() if n))

    def precision(self, obj_id: int) -> Float:
        """(C, T) average precision of an object."""
        scores = np.concatenate(self.scores[obj_id])
        outcomes = np.concatenate(self.outcomes[obj_id], axis=2)
        order = np.argsort(-scores, kind="stable")
        return np.array(
            [[average_precision(o[order], self.n_targets[obj_id]) for o in per_kind] for per_kind in outcomes]
        )

    def summary(self, obj_id: int | None = None) -> Precision:
        """Of one object, or the mean over all."""
        wanted = self.obj_ids if obj_id is None else (obj_id,)
        n = sum(self.n_targets[i] for i in wanted)
        if not wanted:
            return Precision(0, 0.0, 0.0, 0.0)
        per_object = np.array([self.precision(i).mean(axis=1) for i in wanted])
        return Precision(n, *(float(x) for x in per_object.mean(axis=0)))


def average_precision(outcomes: NDArray[np.int64], n_targets: int) -> float:
    """Mean over 101 recalls (0, 0.01, … 1) of the best precision that is reached at that recall or beyond.

    Args:
        outcomes: (E,) of estimates by descending score; ``IGNORED`` ones neither help nor harm.
        n_targets: instances to find, > 0.
    """
    counted = outcomes[outcomes != IGNORED]
    if not len(counted):
        return 0.0
    right = np.cumsum(counted == RIGHT)
    recall, precision = right / float(n_targets), right / np.arange(1, len(right) + 1)
    best_beyond = np.append(np.maximum.accumulate(precision[::-1])[::-1], 0.0)
    return float(np.mean(best_beyond[np.searchsorted(recall, np.linspace(0.0, 1.0, 101), side="left")]))
