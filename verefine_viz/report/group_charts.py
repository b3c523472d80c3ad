"""Charts of several groups of runs. A group has the same colour in all of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import plotly.graph_objects as go

from verefine_viz.core.palette import ARM_COLORS
from verefine_viz.diagnosis.words import cause_title
from verefine_viz.report.charts import css, new_figure, rounded, stage_bars
from verefine_viz.report.comparison import Line
from verefine_viz.report.numbers import THRESHOLDS

DASHES = ("solid", "dash", "dot")
"""Of curves: a second and third round through the colours."""
CAUSE_COLORS = ("#4e79a7", "#f28e2b", "#e15759", "#76b7b2", "#59a14f", "#edc948", "#b07aa1", "#ff9da7", "#9c755f",
                "#86bcb6", "#d37295", "#a0cbe8", "#8cd17d")  # fmt: skip
UNEXPLAINED = "#b8c0cc"
ROW_PX = 26
"""Height of a bar with its gap."""


def colors(lines: Sequence[Line]) -> dict[str, tuple[str, str]]:
    """Colour and dash of each group, by name: another order leaves them as they are."""
    found = {}
    for k, name in enumerate(sorted(line.name for line in lines)):
        r, g, b = ARM_COLORS[k % len(ARM_COLORS)]
        found[name] = css((r, g, b)), DASHES[k // len(ARM_COLORS) % len(DASHES)]
    return found


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
        figure.add_vline(x=100 * known[0][1].value, line={"width": 1, "dash": "dot", "color": "#888"})
    figure.update_yaxes(autorange="reversed", automargin=True, ticksuffix=" ")
    return figure


def recall_figure(lines: Sequence[Line]) -> go.Figure:
    """Recall over the threshold, a curve and its band for each group."""
    figure = new_figure("error below … % of the diameter", "share of objects [%]", height=430)
    shades, xs = colors(lines), rounded(100 * THRESHOLDS, 1)
    for line in lines:
        if line.curve is None:
            continue
        shade, dash = shades[line.name]
        if line.curve.band is not None:
            low, high = line.curve.band
            figure.add_scatter(
                x=xs + xs[::-1],
                y=rounded(100 * np.concatenate([high, low[::-1]]), 1),
                legendgroup=line.name,
                mode="lines",
                line={"width": 0},
                fill="toself",
                fillcolor=shade.replace("rgb", "rgba").replace(")", ",0.10)"),
                hoverinfo="skip",
                showlegend=False,
            )
        figure.add_scatter(
            x=xs,
            y=rounded(100 * line.curve.recall, 1),
            name=line.name,
            legendgroup=line.name,
            mode="lines",
            line={"color": shade, "width": 2, "dash": dash},
            hovertemplate=f"{line.name}, below %{{x}} %: %{{y}} %<extra></extra>",
        )
    figure.add_vline(x=10, line={"width": 1, "dash": "dot", "color": "#888"})
    figure.update_yaxes(range=[0, 103])
    figure.update_xaxes(range=[0, 50])
    figure.update_layout(legend={"orientation": "v", "x": 1.01, "y": 1, "xanchor": "left", "yanchor": "top"})
    figure.update_layout(margin={"r": 10})
    return figure


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
    figure.update_layout(barmode="stack", legend={"traceorder": "normal"})
    figure.update_yaxes(autorange="reversed", automargin=True, ticksuffix=" ")
    return figure


def time_figure(lines: Sequence[Line]) -> go.Figure:
    """Time a frame by stage."""
    times: Mapping[str, Mapping[str, float]] = {line.name: line.stages_ms for line in lines}
    figure = stage_bars(times)
    figure.update_layout(height=150 + ROW_PX * len(lines))
    figure.update_yaxes(ticksuffix=" ")
    return figure
