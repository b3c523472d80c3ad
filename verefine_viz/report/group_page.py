"""The page that compares groups of runs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from verefine_viz.batch.totals import doubts_in_words
from verefine_viz.report import group_charts
from verefine_viz.report import group_sentences as group_words
from verefine_viz.report import run_sentences as words
from verefine_viz.report.bootstrap import Spread
from verefine_viz.report.failure_cards import Gallery
from verefine_viz.report.group_comparison import Comparison, Line
from verefine_viz.report.groups import Groups, differing
from verefine_viz.report.html import figure_json, filled, gallery_context
from verefine_viz.report.object_results import MOST_HARD, Share, by_frame, hardest, heat
from verefine_viz.report.run_results import data_set
from verefine_viz.run.session_file import session_toml


@dataclass(frozen=True)
class Column:
    """One number of each group."""

    label: str
    hint: str
    get: Callable[[Line], Spread | None]
    factor: float
    digits: int
    more_is_better: bool | None

    def shown(self, line: Line) -> Cell:
        """The group's entry."""
        spread = self.get(line)
        if spread is None:
            return Cell("", words.DASH, "")
        value = words.number(self.factor * spread.value, self.digits)
        if spread.low is None or spread.high is None:
            return Cell(f"{spread.value}", value, "")
        ends = [words.number(self.factor * end, self.digits) for end in (spread.low, spread.high)]
        return Cell(f"{spread.value}", value, "" if set(ends) == {value} else " – ".join(ends))


@dataclass(frozen=True)
class Cell:
    """One entry of the table."""

    sort: str
    value: str
    interval: str
    is_best: bool = False


COLUMNS = (
    Column("right [%]", "recall: objects whose ADD(-S) is below 10 % of the diameter", lambda line: line.recall,
           100, 1, True),
    Column("BOP AR [%]", "average recall over VSD, MSSD and MSPD, as in the BOP challenge", lambda line: line.ar,
           100, 1, True),
    Column("median [mm]", "median ADD, for symmetric objects ADD-S, of the objects with an answer",
           lambda line: line.median_mm, 1, 1, False),
    Column("mean [mm]", "mean ADD(-S) of the objects with an answer", lambda line: line.mean_mm, 1, 1, False),
    Column("rotation [°]", "mean rotation error", lambda line: line.rotation_deg, 1, 1, False),
    Column("transl. [mm]", "mean translation error", lambda line: line.translation_mm, 1, 1, False),
    Column("lifted [%]", "share of answers by which a simulated grasp succeeds", lambda line: line.lifted,
           100, 0, True),
    Column("score", "mean score of the answers", lambda line: line.score, 1, 2, None),
    Column("iterations [ms]", "computing time of the iterations for all objects of a frame, without first scores; "
           "median",
           lambda line: line.ms_per_frame, 1, 0, False),
    Column("refiner calls", "for one object, mean", lambda line: line.calls, 1, 1, None),
)  # fmt: skip


def render_groups(groups: Groups, comparison: Comparison, failures: Gallery) -> str:
    """The page as one HTML document that loads nothing from elsewhere."""
    return filled("groups.html", _context(groups, comparison, failures))


def _context(groups: Groups, comparison: Comparison, failures: Gallery) -> dict[str, Any]:
    lines, runs = comparison.lines, groups.runs
    columns = [column for column in COLUMNS if any(column.get(line) for line in lines)]
    shades = group_charts.colors(lines)
    objects = by_frame(comparison.groups)
    hard = hardest(objects.values())
    has_truth = comparison.has_truth
    return {
        "title": group_words.title(comparison),
        "data_set": data_set(runs[0]) if len(lines) > 1 else "",
        "session_title": words.session_title(runs),
        "counted": group_words.counted(comparison),
        "headline": group_words.headline(comparison),
        "explanation": group_words.explanation(comparison),
        "has_truth": has_truth,
        "doubt": doubts_in_words([(run.folder.name, run.rows) for run in runs]),
        "bop_note": comparison.bop_note,
        "left_out": groups.left_out,
        "columns": columns,
        "table": [(line, shades[line.name], cells) for line, cells in zip(lines, _cells(columns, lines), strict=True)],
        "forest": figure_json(group_charts.forest_figure(lines)) if has_truth else None,
        "recall": figure_json(group_charts.recall_figure(lines)) if has_truth else None,
        "causes": figure_json(group_charts.cause_figure(lines)) if any(line.causes for line in lines) else None,
        "times": figure_json(group_charts.time_figure(lines)) if any(line.stages_ms for line in lines) else None,
        "panels": figure_json(group_charts.panel_figure(lines)) if group_charts.needs_panels(lines) else None,
        "names": [line.name for line in lines],
        "heat": heat(comparison.groups),
        "heat_color": heat_color,
        "hard": hard[:MOST_HARD],
        "n_hard": len(hard),
        "differing": differing([line.group.session for line in lines]),
        "settings": [(line.name, session_toml(line.group.session)) for line in lines],
        "run": runs[0].index.run,
        **gallery_context(
            failures,
            has_truth,
            runs[0].index.session.score.tau_m,
            by_object={place: mine.by_group for place, mine in objects.items()} if len(lines) > 1 else None,
        ),
        "failures_sentence": group_words.failures_sentence(comparison, failures),
        "both": False,
    }


def _cells(columns: list[Column], lines: tuple[Line, ...]) -> list[list[Cell]]:
    """The table row by row; the best of a column is marked where there are several groups."""
    table = [[column.shown(line) for column in columns] for line in lines]
    for k, column in enumerate(columns):
        known = [spread.value for line in lines if (spread := column.get(line)) is not None]
        if column.more_is_better is None or len(set(known)) < 2:
            continue
        best = max(known) if column.more_is_better else min(known)
        for row in table:
            if row[k].sort == f"{best}":
                row[k] = Cell(row[k].sort, row[k].value, row[k].interval, is_best=True)
    return table


def heat_color(share: Share) -> str:
    """Background of a recall: red for none, green for all; see-through, to suit any theme."""
    if share.value is None:
        return "transparent"
    return f"hsl({round(120 * share.value)} 65% 45% / 0.38)"
