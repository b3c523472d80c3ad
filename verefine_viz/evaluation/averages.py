"""Average recall of the BOP localization task and average precision of the detection task.

Recalls are shares of the instances that an estimate was matched to, over all tolerances and thresholds.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float
from verefine_viz.evaluation.vsd import TAUS

RELATIVE_THRESHOLDS = np.arange(0.05, 0.51, 0.05)
"""Thresholds of VSD [-] and of MSSD [shares of the diameter]."""

PIXEL_THRESHOLDS = np.arange(5.0, 51.0, 5.0)
"""Thresholds of MSPD [px of an image 640 wide]."""

THRESHOLDS = np.stack([RELATIVE_THRESHOLDS] * (len(TAUS) + 1) + [PIXEL_THRESHOLDS])
"""(12, 10) for VSD at each τ, MSSD and MSPD: in the order of ``PairErrors.kinds``."""


@dataclass(frozen=True, eq=False)
class Recalls:
    """Shares of ``n_targets`` instances that an estimate was matched to."""

    n_targets: int
    vsd: Float
    """(10, 10) by tolerance τ and threshold."""
    mssd: Float
    """(10,) by threshold."""
    mspd: Float
    """(10,) by threshold."""

    @property
    def ar_vsd(self) -> float:
        return float(np.mean(self.vsd.ravel()))

    @property
    def ar_mssd(self) -> float:
        return float(np.mean(self.mssd))

    @property
    def ar_mspd(self) -> float:
        return float(np.mean(self.mspd))

    @property
    def ar(self) -> float:
        """The mean of the three: BOP's headline number."""
        return float(np.mean([self.ar_vsd, self.ar_mssd, self.ar_mspd]))


@dataclass
class Tally:
    """Counts instances asked for and matched, by object and by scene."""

    targets: dict[tuple[int, int], int] = field(default_factory=dict)
    """(scene_id, obj_id) → instances asked for."""
    matched: dict[tuple[int, int], NDArray[np.int64]] = field(default_factory=dict)
    """(scene_id, obj_id) → instances matched, by kind of error and threshold."""

    def add(self, scene_id: int, obj_id: int, n_targets: int, matched: NDArray[np.int64]) -> None:
        """One object of one image: how many instances were asked for, and matched (C, T)."""
        key = scene_id, obj_id
        self.targets[key] = self.targets.get(key, 0) + n_targets
        self.matched[key] = self.matched[key] + matched if key in self.matched else matched

    @property
    def obj_ids(self) -> tuple[int, ...]:
        """Objects that were asked for."""
        return tuple(sorted({obj_id for (_, obj_id), n in self.targets.items() if n}))

    @property
    def scene_ids(self) -> tuple[int, ...]:
        """Scenes in which something was asked for."""
        return tuple(sorted({scene_id for (scene_id, _), n in self.targets.items() if n}))

    def shares(self, scene_id: int | None = None, obj_id: int | None = None) -> tuple[int, Float]:
        """Instances asked for, and the share matched (C, T): of all, of a scene, or of an object; 0 of none."""
        keys = [key for key in self.targets if scene_id in (None, key[0]) and obj_id in (None, key[1])]
        n = sum(self.targets[key] for key in keys)
        matched = sum((self.matched[key] for key in keys), np.zeros((1, 1), np.int64))
        return n, matched / float(n) if n else np.zeros(matched.shape)

    def recalls(self, scene_id: int | None = None, obj_id: int | None = None) -> Recalls:
        """Recalls for the kinds of error and thresholds of :data:`THRESHOLDS`."""
        n, shares = self.shares(scene_id, obj_id)
        shares = np.broadcast_to(shares, THRESHOLDS.shape)
        return Recalls(n, np.array(shares[: len(TAUS)]), np.array(shares[-2]), np.array(shares[-1]))


def average_recalls(kinds: Float) -> Recalls:
    """Recalls of N targets with one estimate and one instance each.

    Args:
        kinds: (12, N) as ``PairErrors.kinds``; infinite = no estimate.
    """
    tally = Tally()
    tally.add(0, 0, kinds.shape[1], (kinds[:, None, :] < THRESHOLDS[:, :, None]).sum(axis=2))
    return tally.recalls()


MILLIMETRE_THRESHOLDS = np.arange(2.0, 21.0, 2.0)
"""Thresholds of MSSD in the BOP'25 variant for industrial parts [mm]."""

DETECTION_THRESHOLDS = np.stack([RELATIVE_THRESHOLDS, MILLIMETRE_THRESHOLDS, PIXEL_THRESHOLDS])
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
        """Precision of one object, or the mean over all."""
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
