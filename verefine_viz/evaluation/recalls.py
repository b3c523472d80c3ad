"""Average recalls of the BOP localization task: shares of instances found, over all tolerances and thresholds."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float
from verefine_viz.evaluation.vsd import TAUS

RELATIVE_THRESHOLDS = np.arange(0.05, 0.51, 0.05)
"""Of VSD [-] and of MSSD [shares of the diameter]."""

PIXEL_THRESHOLDS = np.arange(5.0, 51.0, 5.0)
"""Of MSPD [px of an image 640 wide]."""

THRESHOLDS = np.stack([RELATIVE_THRESHOLDS] * (len(TAUS) + 1) + [PIXEL_THRESHOLDS])
"""(12, 10) for VSD at each τ, MSSD and MSPD: in the order of ``PairErrors.kinds``."""


@dataclass(frozen=True, eq=False)
class Recalls:
    """How many of ``n_targets`` instances were found."""

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
    """Counts instances asked for and found, by object and by scene."""

    targets: dict[tuple[int, int], int] = field(default_factory=dict)
    """(scene_id, obj_id) → instances asked for."""
    found: dict[tuple[int, int], NDArray[np.int64]] = field(default_factory=dict)
    """(scene_id, obj_id) → instances found, by kind of error and threshold."""

    def add(self, scene_id: int, obj_id: int, n_targets: int, found: NDArray[np.int64]) -> None:
        """One object of one image: how many instances were asked for, and found (C, T)."""
        key = scene_id, obj_id
        self.targets[key] = self.targets.get(key, 0) + n_targets
        self.found[key] = self.found[key] + found if key in self.found else found

    @property
    def obj_ids(self) -> tuple[int, ...]:
        """Objects that were asked for."""
        return tuple(sorted({obj_id for (_, obj_id), n in self.targets.items() if n}))

    @property
    def scene_ids(self) -> tuple[int, ...]:
        """Scenes in which something was asked for."""
        return tuple(sorted({scene_id for (scene_id, _), n in self.targets.items() if n}))

    def shares(self, scene_id: int | None = None, obj_id: int | None = None) -> tuple[int, Float]:
        """Instances asked for, and the share found (C, T): of everything, of a scene, or of an object; 0 of none."""
        keys = [key for key in self.targets if scene_id in (None, key[0]) and obj_id in (None, key[1])]
        n = sum(self.targets[key] for key in keys)
        found = sum((self.found[key] for key in keys), np.zeros((1, 1), np.int64))
        return n, found / float(n) if n else np.zeros(found.shape)

    def recalls(self, scene_id: int | None = None, obj_id: int | None = None) -> Recalls:
        """The same, for the kinds of error and thresholds of :data:`THRESHOLDS`."""
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
