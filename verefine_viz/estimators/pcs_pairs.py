"""All pairs of a model's points in order of their distance: which are as long as a segment of a base."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import pdist

from verefine_viz.core.arrays import Float


class PairTable(NamedTuple):
    """Every two points of a cloud once, by their distance."""

    distances_m: Float
    """(N·(N-1)/2,) ascending [m]."""
    pairs: NDArray[np.int32]
    """(N·(N-1)/2, 2) indices of the points."""

    @staticmethod
    def build(points: Float) -> PairTable:
        """The table of a cloud (N, 3)."""
        distances = pdist(points).astype(np.float64)
        order = np.argsort(distances, kind="stable")
        first, second = np.triu_indices(len(points), 1)  # the order of pdist
        return PairTable(distances[order], np.stack([first, second], axis=1)[order].astype(np.int32))

    def of_length(self, length_m: float, tolerance_m: float) -> NDArray[np.int32]:
        """Pairs (n, 2) that are longer than ``length_m - tolerance_m`` and shorter than ``length_m + tolerance_m``.

        Each is there once; whoever cares about directions reads it both ways.
        """
        begin = np.searchsorted(self.distances_m, length_m - tolerance_m, side="right")
        end = np.searchsorted(self.distances_m, length_m + tolerance_m, side="left")
        return self.pairs[begin:end]
