"""The study as a figure: a diagram per panel, what the paper says beside it, and whether that holds here."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from pathlib import Path

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from verefine_viz.core.atomic import atomic
from verefine_viz.studies.curves import Line, Points, Verdict, lines, verdicts
from verefine_viz.studies.study import Panel, Study

WIDTH_IN, HEIGHT_IN = 6.4, 5.6
DPI = 150
BELOW_PT = -42
"""Where the text below a diagram begins, under the label of its x axis [pt]."""
COLORS = ("#8a8a8a", "#e69f00", "#56b4e9", "#0072b2", "#d55e00", "#cc79a7", "#b8a500", "#009e73")
"""After Okabe and Ito, told apart by everybody; a method has the same in every panel."""
MARKERS = "osD^vPX*"


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
    figure = Figure(figsize=(WIDTH_IN * columns * (1.4 if len(panels) == 1 else 1), HEIGHT_IN * n_rows), dpi=DPI)
    figure.suptitle(f"{study.title}\n{about}", fontsize=12)
    for k, panel in enumerate(panels, start=1):
        axes = figure.add_subplot(n_rows, columns, k)
        found = lines(panel, points)
        if len(panel.xs) > 1:
            _curves(axes, panel, found, methods)
        else:
            _bars(axes, found)
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
    """What comes before the comma says how it was used."""
    return label.split(",")[0]


def _curves(axes: Axes, panel: Panel, found: Sequence[Line], methods: Sequence[str]) -> None:
    for line in found:
        k = methods.index(_method(line.label))
        color = COLORS[k % len(COLORS)]
        axes.plot(line.xs, 100 * line.ar, color=color, marker=MARKERS[k % len(MARKERS)], ms=4, label=line.label)
        axes.fill_between(line.xs, 100 * line.low, 100 * line.high, color=color, alpha=0.12, lw=0)
    axes.set_xlabel(panel.x_label)
    axes.set_ylabel("average recall AR [%]")
    low = min(float((100 * line.low).min()) for line in found)
    axes.set_ylim(max(0.0, low - 5), 101)
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8, loc="lower left")


def _bars(axes: Axes, found: Sequence[Line]) -> None:
    places = range(len(found))
    values = [100 * float(line.ar[0]) for line in found]
    spread = [
        [v - 100 * float(line.low[0]) for v, line in zip(values, found, strict=True)],
        [100 * float(line.high[0]) - v for v, line in zip(values, found, strict=True)],
    ]
    axes.barh(places, values, xerr=spread, color=COLORS[2], ecolor="#555555", capsize=2)
    axes.set_yticks(places, [line.label for line in found], fontsize=8)
    axes.invert_yaxis()
    axes.set_xlabel("average recall AR [%]")
    axes.grid(axis="x", alpha=0.3)


def _below(panel: Panel, found: Sequence[Verdict], notes: Sequence[str]) -> str:
    width = 100 if len(panel.xs) > 1 else 130
    said = textwrap.wrap(f"Paper: {panel.trend}." if panel.trend else "", width)
    below = [
        line for note in notes for line in textwrap.wrap(note, width, initial_indent="– ", subsequent_indent="   ")
    ]
    return "\n".join([*said, *(f"• {v}" for v in found), *below])
