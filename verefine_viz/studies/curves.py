"""From outcomes to curves: means with bands over the seeds, and whether they lie as the paper says."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.studies.solve import Outcome
from verefine_viz.studies.study import Claim, Panel, Study

RESAMPLES = 2000
"""Draws of the bootstrap."""


@dataclass(frozen=True)
class Line:
    """One curve of a panel."""

    label: str
    xs: Float
    ar: Float
    """Mean over objects, frames and seeds at each x, in [0, 1]."""
    low: Float
    high: Float
    """95 % interval of the mean over objects, frames and seeds (bootstrap)."""


@dataclass(frozen=True)
class Verdict:
    """Whether a claim holds on these data."""

    claim: Claim
    difference: float
    """Mean of AR of the better less that of the worse, over the panel."""
    low: float
    high: float
    """95 % interval, paired."""

    @property
    def word(self) -> str:
        """holds, does not hold, or too close to tell."""
        if self.low > 0:
            return "holds"
        return "does not hold" if self.high < 0 else "too close to tell"

    def __str__(self) -> str:
        return (
            f"{self.claim.better} over {self.claim.worse}: {self.word} "
            f"({100 * self.difference:+.1f}, 95 % {100 * self.low:+.1f} to {100 * self.high:+.1f} points of AR)"
        )


def lines(panel: Panel, outcomes: Sequence[Outcome]) -> list[Line]:
    """The curves of a panel, in its order."""
    found: list[Line] = []
    for curve in panel.curves:
        values = [_values(outcomes, panel.name, curve.label, x) for x in panel.xs]
        bands = [_band(v) for v in values]
        means = np.array([v.mean() if v.size else np.nan for v in values])
        low, high = np.array(bands).T
        found.append(Line(curve.label, np.array(panel.xs), means, low, high))
    return found


def verdicts(panel: Panel, outcomes: Sequence[Outcome]) -> list[Verdict]:
    """What the paper says of the panel's curves, tested on these data: pairs of the same object, frame, x and seed."""
    found: list[Verdict] = []
    for claim in panel.claims:
        better, worse = (_by_case(outcomes, panel.name, label) for label in (claim.better, claim.worse))
        pairs = np.array([better[k] - worse[k] for k in sorted(better.keys() & worse.keys())])
        if pairs.size:
            found.append(Verdict(claim, float(pairs.mean()), *_band(pairs)))
    return found


def rows(study: Study, outcomes: Sequence[Outcome]) -> Iterator[dict[str, str | float]]:
    """The study as a table: a row per panel, curve and x."""
    for panel in study.panels:
        for line in lines(panel, outcomes):
            for x, ar, low, high in zip(line.xs, line.ar, line.low, line.high, strict=True):
                mine = [o for o in outcomes if (o.panel, o.curve, o.x) == (panel.name, line.label, x)]
                add = np.array([np.nan if o.quality.add_s_mm is None else o.quality.add_s_mm for o in mine])
                near = [o.quality.relative is not None and o.quality.relative < 0.1 for o in mine]
                yield {
                    "panel": panel.name,
                    "curve": line.label,
                    "x": float(x),
                    "n": len(mine),
                    "ar": float(ar),
                    "ar_low": float(low),
                    "ar_high": float(high),
                    "ar_vsd": float(np.mean([o.quality.ar_vsd for o in mine])),
                    "ar_mssd": float(np.mean([o.quality.ar_mssd for o in mine])),
                    "ar_mspd": float(np.mean([o.quality.ar_mspd for o in mine])),
                    "median_add_s_mm": float(np.nanmedian(add)) if np.isfinite(add).any() else float("nan"),
                    "below_10_percent": float(np.mean(near)),
                    "ms_per_object": float(np.mean([o.ms for o in mine])),
                    "refiner_calls_per_object": float(np.mean([o.refiner_calls for o in mine])),
                }


def _values(outcomes: Sequence[Outcome], panel: str, curve: str, x: float) -> Float:
    return np.array([o.quality.ar for o in outcomes if (o.panel, o.curve, o.x) == (panel, curve, x)])


def _by_case(outcomes: Sequence[Outcome], panel: str, curve: str) -> dict[tuple[object, ...], float]:
    return {
        (o.scene, o.frame, o.instance_id, o.x, o.seed): o.quality.ar
        for o in outcomes
        if (o.panel, o.curve) == (panel, curve)
    }


def _band(values: Float) -> tuple[float, float]:
    """95 % interval of the mean by the bootstrap, the same at each call."""
    if not values.size:
        return float("nan"), float("nan")
    drawn = np.random.default_rng(0).integers(values.size, size=(RESAMPLES, values.size))
    low, high = np.percentile(values[drawn].mean(axis=1), [2.5, 97.5])
    return float(low), float(high)
