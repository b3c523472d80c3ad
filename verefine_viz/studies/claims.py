"""Evaluates the outcomes of a study: means with intervals, and whether the paper's claims hold.

An interval covers other frames with other objects: both are drawn with replacement (evaluation/bootstrap.py). All
errors and seeds of an object in a frame are drawn together: they are not further objects.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.evaluation.bootstrap import FEWEST_SCENES, CellSums, Draws, Spread, draws
from verefine_viz.studies.solve_unit import UnitAnswer
from verefine_viz.studies.study_plan import Claim, Metric, Panel, Study

FEWEST = 6
"""Fewest objects in frames for a verdict: by pure chance five have the same sign once in 16 times, and a bootstrap of
them would then be certain."""
MOST_DIGITS = 4
"""Decimals of a difference in points of AR."""

Points = Mapping[tuple[str, str, float], Sequence[UnitAnswer]]
"""Outcomes by panel, curve and x."""
Case = tuple[float, str, str, int | None, int | None]
"""Key by which two curves are paired: x, scene, frame, object and seed."""


@dataclass(frozen=True)
class PanelLine:
    """One curve of a panel."""

    label: str
    xs: Float
    ar: Float
    """Mean over objects, frames and seeds at each x, in [0, 1]."""
    low: Float
    high: Float
    """95 % interval."""


@dataclass(frozen=True)
class ClaimVerdict:
    """Whether a claim holds on these data."""

    claim: Claim
    spread: Spread
    """Mean of the better minus that of the worse, over the claim's x; minus the same difference in the panel
    ``claim.than``, if any."""
    n_objects: int
    """Number of objects in frames behind the interval."""

    @property
    def word(self) -> str:
        """holds, does not hold, too close to tell, too few to tell, or the same."""
        s = self.spread
        if s.value == 0 and not (s.low or s.high):
            return "the same"
        if self.n_objects < FEWEST or s.low is None or s.high is None:
            return "too few to tell"
        if s.low > 0:
            return "holds"
        return "does not hold" if s.high < 0 else "too close to tell"

    @property
    def numbers(self) -> str:
        """The difference and its interval in points, with as many digits as they need to differ from 0."""
        s = self.spread
        known = [round(100 * v, MOST_DIGITS) + 0.0 for v in (s.value, s.low, s.high) if v is not None]  # no -0.0
        digits = next((d for d in range(1, MOST_DIGITS) if all(v == 0 or round(v, d) != 0 for v in known)), MOST_DIGITS)
        value, *ends = (f"{v:+.{digits}f}" for v in known)
        return f"{value} ({ends[0]} to {ends[1]})" if ends else value

    @property
    def about(self) -> str:
        """The comparison in words, with metric and x unless they are AR and all."""
        c = self.claim
        of = "" if c.metric == "ar" else f" in {c.metric.removeprefix('ar_').upper()}"
        to_x = f" up to {c.to_x:g}" if np.isfinite(c.to_x) else ""
        from_x = f" from {c.from_x:g} on" if np.isfinite(c.from_x) else ""
        than = f", less that of {c.than}" if c.than else ""
        return f"{c.better} over {c.worse}{of}{from_x}{to_x}{than}"

    def __str__(self) -> str:
        return f"{self.about}: {self.word}, {self.numbers} points, {self.n_objects} objects"


def points_of(outcomes: Iterable[UnitAnswer]) -> Points:
    """The outcomes by point of the curves, in their order of arrival, without missing ones."""
    points: dict[tuple[str, str, float], list[UnitAnswer]] = {}
    for o in outcomes:
        if not o.missing:
            points.setdefault((o.panel, o.curve, o.x), []).append(o)
    return points


def missing_curves(outcomes: Iterable[UnitAnswer]) -> dict[tuple[str, str], str]:
    """Why a curve lacks an answer in at least one frame, by panel and curve."""
    return {(o.panel, o.curve): o.missing for o in outcomes if o.missing}


class _Objects:
    """The frames (or scenes, where there are many) and object models of a panel, with their bootstrap draws."""

    def __init__(self, panel: Panel, points: Points) -> None:
        mine = [o for (name, _, _), outcomes in points.items() if name == panel.name for o in outcomes]
        scenes = sorted({self._scene(o) for o in mine})
        self._by_scene = len(scenes) >= FEWEST_SCENES
        self._units = scenes if self._by_scene else sorted({(o.scene, o.answer.frame) for o in mine})
        self._models = sorted({(o.answer.obj_id, o.answer.name) for o in mine})
        # Every curve may be missing.
        self._shape = max(len(self._units), 1), max(len(self._models), 1)
        self.draws: Draws = draws(*self._shape)

    def cells(self, values: Iterable[tuple[UnitAnswer, float]]) -> CellSums:
        """Sums of values by the frame and model of the answer that each belongs to."""
        total, n = np.zeros((2, *self._shape))
        for o, value in values:
            unit = self._scene(o) if self._by_scene else (o.scene, o.answer.frame)
            at = self._units.index(unit), self._models.index((o.answer.obj_id, o.answer.name))
            total[at] += value
            n[at] += 1
        return CellSums(total, n)

    @staticmethod
    def _scene(o: UnitAnswer) -> tuple[str, str]:
        return o.scene, o.answer.frame.partition("/")[0]


def lines(panel: Panel, points: Points) -> list[PanelLine]:
    """The curves of a panel, in its order."""
    objects = _Objects(panel, points)
    return [_line(panel, curve.label, points, objects) for curve in panel.curves]


def _line(panel: Panel, label: str, points: Points, objects: _Objects) -> PanelLine:
    ends: list[tuple[float, float, float]] = []
    for x in panel.xs:
        answers = points.get((panel.name, label, x), ())
        s = objects.draws.mean(objects.cells((o, o.recall("ar")) for o in answers))
        value = np.nan if s is None else s.value
        # A single object has no interval.
        ends.append((value, value, value) if s is None or s.low is None or s.high is None else (value, s.low, s.high))
    means, low, high = np.array(ends).T
    return PanelLine(label, np.array(panel.xs), means, low, high)


def verdicts(panel: Panel, points: Points) -> list[ClaimVerdict]:
    """The paper's claims about the panel's curves, tested on pairs of the same object, frame, x and seed."""
    objects = _Objects(panel, points)
    tested: list[ClaimVerdict] = []
    for claim in panel.claims:
        pairs = _pairs(panel.name, claim, points)
        more = {case: better.recall(claim.metric) for case, (better, _) in pairs.items()}
        less = {case: worse.recall(claim.metric) for case, (_, worse) in pairs.items()}
        if claim.than:
            others = _pairs(claim.than, claim, points)
            more, less = _gains(pairs, claim.metric), _gains(others, claim.metric)
        cases = sorted(more.keys() & less.keys())
        answers = [pairs[case][0] for case in cases]
        a, b = (objects.cells(zip(answers, map(of.__getitem__, cases), strict=True)) for of in (more, less))
        spread = objects.draws.difference(a, b)
        if spread is not None:
            seen = {(o.scene, o.answer.frame, o.answer.instance_id) for o in answers}
            tested.append(ClaimVerdict(claim, spread, len(seen)))
    return tested


def _pairs(panel: str, claim: Claim, points: Points) -> dict[Case, tuple[UnitAnswer, UnitAnswer]]:
    """Pairs of answers of the claim's two curves in a panel."""
    better, worse = (_by_case(panel, label, claim, points) for label in (claim.better, claim.worse))
    return {case: (better[case], worse[case]) for case in better.keys() & worse.keys()}


def _gains(pairs: Mapping[Case, tuple[UnitAnswer, UnitAnswer]], metric: Metric) -> dict[Case, float]:
    return {case: better.recall(metric) - worse.recall(metric) for case, (better, worse) in pairs.items()}


def _by_case(panel: str, label: str, claim: Claim, points: Points) -> dict[Case, UnitAnswer]:
    return {
        (x, o.scene, o.answer.frame, o.answer.instance_id, o.answer.seed): o
        for (name, curve, x), outcomes in points.items()
        if (name, curve) == (panel, label) and claim.from_x <= x <= claim.to_x
        for o in outcomes
    }


def rows(study: Study, points: Points) -> Iterator[dict[str, str | float]]:
    """The study as a table: a row per panel, curve and x."""
    for panel in study.panels:
        for line in lines(panel, points):
            for x, ar, low, high in zip(line.xs.tolist(), line.ar, line.low, line.high, strict=True):
                mine = points.get((panel.name, line.label, x), ())
                if mine:
                    yield {
                        "panel": panel.name,
                        "curve": line.label,
                        "x": x,
                        "n": len(mine),
                        "ar": float(ar),
                        "ar_low": float(low),
                        "ar_high": float(high),
                        **_numbers(mine),
                    }


def _numbers(mine: Sequence[UnitAnswer]) -> dict[str, float]:
    add, turn, shift = (
        np.array([v for o in mine if (v := getattr(o.answer, name)) is not None] or [np.nan])
        for name in ("add_s_mm", "rotation_deg", "translation_mm")
    )
    return {
        "ar_vsd": float(np.mean([o.recall("ar_vsd") for o in mine])),
        "ar_mssd": float(np.mean([o.recall("ar_mssd") for o in mine])),
        "ar_mspd": float(np.mean([o.recall("ar_mspd") for o in mine])),
        "rotation_deg": float(turn.mean()),
        "translation_cm": float(shift.mean()) / 10,
        "median_add_s_mm": float(np.median(add)),
        "below_10_percent": float(np.mean([o.answer.is_correct is True for o in mine])),
        "ms_per_object": float(np.mean([o.ms for o in mine])),
        "refiner_calls_per_object": float(np.mean([o.refiner_calls for o in mine])),
    }
