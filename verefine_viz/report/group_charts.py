"""Charts of several groups of runs. A group has the same colour in all of them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from verefine_viz.diagnosis.causes import cause_title
from verefine_viz.report.charts import DOTTED, css, new_figure, rounded, stage_bars
from verefine_viz.report.group_comparison import Line, RecallCurve
from verefine_viz.report.run_results import THRESHOLDS

GREY = "#98a3b5"
GROUP_COLORS = (
    (31, 119, 180),
    (255, 127, 14),
    (44, 160, 44),
    (214, 39, 40),
    (148, 103, 189),
    (140, 86, 75),
    (227, 119, 194),
    (188, 189, 34),
    (23, 190, 207),
    (0, 150, 110),
    (190, 60, 160),
    (235, 180, 100),
    (110, 130, 235),
)
"""Without grey, which is the best group's in the others' panels."""
DASHES = ("solid", "dash", "dot")
"""Of curves: a second and third round through the colours."""
MOST_BANDS = 4
"""Bands that are readable over each other; of more groups, each gets a panel of its own."""
PANELS_A_ROW = 4
PANEL_PX = 190
CAUSE_COLORS = ("#4e79a7", "#f28e2b", "#e15759", "#76b7b2", "#59a14f", "#edc948", "#b07aa1", "#ff9da7", "#9c755f",
                "#86bcb6", "#d37295", "#a0cbe8", "#8cd17d")  # fmt: skip
UNEXPLAINED = "#b8c0cc"
ROW_PX = 26
"""Height of a bar with its gap."""


def colors(lines: Sequence[Line]) -> dict[str, tuple[str, str]]:
    """Colour and dash of each group, by name: another order leaves them as they are."""
    shades = {}
    for k, name in enumerate(sorted(line.name for line in lines)):
        r, g, b = GROUP_COLORS[k % len(GROUP_COLORS)]
        shades[name] = css((r, g, b)), DASHES[k // len(GROUP_COLORS) % len(DASHES)]
    return shades


def forest_figure(lines: Sequence[Line]) -> go.Figure:
    """Recall of each group with its interval."""
    known = [(line, line.recall) for line in lines if line.recall is not None]
    figure = new_figure("objects right: error below 10 % of the diameter [%]", "", height=90 + ROW_PX * len(known))
    shades = colors(lines)
    for line, recall in known:
        low, high = (recall.value if end is None else end for end in (recall.low, recall.high))
        figure.add_scatter(
            x=[round(100 * recall.value, 2)],
            y=[line.name],
            error_x={
                "array": [round(100 * (high - recall.value), 2)],
                "arrayminus": [round(100 * (recall.value - low), 2)],
                "thickness": 2,
                "width": 5,
            },
            mode="markers",
            marker={"color": shades[line.name][0], "size": 11},
            hovertemplate=f"%{{y}}: %{{x:.1f}} %, 95 %: {100 * low:.1f} to {100 * high:.1f} %<extra></extra>",
            showlegend=False,
        )
    if known:
        figure.add_vline(x=100 * known[0][1].value, line=DOTTED)
    figure.update_yaxes(autorange="reversed", automargin=True, ticksuffix=" ")
    return figure


def needs_panels(lines: Sequence[Line]) -> bool:
    """Whether bands would cover each other in one chart."""
    return sum(line.curve is not None for line in lines) > MOST_BANDS


def recall_figure(lines: Sequence[Line]) -> go.Figure:
    """Recall over the threshold, a curve for each group, with bands where they are few."""
    figure = new_figure("error below … % of the diameter", "share of objects [%]", height=430)
    shades = colors(lines)
    for line in lines:
        if line.curve is not None:
            if not needs_panels(lines):
                _add_band(figure, line.curve, shades[line.name][0], legendgroup=line.name)
            _add_curve(figure, line.curve, line.name, shades[line.name], legendgroup=line.name, name=line.name)
    figure.add_vline(x=10, line=DOTTED)
    figure.update_yaxes(range=[0, 103])
    figure.update_xaxes(range=[0, 50])
    figure.update_layout(legend={"orientation": "v", "x": 1.01, "y": 1, "xanchor": "left", "yanchor": "top"})
    figure.update_layout(margin={"r": 10}, showlegend=True)
    return figure


def panel_figure(lines: Sequence[Line]) -> go.Figure:
    """A small chart for each group: its curve and band before the best group's curve in grey."""
    known = [(line.name, line.curve) for line in lines if line.curve is not None]
    n_rows, shades = -(-len(known) // PANELS_A_ROW), colors(lines)
    figure = make_subplots(
        n_rows,
        PANELS_A_ROW,
        shared_xaxes=True,
        shared_yaxes=True,
        subplot_titles=[name for name, _ in known],
        horizontal_spacing=0.025,
        vertical_spacing=0.16 / n_rows,
    )
    for k, (name, curve) in enumerate(known):
        place: dict[str, Any] = {"row": k // PANELS_A_ROW + 1, "col": k % PANELS_A_ROW + 1}
        best_name, best = known[0]
        _add_band(figure, curve, shades[name][0], opacity=0.25, **place)
        if k:
            _add_curve(figure, best, best_name, (GREY, "solid"), showlegend=False, **place)
        _add_curve(figure, curve, name, (shades[name][0], "solid"), showlegend=False, **place)
        figure.add_vline(x=10, line=DOTTED, **place)
    layout = new_figure("", "", height=40 + PANEL_PX * n_rows).to_dict()["layout"]
    figure.update_layout({name: value for name, value in layout.items() if name not in ("xaxis", "yaxis", "legend")})
    figure.update_layout(template=go.layout.Template(), margin={"l": 40, "r": 10, "t": 26, "b": 30})
    figure.update_annotations(font={"size": 12.5})
    figure.update_xaxes(range=[0, 50], zeroline=False)
    figure.update_yaxes(range=[0, 103], zeroline=False)
    return figure


def _add_curve(figure: go.Figure, curve: RecallCurve, label: str, shade: tuple[str, str], **where: Any) -> None:
    figure.add_scatter(
        x=rounded(100 * THRESHOLDS, 1),
        y=rounded(100 * curve.recall, 1),
        mode="lines",
        line={"color": shade[0], "width": 2, "dash": shade[1]},
        hovertemplate=f"{label}, below %{{x}} %: %{{y}} %<extra></extra>",
        **where,
    )


def _add_band(figure: go.Figure, curve: RecallCurve, shade: str, opacity: float = 0.14, **where: Any) -> None:
    if curve.band is None:
        return
    xs, (low, high) = rounded(100 * THRESHOLDS, 1), curve.band
    figure.add_scatter(
        x=xs + xs[::-1],
        y=rounded(100 * np.concatenate([high, low[::-1]]), 1),
        mode="lines",
        line={"width": 0},
        fill="toself",
        fillcolor=shade.replace("rgb", "rgba").replace(")", f",{opacity})"),
        hoverinfo="skip",
        showlegend=False,
        **where,
    )


def cause_figure(lines: Sequence[Line]) -> go.Figure:
    """Failures by cause, as a share of the objects of each group."""
    figure = new_figure("share of objects [%]", "", height=150 + ROW_PX * len(lines))
    totals: dict[str, float] = {}
    for line in lines:
        for cause, n in line.causes.items():
            totals[cause] = totals.get(cause, 0.0) + n / max(line.n_with_truth, 1)
    causes = sorted(totals, key=lambda cause: (cause == "", -totals[cause]))
    for k, cause in enumerate(causes):
        name = cause_title(cause) if cause else "not explained"
        shares = np.array([100 * line.causes.get(cause, 0) / max(line.n_with_truth, 1) for line in lines])
        figure.add_bar(
            y=[line.name for line in lines],
            x=rounded(shares, 2),
            name=name,
            orientation="h",
            marker={"color": CAUSE_COLORS[k % len(CAUSE_COLORS)] if cause else UNEXPLAINED},
            customdata=[line.causes.get(cause, 0) for line in lines],
            hovertemplate=f"%{{y}}: {name}, %{{x:.1f}} % (%{{customdata}})<extra></extra>",
        )
    figure.update_layout(barmode="stack", legend={"traceorder": "normal"}, showlegend=True)
    figure.update_yaxes(autorange="reversed", automargin=True, ticksuffix=" ")
    return figure


def time_figure(lines: Sequence[Line]) -> go.Figure:
    """Time a frame by stage."""
    figure = stage_bars({line.name: line.stages_ms for line in lines})
    figure.update_layout(height=150 + ROW_PX * len(lines))
    figure.update_yaxes(ticksuffix=" ")
    return figure
