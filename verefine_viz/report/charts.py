"""The report's charts. Colours of text and grid come from the page, which has a light and a dark side."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import count
from typing import get_args

import numpy as np
import plotly.graph_objects as go

from verefine_viz.core.palette import ARM_COLORS, EVENT_COLORS, OBJECT_COLORS, RGB, SIDE_COLORS, STAGE_COLORS
from verefine_viz.diagnosis.causes import cause_title
from verefine_viz.grasping.grasp_trial import Verdict
from verefine_viz.report.failure_cards import ScoreCurve
from verefine_viz.report.run_difference import SAME, Difference
from verefine_viz.report.run_results import THRESHOLDS, LoadedRun, recall_curve, stage_times
from verefine_viz.run.record import Answer

MOST_POINTS = 4000
"""Of a scatter plot; of more, an even choice is drawn."""
MOST_TRACKS = 10
"""Objects of a sequence that are drawn, those that flip and jump most."""
SMALLEST_PERCENT = 0.05
"""Errors below this share of the diameter are drawn there: a logarithmic axis has no zero."""
RIGHT, WRONG = EVENT_COLORS["new_best"], EVENT_COLORS["score_fell"]
DOTTED = {"width": 1, "dash": "dot", "color": "#888"}
"""A line at a threshold."""
PERCENT_TICKS = (0.1, 0.3, 1, 3, 10, 30, 100)
PERCENT_AXIS = {"type": "log", "tickvals": PERCENT_TICKS, "ticktext": [f"{t:g}" for t in PERCENT_TICKS]}
STAGE_WORDS = {
    "read": ("read", "#8d99ae"),
    "prepare": ("prepare models (once)", "#d9c9b0"),
    "start": ("hypotheses", "#577590"),
    "refine": ("refine", "rgb(50,110,255)"),
    "simulate": ("simulate", "rgb(255,140,0)"),
    "score": ("score", "rgb(40,200,80)"),
    "rest of the iterations": ("rest of the iterations", "#b8c0cc"),
    "grasp": ("grasp", "#e9c46a"),
    "explain": ("look for causes", "#6d597a"),
    "summarise": ("summarise", "#c9ada7"),
    "record": ("record", "#9a8c98"),
}


def color(run: LoadedRun) -> str:
    """A run's colour in charts; darker than on the page, to be seen on paper."""
    if not run.label:
        return css(STAGE_COLORS["refined"])
    r, g, b = (round(0.7 * c) for c in SIDE_COLORS[run.label])
    return css((r, g, b))


def css(rgb: RGB) -> str:
    """As style sheets write it."""
    return f"rgb({rgb[0]},{rgb[1]},{rgb[2]})"


def recall_figure(runs: Sequence[LoadedRun]) -> go.Figure:
    """Recall over the threshold, all objects with ground truth."""
    figure = new_figure("error below … % of the diameter", "share of objects [%]")
    for run in runs:
        figure.add_scatter(
            x=rounded(100 * THRESHOLDS, 1),
            y=rounded(100 * recall_curve(run.with_truth), 1),
            name=run.name,
            mode="lines",
            line={"color": color(run), "width": 2.5, "dash": "dash" if run.label == "B" else "solid"},
            hovertemplate="below %{x} %: %{y} %<extra></extra>",
        )
    figure.add_vline(x=10, line=DOTTED)
    figure.update_yaxes(range=[0, 103])
    figure.update_xaxes(range=[0, 50])
    figure.update_layout(showlegend=len(runs) > 1)
    return figure


def score_figure(run: LoadedRun) -> go.Figure:
    """Score over error, a point per object: a score to be trusted falls from left to right."""
    figure = new_figure("error [% of the diameter]", "score")
    rows = _some([r for r in run.objects if r.score is not None and r.relative_error is not None])
    for is_right, name, symbol in ((True, "right", "circle"), (False, "wrong", "x")):
        mine = [r for r in rows if r.is_correct is is_right]
        figure.add_scatter(
            x=[_percent(r) for r in mine],
            y=[round(r.score or 0.0, 4) for r in mine],
            text=[f"{r.name} in {r.frame}" for r in mine],
            name=name,
            mode="markers",
            marker={"color": css(RIGHT if is_right else WRONG), "symbol": symbol, "size": 7, "opacity": 0.75},
            hovertemplate="%{text}<br>error %{x} %, score %{y}<extra></extra>",
        )
    figure.add_vline(x=10, line=DOTTED)
    figure.update_xaxes(PERCENT_AXIS)
    figure.update_yaxes(range=[0, 1.02])
    return figure


def motion_figure(run: LoadedRun) -> go.Figure:
    """How far each object moved since the frame before, with its flips and jumps."""
    figure = new_figure("frame", "moved since the frame before [mm]")
    tracks = sorted(run.tracks, key=lambda t: -(t.counts.flips + t.counts.jumps))[:MOST_TRACKS]
    for k, track in enumerate(tracks):
        rows = [row for row in track.rows if row.kind != "no pose"]
        name = f"{track.name}, scene {track.scene_id}" if len({t.scene_id for t in tracks}) > 1 else track.name
        figure.add_scatter(
            x=[row.im_id for row in rows],
            y=[round(row.moved_mm, 2) for row in rows],
            text=[f"{name} in {row.frame}: turned {row.turned_deg:.1f}°" for row in rows],
            name=name,
            mode="lines+markers",
            line={"color": css(OBJECT_COLORS[k % len(OBJECT_COLORS)]), "width": 1.5},
            marker={"size": 3},
            hovertemplate="%{text}, moved %{y} mm<extra></extra>",
        )
    for kind, shade, symbol in (("flip", css(EVENT_COLORS["flipped"]), "triangle-up"), ("jump", css(WRONG), "x")):
        rows = [row for track in tracks for row in track.rows if row.kind == kind]
        figure.add_scatter(
            x=[row.im_id for row in rows],
            y=[round(row.moved_mm, 2) for row in rows],
            text=[f"{row.name} in {row.frame}: turned {row.turned_deg:.0f}°" for row in rows],
            name=kind,
            mode="markers",
            marker={"color": shade, "symbol": symbol, "size": 10},
            hovertemplate="%{text}<extra></extra>",
        )
    figure.update_yaxes(rangemode="tozero")
    return figure


def time_figure(runs: Sequence[LoadedRun]) -> go.Figure:
    """Mean time a frame by stage."""
    times = {run.name: stage_times(run) for run in runs}
    figure, n_stages = stage_bars(times), len({stage for mine in times.values() for stage in mine})
    # The legend has two stages a line, and may not take more than half of it.
    figure.update_layout(height=max(190, 38 * -(-n_stages // 2)) + 50 * len(runs))
    figure.update_yaxes(showticklabels=len(runs) > 1)
    return figure


def stage_bars(times: Mapping[str, Mapping[str, float]]) -> go.Figure:
    """Milliseconds a frame by stage, a bar for each name."""
    figure = new_figure("ms a frame", "")
    for stage in dict.fromkeys(stage for mine in times.values() for stage in mine):
        name, shade = STAGE_WORDS.get(stage, (stage, "#cccccc"))
        figure.add_bar(
            y=list(times),
            x=rounded(np.array([mine.get(stage, 0.0) for mine in times.values()]), 1),
            name=name,
            orientation="h",
            marker={"color": shade},
            hovertemplate=f"{name}: %{{x}} ms<extra></extra>",
        )
    figure.update_layout(barmode="stack", legend={"traceorder": "normal"})
    figure.update_yaxes(autorange="reversed", automargin=True)
    return figure


def cause_figure(runs: Sequence[LoadedRun]) -> go.Figure:
    """How many failures each cause has."""
    figure = new_figure("failed objects", "")
    runs = [run for run in runs if cause_counts(run.failures)]
    counts = {run.name: cause_counts(run.failures) for run in runs}
    causes = sorted(
        {c for mine in counts.values() for c in mine}, key=lambda c: -sum(m.get(c, 0) for m in counts.values())
    )
    for run in runs:
        mine = counts[run.name]
        figure.add_bar(
            y=[cause_title(c) for c in causes],
            x=[mine.get(c, 0) for c in causes],
            name=run.name,
            orientation="h",
            marker={"color": color(run)},
            hovertemplate="%{y}: %{x}<extra></extra>",
        )
    figure.update_layout(barmode="group", height=110 + (26 + 14 * (len(runs) - 1)) * max(len(causes), 1))
    figure.update_layout(showlegend=len(runs) > 1)
    figure.update_yaxes(autorange="reversed", automargin=True)
    most = max((n for mine in counts.values() for n in mine.values()), default=0)
    figure.update_xaxes(rangemode="tozero", tickformat="d", tick0=0, dtick=whole_step(most))
    return figure


def grasp_figure(runs: Sequence[LoadedRun]) -> go.Figure:
    """How the grasps of each run's answers ended, beside those by the ground-truth poses."""
    figure = new_figure("objects", "")
    bars = [(f"{run.name}: answer" if len(runs) > 1 else "answer", color(run), run, "grasp") for run in runs]
    # White, as on the page, is not seen on paper.
    bars.append(("ground truth", "#8d99ae", runs[0], "grasp_ground_truth"))
    counts = [Counter(getattr(r, column) for r in run.objects if r.grasp) for _, _, run, column in bars]
    ends = [end for end in get_args(Verdict) if any(end in mine for mine in counts)]
    for (name, shade, _, _), mine in zip(bars, counts, strict=True):
        figure.add_bar(
            y=ends,
            x=[mine.get(end, 0) for end in ends],
            name=name,
            orientation="h",
            marker={"color": shade},
            hovertemplate=f"%{{y}}, {name}: %{{x}}<extra></extra>",
        )
    figure.update_layout(barmode="group", height=120 + (12 + 14 * len(bars)) * max(len(ends), 1))
    figure.update_yaxes(autorange="reversed", automargin=True)
    most = max((n for mine in counts for n in mine.values()), default=0)
    figure.update_xaxes(rangemode="tozero", tickformat="d", tick0=0, dtick=whole_step(most))
    return figure


def change_figure(difference: Difference) -> go.Figure:
    """Error of B over error of A, a point per object: below the line B is better."""
    figure = new_figure("error of A [% of the diameter]", "error of B [% of the diameter]")
    changes = _some([c for c in difference.changes if np.isfinite(c.error_a) and np.isfinite(c.error_b)])
    ends = [SMALLEST_PERCENT, 200]
    figure.add_scatter(
        x=ends, y=ends, mode="lines", line={"color": "#888", "width": 1}, hoverinfo="skip", showlegend=False
    )
    for name, shade, symbol, mine in (
        ("B better", css(RIGHT), "circle", [c for c in changes if c.by < -SAME]),
        ("the same", "#8d99ae", "circle-open", [c for c in changes if abs(c.by) <= SAME]),
        ("B worse", css(WRONG), "x", [c for c in changes if c.by > SAME]),
    ):
        figure.add_scatter(
            x=[_percent(c.a) for c in mine],
            y=[_percent(c.b) for c in mine],
            text=[f"{c.a.name} in {c.frame}" for c in mine],
            name=name,
            mode="markers",
            marker={"color": shade, "size": 7, "opacity": 0.75, "symbol": symbol},
            hovertemplate="%{text}<br>A %{x} %, B %{y} %<extra></extra>",
        )
    figure.add_vline(x=10, line=DOTTED)
    figure.add_hline(y=10, line=DOTTED)
    figure.update_xaxes(PERCENT_AXIS)
    figure.update_yaxes(PERCENT_AXIS)
    return figure


def curve_figure(curve: ScoreCurve, worst_iteration: int | None) -> go.Figure:
    """A failure's score over the iterations, with the error of the best pose."""
    figure = new_figure("iteration", "score", height=170)
    xs = list(curve.iterations)
    figure.add_scatter(
        x=xs,
        y=[None if s is None else round(s, 4) for s in curve.scores],
        text=[f"hypothesis {arm + 1}" for arm in curve.arms],
        name="accepted pose",
        mode="markers",
        marker={"color": [css(ARM_COLORS[arm % len(ARM_COLORS)]) for arm in curve.arms], "size": 6},
        hovertemplate="iteration %{x}, %{text}: score %{y}<extra></extra>",
    )
    figure.add_scatter(
        x=xs,
        y=rounded(np.array(curve.best_scores), 4),
        name="best so far",
        mode="lines",
        line={"color": css(STAGE_COLORS["best"]), "width": 2, "shape": "hv"},
        hovertemplate="best score %{y}<extra></extra>",
    )
    if any(e is not None for e in curve.best_errors_mm):
        figure.add_scatter(
            x=xs,
            y=[None if e is None else round(e, 2) for e in curve.best_errors_mm],
            name="error of the best [mm]",
            yaxis="y2",
            mode="lines",
            line={"color": css(WRONG), "width": 1.5, "dash": "dot", "shape": "hv"},
            hovertemplate="error %{y} mm<extra></extra>",
        )
        figure.update_layout(
            yaxis2={
                "overlaying": "y",
                "side": "right",
                "rangemode": "tozero",
                "tickmode": "auto",
                "nticks": 4,
                "title": {"text": "mm"},
                "showgrid": False,
            }
        )
    if worst_iteration:
        figure.add_vline(x=worst_iteration, line=DOTTED)
    figure.update_yaxes(range=[0, 1], selector={"anchor": "x"})
    figure.update_layout(yaxis={"range": [0, 1.02]}, margin={"l": 44, "r": 44, "t": 6, "b": 34}, showlegend=False)
    return figure


def cause_counts(rows: Sequence[Answer]) -> Counter[str]:
    """Failures by cause, those without a diagnosis left out."""
    return Counter(row.cause for row in rows if row.cause)


def whole_step(most: int) -> int:
    """The distance of ticks of whole numbers up to ``most``: 1, 2, 5, 10, … for at most six of them beyond 0."""
    return next(step for step in (s * 10**k for k in count() for s in (1, 2, 5)) if 6 * step >= most)


def new_figure(x: str, y: str, height: int = 340) -> go.Figure:
    """An empty chart with these titles of its axes."""
    axis = {"zeroline": False, "ticks": "outside", "ticklen": 4}
    return go.Figure(
        layout={
            # Without it every figure would carry 7 kB of a theme that the page replaces.
            "template": go.layout.Template(),
            "height": height,
            "margin": {"l": 56, "r": 16, "t": 10, "b": 46},
            "paper_bgcolor": "rgba(0,0,0,0)",
            "plot_bgcolor": "rgba(0,0,0,0)",
            "xaxis": {"title": {"text": x}, **axis},
            "yaxis": {"title": {"text": y}, **axis},
            "legend": {"orientation": "h", "y": 1.02, "yanchor": "bottom", "x": 0},
            "hovermode": "closest",
        }
    )


def _percent(row: Answer) -> float:
    return round(max(100 * (row.relative_error or 0.0), SMALLEST_PERCENT), 3)


def rounded(values: np.ndarray, digits: int) -> list[float]:
    """As few digits as a chart shows: the page stays small."""
    return np.round(values, digits).tolist()


def _some(points: list) -> list:
    """All points, or an even choice."""
    step = -(-len(points) // MOST_POINTS) or 1
    return points[::step]
