"""The page: everything that was found, put into the template."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import plotly.graph_objects as go
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup
from plotly.offline import get_plotlyjs

from verefine_viz.core.atomic import atomic
from verefine_viz.core.colormaps import difference_scale
from verefine_viz.core.palette import CLASS_COLORS, STAGE_COLORS
from verefine_viz.diagnosis.words import cause_title
from verefine_viz.report import charts, words
from verefine_viz.report.bop import BopRecalls
from verefine_viz.report.difference import Difference
from verefine_viz.report.gallery import Gallery
from verefine_viz.report.loaded import Loaded, data_set, relative_error
from verefine_viz.report.numbers import Numbers, ObjectNumbers, by_object, numbers_of, stage_times
from verefine_viz.report.pictures import color_of
from verefine_viz.session.files import session_toml

MOST_ROWS = 200
"""Of a table of frames or objects; more are in frames.csv."""


@dataclass(frozen=True, eq=False)
class Side:
    """One run with what was found about it."""

    run: Loaded
    bop: BopRecalls

    @property
    def numbers(self) -> Numbers:
        return numbers_of(self.run, self.bop.ar)

    @property
    def objects(self) -> tuple[ObjectNumbers, ...]:
        return by_object(self.run, self.bop.ar_by_object)


@dataclass(frozen=True)
class Tile:
    """One headline number."""

    label: str
    hint: str
    a: str
    b: str
    change: str
    is_better: bool | None
    """Whether B is better; None = the same, or nothing to compare with."""


def render(a: Side, b: Side | None, found: Difference | None, failures: Gallery) -> str:
    """The page as one HTML document that asks nobody for anything."""
    environment = Environment(
        loader=PackageLoader("verefine_viz.report"), autoescape=True, undefined=StrictUndefined, trim_blocks=True,
        lstrip_blocks=True,
    )  # fmt: skip
    environment.filters |= {
        "percent": words.percent,
        "number": words.number,
        "signed": words.signed,
        "cause": cause_title,
        "share": relative_error,
    }
    return environment.get_template("report.html").render(_context(a, b, found, failures))


def write(path: Path, html: str) -> None:
    """Writes the page, whole or not at all.

    Raises:
        InputError: it cannot be written.
    """
    with atomic(path) as part:
        part.write_text(html, encoding="utf-8")


def _context(a: Side, b: Side | None, found: Difference | None, failures: Gallery) -> dict[str, Any]:
    sides = [a, b] if b else [a]
    runs = [side.run for side in sides]
    has_truth = any(run.with_truth for run in runs)
    has_causes = any(row.cause for run in runs for row in run.failures)
    scale = difference_scale(a.run.index.session.score.tau_m)
    return {
        "title": a.run.index.session.title or "Run",
        "data_set": data_set(a.run),
        "sides": sides,
        "both": b is not None,
        "has_truth": has_truth,
        "headlines": [words.headline(side.run, side.numbers) for side in sides],
        "tiles": tiles(a.numbers, b.numbers if b else None),
        "notes": [note for side in sides if side.bop.total is None and (note := side.bop.note)],
        "bop_note": next((side.bop.note for side in sides if side.bop.total is not None), ""),
        "recall": _json(charts.recall_figure(runs)) if has_truth else None,
        "scores": [
            (run.name, words.score_sentence(run), _json(charts.score_figure(run))) for run in runs if run.with_truth
        ],
        "times": _json(charts.time_figure(runs)) if any(stage_times(run) for run in runs) else None,
        "not_explained": [run.name for run in runs if run.failures and not any(row.cause for row in run.failures)],
        "causes": _json(charts.cause_figure(runs)) if has_causes else None,
        "objects": [(mine, {o.obj_id: o for o in b.objects}.get(mine.obj_id) if b else None) for mine in a.objects],
        "found": found,
        "difference_sentence": words.difference_sentence(found) if found else "",
        "change": _json(charts.change_figure(found)) if found else None,
        "most_rows": MOST_ROWS,
        "failures": failures,
        "failures_sentence": words.failures_sentence(len(failures.failures), failures.n_more, has_truth),
        "cards": [
            (card, _json(charts.curve_figure(card.curve, card.row.worst_iteration)) if card.curve else None)
            for card in failures.failures
        ],
        "filter_causes": sorted({card.row.cause for card in failures.failures if card.row.cause}),
        "filter_objects": sorted({card.row.name for card in failures.failures if card.row.name}),
        "contours": _contours(bool(b)),
        "unknown_color": charts.css(CLASS_COLORS["unknown"]),
        "scale_gradient": scale.gradient(),
        "scale_ticks": scale.ticks,
        "settings": [(side.run.name, session_toml(side.run.index.session)) for side in sides],
        "plotly": Markup(get_plotlyjs()),
    }


def tiles(a: Numbers, b: Numbers | None) -> list[Tile]:
    """The headline numbers that are known."""
    shown = []
    for field, label, hint, scale, digits, unit, good in _HEADLINE:
        mine, theirs = getattr(a, field), getattr(b, field) if b else None
        if mine is None and theirs is None:
            continue
        by = None if mine is None or theirs is None else theirs - mine
        points = "points" if unit == "%" else unit
        shown.append(
            Tile(
                label,
                hint,
                words.number(_scaled(mine, scale), digits, "" if b else unit),
                words.number(_scaled(theirs, scale), digits, unit) if b else "",
                words.signed(_scaled(by, scale), digits, points) if by is not None else "",
                None if not by or not good else by * good > 0,
            )
        )
    return shown


_HEADLINE = (
    ("ar", "BOP AR", "average recall over VSD, MSSD and MSPD, as the BOP challenge computes it", 100, 1, "%", 1),
    ("recall", "below 10 % ∅", "share of objects whose ADD(-S) is below 10 % of the diameter", 100, 1, "%", 1),
    ("median_mm", "median ADD(-S)", "ADD, for symmetric objects ADD-S, of the objects with an answer", 1, 1, "mm", -1),
    ("mean_mm", "mean ADD(-S)", "of the objects with an answer", 1, 1, "mm", -1),
    ("median_score", "median score", "of the answers", 1, 2, "", 1),
    ("ms_per_frame", "method, a frame", "the method's computing time for a frame, all objects", 1, 0, "ms", -1),
    ("calls_per_object", "refiner calls", "for one object, mean", 1, 1, "", 0),
)
"""Field, label, hint, factor, digits, unit, and whether more is better (1), worse (-1) or neither."""


def _scaled(value: float | None, scale: float) -> float | None:
    return None if value is None else scale * value


def _contours(both: bool) -> list[tuple[str, str]]:
    named = [("answer of A", "A"), ("answer of B", "B")] if both else [("answer", "best")]
    return [(name, charts.css(color_of(kind))) for name, kind in named] + [
        ("ground truth", charts.css(STAGE_COLORS["ground truth"]))
    ]


def _json(figure: go.Figure) -> Markup:
    # In a script element only "</" could end it; no JSON needs a bare "<".
    return Markup((figure.to_json() or "{}").replace("<", "\\u003c"))
