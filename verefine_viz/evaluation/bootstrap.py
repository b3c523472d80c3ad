"""How far a number would move on other frames and with other objects: the bootstrap over both.

Frames (or whole scenes) and object models are drawn with replacement, each by itself, and every group is measured under
the same draws: differences between groups are therefore paired. All seeds go along with what is drawn: a seed is no
further object, and more seeds make no interval narrower.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from verefine_viz.core.arrays import Float

DRAWS = 1000
FEWEST_SCENES = 8
"""With at least so many scenes whole scenes are drawn, whose frames look alike; otherwise frames."""
CONFIDENCE = (2.5, 97.5)


@dataclass(frozen=True)
class Spread:
    """A number with its 95 % interval; without one where there is nothing to draw from."""

    value: float
    low: float | None = None
    high: float | None = None

    @property
    def is_clear(self) -> bool:
        """Whether the interval of a difference leaves out 0."""
        return self.low is not None and self.high is not None and (self.low > 0 or self.high < 0)


@dataclass(frozen=True, eq=False)
class CellSums:
    """Sums of something by frame (or scene) and object model, and of how many things they are the sum."""

    total: Float
    """(U, M)."""
    n: Float
    """(U, M)."""

    @property
    def mean(self) -> float | None:
        """Over everything; None of nothing."""
        n = float(self.n.sum())
        return float(self.total.sum()) / n if n else None

    def where(self, others: CellSums) -> CellSums:
        """The cells without what ``others`` do not have."""
        both = others.n > 0
        return CellSums(self.total * both, self.n * both)


@dataclass(frozen=True, eq=False)
class Draws:
    """How often each frame (or scene) and each object model was drawn."""

    units: Float
    """(B, U)."""
    models: Float
    """(B, M)."""

    @property
    def are_several(self) -> bool:
        """Whether there is more than one frame or model: nothing is drawn from one."""
        return self.units.shape[1] > 1 or self.models.shape[1] > 1

    def sums(self, cells: Float) -> Float:
        """(B, …) sums of (U, M, …) under each draw."""
        by_model = np.tensordot(self.units, cells, axes=(1, 0))
        return np.einsum("bm...,bm->b...", by_model, self.models)

    def mean(self, cells: CellSums) -> Spread | None:
        """The mean with its interval; None of nothing."""
        return None if cells.mean is None else self._spread(cells.mean, self._means(cells))

    def difference(self, a: CellSums, b: CellSums) -> Spread | None:
        """The mean of a less that of b, over the objects that both have; None where there are none."""
        a, b = a.where(b), b.where(a)
        if a.mean is None or b.mean is None:
            return None
        return self._spread(a.mean - b.mean, self._means(a) - self._means(b))

    def median(self, values: Float, unit: np.ndarray, model: np.ndarray | None) -> Spread | None:
        """The median of N values of these frames (N,) and models (N,), with its interval; None of nothing.

        Without models the values are of whole frames.
        """
        if not len(values):
            return None
        order = np.argsort(values, kind="stable")
        ordered, unit, model = values[order], unit[order], None if model is None else model[order]
        drawn = np.full(len(self.units), np.nan)
        for k, (of_unit, of_model) in enumerate(zip(self.units, self.models, strict=True)):
            weight = np.cumsum(of_unit[unit] * (1.0 if model is None else of_model[model]))
            if weight[-1]:
                # The mean of the middle two, where the half lies between them.
                middle = [np.searchsorted(weight, weight[-1] / 2, side) for side in ("left", "right")]
                drawn[k] = ordered[middle].mean()
        return self._spread(float(np.median(values)), drawn)

    def band(self, hits: Float, n: Float) -> tuple[Float, Float] | None:
        """The interval (T,), (T,) of the shares of (U, M, T) ``hits`` in (U, M) ``n``; None where nothing is drawn."""
        if not self.are_several:
            return None
        with np.errstate(invalid="ignore", divide="ignore"):
            shares = self.sums(hits) / self.sums(n)[:, None]
        low, high = np.nanpercentile(shares, CONFIDENCE, axis=0)
        return low, high

    def _means(self, cells: CellSums) -> Float:
        with np.errstate(invalid="ignore", divide="ignore"):
            return self.sums(cells.total) / self.sums(cells.n)

    def _spread(self, value: float, drawn: Float) -> Spread:
        known = drawn[np.isfinite(drawn)]
        if not self.are_several or not len(known):
            return Spread(value)
        low, high = np.percentile(known, CONFIDENCE)
        return Spread(value, float(low), float(high))


def draws(n_units: int, n_models: int) -> Draws:
    """The draws, the same at each call."""
    rng = np.random.default_rng(0)
    units = rng.multinomial(n_units, np.full(n_units, 1 / n_units), DRAWS).astype(np.float64)
    models = rng.multinomial(n_models, np.full(n_models, 1 / n_models), DRAWS).astype(np.float64)
    return Draws(units, models)
