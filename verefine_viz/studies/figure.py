"""Figures for print: as wide as a column, as PNG, SVG and PDF, without captions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.textpath import TextPath

from verefine_viz.core.console import PrintedTable
from verefine_viz.core.writing import atomic
from verefine_viz.studies.claims import PanelLine
from verefine_viz.studies.printed_table import with_formulas

WIDTH_IN = 3.45
"""Width of a column of the paper's format."""
ROW_IN = 1.95
"""Height of a row of diagrams, with its legend [in]."""
GAP_PT = 5.0
"""Least space between the columns of a table, whose letters shrink if needed [pt]."""
LINE_IN = 0.135
"""Height of a line of a table [in]."""
DPI = 300
STYLE: dict[Any, Any] = {
    "font.size": 6.5,
    "axes.linewidth": 0.5,
    "xtick.major.width": 0.5,
    "ytick.major.width": 0.5,
    "xtick.major.size": 2.5,
    "ytick.major.size": 2.5,
    "pdf.fonttype": 42,
}
"""Letters as in a caption; in PDF they stay text."""
LEGEND: dict[str, Any] = {
    "loc": "outside lower center",
    "frameon": False,
    "handlelength": 1.4,
    "handletextpad": 0.4,
    "columnspacing": 1.0,
}
MOST_COLUMNS = 5
"""Most names in one line of a legend; more take two lines."""
COLORS = ("#8a8a8a", "#e69f00", "#56b4e9", "#0072b2", "#d55e00", "#cc79a7", "#b8a500", "#009e73")
"""After Okabe and Ito, safe for colour-blind readers; a method has the same colour in every diagram."""
MARKERS = "osD^vPXp"


@dataclass(frozen=True)
class Diagram:
    """Lines over one x."""

    title: str
    x_label: str
    y_label: str
    lines: Sequence[PanelLine]
    main: str = ""
    """Label of the line that sums up the others, drawn black and thick."""


def draw_curves(diagrams: Sequence[Diagram], mark: str = "") -> Figure:
    """A figure with two diagrams per row, which share a legend.

    Args:
        diagrams: from the top left on.
        mark: why this is not the whole study, in small letters on top: a quick one, or a part.
    """
    pairs = [diagrams[k : k + 2] for k in range(0, len(diagrams), 2)]
    labels = list(dict.fromkeys(_method(line.label) for diagram in diagrams for line in diagram.lines))
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(WIDTH_IN, ROW_IN * len(pairs)), dpi=DPI, layout="constrained")
        if mark:
            figure.suptitle(mark, fontsize=5.5, color="#555555")
        parts = np.atleast_1d(np.asarray(figure.subfigures(len(pairs), 1)))
        for part, pair in zip(parts, pairs, strict=True):
            lowest = min(_lowest(diagram.lines) for diagram in pair)
            for k, diagram in enumerate(pair):
                axes = part.add_subplot(1, 2, k + 1)
                _curves(axes, diagram, labels)
                axes.set_ylim(lowest, 102)
                if k:
                    axes.set_ylabel("")
                    axes.tick_params(labelleft=False)
            handles, names = part.axes[0].get_legend_handles_labels()
            n_columns = len(names) if len(names) <= MOST_COLUMNS else -(-len(names) // 2)
            part.legend(handles, names, ncols=n_columns, **LEGEND)
    return figure


def _method(label: str) -> str:
    """The method's name comes before a comma, how it was used after it."""
    return label.split(",")[0]


def _lowest(lines: Sequence[PanelLine]) -> float:
    low = min(float(np.nanmin(100 * line.low)) for line in lines)
    return max(0.0, 10 * np.floor((low - 2) / 10))


def _curves(axes: Axes, diagram: Diagram, labels: Sequence[str]) -> None:
    for line in diagram.lines:
        k, is_main = labels.index(_method(line.label)), line.label == diagram.main
        color = "black" if is_main else COLORS[k % len(COLORS)]
        # All bands lie below all lines, so light that several of them do not hide a line.
        axes.fill_between(line.xs, 100 * line.low, 100 * line.high, color=color, alpha=0.07, lw=0, zorder=1)
        marker = MARKERS[k % len(MARKERS)]
        lw, order = (1.6, 4) if is_main else (0.9, 3)
        axes.plot(line.xs, 100 * line.ar, color=color, marker=marker, ms=2.6, lw=lw, label=line.label, zorder=order)
    axes.set_title(diagram.title, fontsize=7)
    axes.set_xlabel(diagram.x_label)
    axes.set_ylabel(diagram.y_label)
    axes.grid(alpha=0.25, lw=0.4, zorder=0)


def draw_tables(tables: Sequence[PrintedTable], mark: str = "") -> Figure:
    """A figure with tables, one below another."""
    n_lines = sum(len(table.rows) + 3.2 for table in tables) + bool(mark)
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(WIDTH_IN, LINE_IN * n_lines), dpi=DPI)
        axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
        axes.set_axis_off()
        axes.set_xlim(0, 1)
        axes.set_ylim(n_lines, 0)
        y = 0.0
        if mark:
            axes.text(0.99, 0.6, mark, fontsize=5.5, color="#555555", ha="right", va="center")
            y = 1.0
        for table in tables:
            _table(axes, table, y)
            y += len(table.rows) + 3.2
    return figure


def _table(axes: Axes, table: PrintedTable, top: float) -> None:
    cells = (table.headings, *table.rows)
    widths_pt = np.array([max(map(_width_pt, column)) for column in zip(*cells, strict=True)])
    gaps_pt = GAP_PT * (len(widths_pt) - 1)
    size = STYLE["font.size"] * min(1.0, (0.98 * 72 * WIDTH_IN - gaps_pt) / widths_pt.sum())
    gap_pt = (0.98 * 72 * WIDTH_IN - widths_pt.sum() * size / STYLE["font.size"]) / max(len(widths_pt) - 1, 1)
    right = 0.01 + np.cumsum(widths_pt * size / STYLE["font.size"] + gap_pt) / (72 * WIDTH_IN)
    right -= gap_pt / (72 * WIDTH_IN)
    axes.text(0.01, top + 0.7, table.title, fontweight="bold", va="center")
    for y, lw in ((top + 1.3, 0.9), (top + 2.3, 0.5), (top + 2.4 + len(table.rows), 0.9)):
        axes.plot((0.01, 0.99), (y, y), color="black", lw=lw)
    for r, row in enumerate(cells):
        y = top + 1.8 + r + 0.05 * bool(r)
        if r - 1 in table.rules:
            axes.plot((0.01, 0.99), (y - 0.5, y - 0.5), color="black", lw=0.3)
        for k, text in enumerate(row):
            weight = "bold" if (r - 1, k) in table.styles else "normal"
            x, side = (right[k], "right") if k else (0.01, "left")
            axes.text(x, y, with_formulas(text), ha=side, va="center", weight=weight, size=size)


def _width_pt(text: str) -> float:
    """Width of a text in bold letters [pt]."""
    if not text:
        return 0.0
    path = TextPath((0, 0), with_formulas(text), size=STYLE["font.size"], prop=FontProperties(weight="bold"))
    return float(path.get_extents().width)


def save(figure: Figure, folder: Path, name: str) -> tuple[Path, ...]:
    """Write ``name.png``, ``name.svg`` and ``name.pdf``.

    Raises:
        InputError: they cannot be written.
    """
    # No dates in the files: the same study gives the same files.
    metadata: Mapping[str, Mapping[str, None]] = {
        "png": {"Software": None},
        "svg": {"Date": None},
        "pdf": {"CreationDate": None},
    }
    made: list[Path] = []
    for suffix, without in metadata.items():
        path = folder / f"{name}.{suffix}"
        with atomic(path) as part, mpl.rc_context({**STYLE, "svg.hashsalt": name}):
            figure.savefig(part, format=suffix, metadata=dict(without))
        made.append(path)
    return tuple(made)
