"""From outcomes to curves: means with bands over the seeds, and whether they lie as the paper says."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.studies.solve import Outcome
from verefine_viz.studies.study import Claim, Panel, Study

RESAMPLES = 2000
"""Draws of the bootstrap."""
AT_ONCE = 1_000_000
"""Values drawn together, which bounds memory."""
FEWEST = 6
"""Pairs that a verdict needs: five of pure chance all have the same sign once in 16 times, and a bootstrap of them
would then be sure."""

Points = Mapping[tuple[str, str, float], Sequence[Outcome]]
"""Outcomes by panel, curve and x."""


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
    """95 % interval, paired: the bootstrap draws objects in a frame under one seed, each with all of its x."""
    n_pairs: int
    """What it draws from."""

    @property
    def word(self) -> str:
        """holds, does not hold, too close to tell, too few to tell, or the same."""
        if self.low == self.high == 0:
            return "the same"
        if self.n_pairs < FEWEST:
            return "too few to tell"
        if self.low > 0:
            return "holds"
        return "does not hold" if self.high < 0 else "too close to tell"

    def __str__(self) -> str:
        return (
            f"{self.claim.better} over {self.claim.worse}: {self.word} "
            f"({100 * self.difference:+.1f}, 95 % {100 * self.low:+.1f} to {100 * self.high:+.1f} points of AR)"
        )


def points(outcomes: Iterable[Outcome]) -> Points:
    """The outcomes sorted into the points of the curves, in the order they come in."""
    found: dict[tuple[str, str, float], list[Outcome]] = {}
    for o in outcomes:
        found.setdefault((o.panel, o.curve, o.x), []).append(o)
    return found


def lines(panel: Panel, found: Points) -> list[Line]:
    """The curves of a panel, in its order."""
    return [_line(panel, curve.label, found) for curve in panel.curves]


def verdicts(panel: Panel, found: Points) -> list[Verdict]:
    """What the paper says of the panel's curves, tested on these data: pairs of the same object, frame, x and seed."""
    tested: list[Verdict] = []
    for claim in panel.claims:
        gains: dict[tuple[str, str, int, int], list[float]] = {}
        for x in panel.xs:
            worse = {_case(o): o.quality.ar for o in found.get((panel.name, claim.worse, x), ())}
            for o in found.get((panel.name, claim.better, x), ()):
                if (case := _case(o)) in worse:
                    gains.setdefault(case, []).append(o.quality.ar - worse[case])
        if gains:
            # Errors of one object under one seed have the same direction at every x: they are drawn together.
            pairs = np.array([sum(of_case) / len(of_case) for of_case in gains.values()])
            tested.append(Verdict(claim, float(pairs.mean()), *band(pairs), len(pairs)))
    return tested


def rows(study: Study, found: Points) -> Iterator[dict[str, str | float]]:
    """The study as a table: a row per panel, curve and x."""
    for panel in study.panels:
        for line in lines(panel, found):
            for x, ar, low, high in zip(line.xs.tolist(), line.ar, line.low, line.high, strict=True):
                mine = found.get((panel.name, line.label, x), ())
                if not mine:
                    continue
                add = np.array([np.nan if o.quality.add_s_mm is None else o.quality.add_s_mm for o in mine])
                near = [o.quality.relative is not None and o.quality.relative < 0.1 for o in mine]
                yield {
                    "panel": panel.name,
                    "curve": line.label,
                    "x": x,
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


def _line(panel: Panel, label: str, found: Points) -> Line:
    values = [np.array([o.quality.ar for o in found.get((panel.name, label, x), ())]) for x in panel.xs]
    means = np.array([v.mean() if v.size else np.nan for v in values])
    low, high = np.array([band(v) for v in values]).T
    return Line(label, np.array(panel.xs), means, low, high)


def _case(o: Outcome) -> tuple[str, str, int, int]:
    return o.scene, o.frame, o.instance_id, o.seed


def band(values: Float) -> tuple[float, float]:
    """95 % interval of the mean by the bootstrap of N ``values`` (N,), the same at each call; NaN of nothing."""
    if not values.size:
        return float("nan"), float("nan")
    rng, n = np.random.default_rng(0), values.size
    block = max(1, AT_ONCE // n)
    sizes = ((min(block, RESAMPLES - k), n) for k in range(0, RESAMPLES, block))
    means = np.concatenate([values[rng.integers(n, size=size)].mean(axis=1) for size in sizes])
    low, high = np.percentile(means, [2.5, 97.5])
    return float(low), float(high)
