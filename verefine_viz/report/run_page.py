"""The page of a run, or of two compared: their numbers, charts and sentences for the template."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from verefine_viz.report import charts
from verefine_viz.report import run_sentences as words
from verefine_viz.report.bop_recalls import BopRecalls
from verefine_viz.report.failure_cards import Gallery
from verefine_viz.report.groups import differing
from verefine_viz.report.html import figure_json, filled, gallery_context
from verefine_viz.report.run_difference import Difference
from verefine_viz.report.run_results import (
    LoadedRun,
    Numbers,
    ObjectNumbers,
    by_object,
    data_set,
    numbers_of,
    stage_times,
)
from verefine_viz.report.run_sentences import next_step
from verefine_viz.run.session_file import session_toml

MOST_ROWS = 200
"""Of a table of frames or objects; more are in frames.csv."""


@dataclass(frozen=True, eq=False)
class Side:
    """One run with its BOP scores."""

    run: LoadedRun
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


def render(a: Side, b: Side | None, difference: Difference | None, failures: Gallery) -> str:
    """The page as one HTML document that loads nothing from elsewhere."""
    return filled("report.html", _context(a, b, difference, failures))


def _context(a: Side, b: Side | None, difference: Difference | None, failures: Gallery) -> dict[str, Any]:
    sides = [a, b] if b else [a]
    runs = [side.run for side in sides]
    has_truth = any(run.with_truth for run in runs)
    grasped = [run for run in runs if any(row.grasp for row in run.objects)]
    has_causes = any(row.cause for run in runs for row in run.failures)
    return {
        "title": words.title(a.run, b.run if b else None),
        "next_step": None if b else next_step(a.run),
        "data_set": data_set(a.run) if b else "",
        "session_title": words.session_title(runs),
        "differing": differing([run.index.session for run in runs]) if b else {},
        "sides": sides,
        "both": b is not None,
        "has_truth": has_truth,
        "headlines": [words.headline(side.run, side.numbers) for side in sides],
        "tiles": tiles(a.numbers, b.numbers if b else None),
        "notes": list(dict.fromkeys(side.bop.note for side in sides if side.bop.ar is None and side.bop.note)),
        "doubts": words.data_doubts(runs),
        "bop_note": next((side.bop.note for side in sides if side.bop.ar is not None), ""),
        "recall": figure_json(charts.recall_figure(runs)) if has_truth else None,
        "scores": [
            (run.name, words.score_sentence(run), figure_json(charts.score_figure(run)))
            for run in runs
            if run.with_truth
        ],
        "motions": [(run.name, run.tracks, figure_json(charts.motion_figure(run))) for run in runs if run.tracks],
        "times": figure_json(charts.time_figure(runs)) if any(stage_times(run) for run in runs) else None,
        "not_explained": [run.name for run in runs if run.failures and not any(row.cause for row in run.failures)],
        "causes": figure_json(charts.cause_figure(runs)) if has_causes else None,
        "grasps": figure_json(charts.grasp_figure(grasped)) if grasped else None,
        "objects": [(mine, {o.obj_id: o for o in b.objects}.get(mine.obj_id) if b else None) for mine in a.objects],
        "difference": difference,
        "difference_sentence": words.difference_sentence(difference) if difference else "",
        "change": figure_json(charts.change_figure(difference)) if difference else None,
        "most_rows": MOST_ROWS,
        **gallery_context(failures, has_truth, a.run.index.session.score.tau_m, both=b is not None),
        **({"failures_sentence": words.pair_failures_sentence(failures, has_truth)} if b else {}),
        "settings": [(side.run.name, session_toml(side.run.index.session)) for side in sides],
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
                {"good": True, "bad": False}.get(words.tone(scale * good * (by or 0.0), digits)),
            )
        )
    return shown


_HEADLINE = (
    ("ar", "BOP AR", "average recall over VSD, MSSD and MSPD, as the BOP challenge computes it", 100, 1, "%", 1),
    ("recall", "below 10 % ∅", "share of objects whose ADD(-S) is below 10 % of the diameter", 100, 1, "%", 1),
    ("median_mm", "median ADD(-S)", "ADD, for symmetric objects ADD-S, of the objects with an answer", 1, 1, "mm", -1),
    ("mean_mm", "mean ADD(-S)", "of the objects with an answer", 1, 1, "mm", -1),
    ("median_score", "median score", "of the answers", 1, 2, "", 1),
    ("solving_ms", "solving, a frame", "first scores and all iterations of a frame, mean over frames with an answer: "
     "the column time of results.csv", 1, 0, "ms", -1),
    ("calls_per_object", "refiner calls", "for one object, mean", 1, 1, "", 0),
)  # fmt: skip
"""Field, label, hint, factor, digits, unit, and whether more is better (1), worse (-1) or neither."""


def _scaled(value: float | None, scale: float) -> float | None:
    return None if value is None else scale * value
