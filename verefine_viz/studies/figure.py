"""A study's curves: means with bands over the seeds, whether the paper's claims hold, and the figure of both."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from verefine_viz.core.arrays import Float
from verefine_viz.core.writing import atomic
from verefine_viz.studies.solve_unit import Outcome
from verefine_viz.studies.study_plan import Claim, Panel, Study

RESAMPLES = 2000
"""Draws of the bootstrap."""
AT_ONCE = 1_000_000
"""Values drawn together, which bounds memory."""
FEWEST = 6
"""Pairs that a verdict needs: five of pure chance all have the same sign once in 16 times, and a bootstrap of them
would then be sure."""
WIDTH_IN, HEIGHT_IN = 6.4, 5.6
BAR_IN = 0.17
"""Of a table's row [in]."""
DPI = 150
BELOW_PT = -42
"""Where the text below a diagram begins, under the label of its x axis [pt]."""
COLORS = ("#8a8a8a", "#e69f00", "#56b4e9", "#0072b2", "#d55e00", "#cc79a7", "#b8a500", "#009e73")
"""After Okabe and Ito, safe for colour-blind readers; a method has the same in every panel."""
MARKERS = "osD^vPX*"

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


def points_of(outcomes: Iterable[Outcome]) -> Points:
    """The outcomes sorted into the points of the curves, in the order they come in."""
    points: dict[tuple[str, str, float], list[Outcome]] = {}
    for o in outcomes:
        points.setdefault((o.panel, o.curve, o.x), []).append(o)
    return points


def lines(panel: Panel, points: Points) -> list[Line]:
    """The curves of a panel, in its order."""
    return [_line(panel, curve.label, points) for curve in panel.curves]


def verdicts(panel: Panel, points: Points) -> list[Verdict]:
    """The paper's claims about the panel's curves, tested on pairs of the same object, frame, x and seed."""
    tested: list[Verdict] = []
    for claim in panel.claims:
        gains: dict[tuple[str, str, int, int], list[float]] = {}
        for x in panel.xs:
            worse = {_case(o): o.quality.ar for o in points.get((panel.name, claim.worse, x), ())}
            for o in points.get((panel.name, claim.better, x), ()):
                if (case := _case(o)) in worse:
                    gains.setdefault(case, []).append(o.quality.ar - worse[case])
        if gains:
            # Errors of one object under one seed have the same direction at every x: they are drawn together.
            pairs = np.array([sum(of_case) / len(of_case) for of_case in gains.values()])
            tested.append(Verdict(claim, float(pairs.mean()), *band(pairs), len(pairs)))
    return tested


def rows(study: Study, points: Points) -> Iterator[dict[str, str | float]]:
    """The study as a table: a row per panel, curve and x."""
    for panel in study.panels:
        for line in lines(panel, points):
            for x, ar, low, high in zip(line.xs.tolist(), line.ar, line.low, line.high, strict=True):
                mine = points.get((panel.name, line.label, x), ())
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


def _line(panel: Panel, label: str, points: Points) -> Line:
    values = [np.array([o.quality.ar for o in points.get((panel.name, label, x), ())]) for x in panel.xs]
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


def draw(study: Study, points: Points, about: str, notes: Sequence[str] = ()) -> Figure:
    """All panels.

    Args:
        study: what was run.
        points: outcomes of all its units.
        about: which frames and how many seeds, in a few words.
        notes: sentences that go below, such as what is missing and why.
    """
    panels = study.panels
    methods = list(dict.fromkeys(_method(curve.label) for panel in panels for curve in panel.curves))
    columns = min(len(panels), 2)
    n_rows = -(-len(panels) // columns)
    n_bars = len(panels[0].curves) if len(panels) == len(panels[0].xs) == 1 else 0
    height_in = max(HEIGHT_IN * n_rows, 0.75 * HEIGHT_IN + BAR_IN * n_bars)
    figure = Figure(figsize=(WIDTH_IN * columns * (1.4 if len(panels) == 1 else 1), height_in), dpi=DPI)
    figure.suptitle(f"{study.title}\n{about}", fontsize=12)
    for k, panel in enumerate(panels, start=1):
        axes = figure.add_subplot(n_rows, columns, k)
        if len(panel.xs) > 1:
            _curves(axes, panel, lines(panel, points), methods)
        else:
            _bars(axes, lines(panel, points))
        if len(panels) > 1:
            axes.set_title(panel.name)
        axes.annotate(
            _below(panel, verdicts(panel, points), notes),
            (0.0, 0.0),
            (0.0, BELOW_PT),
            xycoords="axes fraction",
            textcoords="offset points",
            va="top",
            fontsize=7.5,
            color="#333333",
        )
    figure.tight_layout(h_pad=2.0)
    return figure


def save(figure: Figure, folder: Path, name: str) -> tuple[Path, Path]:
    """As ``name.png`` and ``name.svg``.

    Raises:
        InputError: they cannot be written.
    """
    made = []
    for suffix in ("png", "svg"):
        path = folder / f"{name}.{suffix}"
        # The same study gives the same file.
        with atomic(path) as part, mpl.rc_context({"svg.hashsalt": name}):
            figure.savefig(part, format=suffix, metadata={"Date": None} if suffix == "svg" else {"Software": None})
        made.append(path)
    return made[0], made[1]


def _method(label: str) -> str:
    """The method's name comes before a comma, how it was used after it."""
    return label.split(",")[0]


def _curves(axes: Axes, panel: Panel, curves: Sequence[Line], methods: Sequence[str]) -> None:
    for line in curves:
        k = methods.index(_method(line.label))
        color = COLORS[k % len(COLORS)]
        axes.plot(line.xs, 100 * line.ar, color=color, marker=MARKERS[k % len(MARKERS)], ms=4, label=line.label)
        axes.fill_between(line.xs, 100 * line.low, 100 * line.high, color=color, alpha=0.12, lw=0)
    axes.set_xlabel(panel.x_label)
    axes.set_ylabel("average recall AR [%]")
    low = min(float((100 * line.low).min()) for line in curves)
    axes.set_ylim(max(0.0, low - 5), 101)
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8, loc="lower left")


def _bars(axes: Axes, bars: Sequence[Line]) -> None:
    ys = range(len(bars))
    values = [100 * float(line.ar[0]) for line in bars]
    spread = [
        [v - 100 * float(line.low[0]) for v, line in zip(values, bars, strict=True)],
        [100 * float(line.high[0]) - v for v, line in zip(values, bars, strict=True)],
    ]
    axes.barh(ys, values, xerr=spread, color=COLORS[2], ecolor="#555555", capsize=2)
    axes.set_yticks(ys, [line.label for line in bars], fontsize=8)
    axes.invert_yaxis()
    axes.set_xlabel("average recall AR [%]")
    axes.grid(axis="x", alpha=0.3)


def _below(panel: Panel, tested: Sequence[Verdict], notes: Sequence[str]) -> str:
    width = 100 if len(panel.xs) > 1 else 130
    trend = textwrap.wrap(f"Paper: {panel.trend}." if panel.trend else "", width)
    below = [
        line for note in notes for line in textwrap.wrap(note, width, initial_indent="– ", subsequent_indent="   ")
    ]
    return "\n".join([*trend, *(f"• {v}" for v in tested), *below])
