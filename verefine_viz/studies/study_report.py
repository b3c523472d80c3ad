"""The results of a study of curves or tables: numbers (CSV), figures, tables, and the paper's claims."""

from __future__ import annotations

import csv
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from verefine_viz.core.console import PrintedTable, print_table
from verefine_viz.core.settings import Session
from verefine_viz.core.text_format import say
from verefine_viz.core.writing import atomic
from verefine_viz.studies.claims import ClaimVerdict, Points, lines, missing_curves, points_of, rows, verdicts
from verefine_viz.studies.figure import Diagram, draw_curves, draw_tables, save
from verefine_viz.studies.paper_tables import MCTS, PAPER, PaperTable, missing_rows, paper_table
from verefine_viz.studies.printed_table import latex, markdown
from verefine_viz.studies.solve_unit import UnitAnswer
from verefine_viz.studies.study_plan import Panel, Study

METRICS = {"VSD": "ar_vsd", "MSPD": "ar_mspd", "MSSD": "ar_mssd", "AR": "ar"}
"""In the paper's order; larger is better."""
ERRORS = {"r̄ [°]": "rotation_deg", "t̄ [cm]": "translation_cm"}
"""Errors of Table II; smaller is better."""
TABLE_NOTE = (
    "Average recalls in %; T and refiner iterations (#ref) per object. Paper: its AR, where budget and data are "
    "the same."
)
ERROR_NOTE = (
    f"r̄, t̄: mean error of the answers. Roll-outs of {MCTS} are not in its budget, as in the paper; those of {MCTS}, 50 "
    "are."
)


@dataclass(frozen=True)
class About:
    """The data that a study was run on."""

    data: str
    """Frames, objects and seeds in a few words."""
    mark: str
    """Why this is not the whole study: a quick one, or a part; "" where it is."""


def report_curves(study: Study, outcomes: Sequence[UnitAnswer], out: Path, about: About) -> None:
    """Writes numbers, figure and claims of a study of curves into a folder, and prints the claims.

    Raises:
        InputError: they cannot be written.
    """
    points = points_of(outcomes)
    write_rows(out / f"{study.name}.csv", list(rows(study, points)))
    diagrams = [Diagram(p.name, p.x_label, "average recall AR [%]", lines(p, points)) for p in study.panels]
    files = save(draw_curves(diagrams, about.mark), out, study.name)
    text = [f"# {study.title}", "", *_head(about, study.panels[0].budget), f"![{study.title}]({study.name}.png)", ""]
    text += ["Bands and brackets are 95 % intervals over frames and objects.", "", *_claims(study, points)]
    write_text(out / f"{study.name}.md", text)
    _print_claims(study, points)
    say(f"Figure: {names_of(files)}; numbers: {study.name}.csv; claims: {study.name}.md")


def report_tables(
    study: Study, outcomes: Sequence[UnitAnswer], sessions: Collection[Session], out: Path, about: About
) -> None:
    """Writes the tables as CSV, Markdown, LaTeX and figure into a folder, and prints them.

    Raises:
        InputError: they cannot be written.
    """
    points = points_of(outcomes)
    numbers = list(rows(study, points))
    write_rows(out / "tables.csv", numbers)
    missing = missing_curves(outcomes)
    n_frames = len({(o.scene, o.answer.frame) for o in outcomes})
    tables = [printed(panel, numbers, paper_table(panel.name, sessions, n_frames)) for panel in study.panels]
    files = save(draw_tables(tables, about.mark), out, "tables")
    write_text(out / "tables.tex", ["% needs \\usepackage{booktabs}", f"% {TABLE_NOTE}", *map(latex, tables)])
    reasons = _reasons(study, missing)
    others = [f"- {sentence}" for sentence in missing_rows(sessions, n_frames)]
    text = [f"# {study.title}", "", *_head(about, ""), TABLE_NOTE, "", *(f"{markdown(t)}\n" for t in tables)]
    text += [*_listed("Rows without numbers", reasons), "## The paper's claims on these data", ""]
    text += [*_claims(study, points), *_listed("Tables of the paper that these data do not make", others)]
    text += [f"{markdown(printed_paper_table(table))}\n" for table in PAPER]
    write_text(out / "tables.md", text)
    for table in tables:
        print_table(table)
    say(TABLE_NOTE)
    _print_claims(study, points)
    for line in (*reasons, *others):
        say(line)
    say(f"Tables: {names_of(files)}, tables.tex, tables.md; numbers: tables.csv")


def printed(panel: Panel, numbers: Iterable[Mapping[str, str | float]], paper: PaperTable | None) -> PrintedTable:
    """The panel's table.

    Args:
        panel: a refiner.
        numbers: rows of the study.
        paper: the paper's table on the same data; None: it has other data.
    """
    is_search = any(curve.most_calls for curve in panel.curves)
    columns = METRICS | (ERRORS if is_search else {})
    by_curve = {str(r["curve"]): r for r in numbers if r["panel"] == panel.name}
    labels = [curve.label for curve in panel.curves]
    cells = [
        (
            label,
            *(_number(by_curve.get(label), name) for name in columns.values()),
            _number(by_curve.get(label), "s_per_object" if is_search else "ms_per_object"),
            _number(by_curve.get(label), "refiner_calls_per_object"),
            _papers(panel, label, by_curve.get(label), paper),
        )
        for label in labels
    ]
    best: dict[tuple[int, int], str] = {}
    for k, name in enumerate(columns.values(), start=1):
        values = {r: float(row[k]) for r, row in enumerate(cells) if row[0] in by_curve}
        if len(values) > 1:
            first = (max if name in METRICS.values() else min)(values.values())
            best |= {(r, k): "bold" for r, value in values.items() if value == first}
    in_paper = " and ".join(f"Table {table.number}" for table in PAPER if table.panel == panel.name)
    return PrintedTable(
        f"{panel.name}, as in {in_paper}" if in_paper else panel.name,
        ("", *columns, "T [s]" if is_search else "T [ms]", "#ref", "paper"),
        tuple(cells),
        best,
        # Above each run of the refiner alone.
        tuple(r for r, label in enumerate(labels) if r and label.startswith(f"{panel.name},")),
        f"{panel.budget}. {ERROR_NOTE}" if is_search else f"{panel.budget}.",
    )


def _number(row: Mapping[str, str | float] | None, name: str) -> str:
    if row is None:
        return "–"
    if name == "s_per_object":
        return f"{float(row['ms_per_object']) / 1000:.1f}"
    if name in METRICS.values():
        return f"{100 * float(row[name]):.1f}"
    return f"{float(row[name]):.{1 if name in ERRORS.values() else 0}f}"


def _papers(panel: Panel, label: str, row: Mapping[str, str | float] | None, paper: PaperTable | None) -> str:
    """The paper's AR, or why there is none; "" where the paper has no such row. The reason for an empty row is given
    below the table.
    """
    if row is None:
        return "see below"
    if not any(r.label == label for table in PAPER if table.panel == panel.name for r in table.rows):
        return ""
    if paper is None:
        return "other data"
    of_label = next((r for r in paper.rows if r.label == label), None)
    if of_label is None:
        return ""
    # A pool of fewer hypotheses has a smaller budget; the paper does not count roll-outs.
    is_same = label == MCTS or abs(float(row["refiner_calls_per_object"]) - of_label.n_refined) < 0.5
    return f"{of_label.ar:.1f}" if is_same else "other budget"


def printed_paper_table(table: PaperTable) -> PrintedTable:
    """A table in the paper's form."""
    has_errors = any(r.rotation_deg is not None for r in table.rows)
    cells = [
        (r.label, *(f"{v:.1f}" for v in (r.vsd, r.mspd, r.mssd, r.ar)))
        + ((f"{r.rotation_deg:.1f}", f"{r.translation_cm:.1f}") if has_errors else ())
        + (f"{r.time:g}", str(r.n_refined))
        for r in table.rows
    ]
    headings = ("", *METRICS, *(ERRORS if has_errors else ()), "T [s]" if has_errors else "T [ms]", "#ref")
    return PrintedTable(f"In the paper: Table {table.number}, {table.panel}, {table.data}", headings, tuple(cells))


def _reasons(study: Study, missing: Mapping[tuple[str, str], str]) -> list[str]:
    """Why rows have no numbers, each reason once with the refiner."""
    why: dict[str, list[str]] = {}
    for panel in study.panels:
        for curve in panel.curves:
            if (panel.name, curve.label) in missing:
                why.setdefault(f"{panel.name}: {missing[panel.name, curve.label]}", []).append(curve.label)
    return [f"- {reason} ({', '.join(labels)})" for reason, labels in why.items()]


def _listed(title: str, items: Sequence[str]) -> list[str]:
    return [f"## {title}", "", *items, ""] if items else []


def _head(about: About, budget: str) -> list[str]:
    return [line for text in (about.data, budget, about.mark) if text for line in (f"{text}.", "")]


def _claims(study: Study, points: Points) -> list[str]:
    """A table of the claims of each panel, with the findings."""
    text: list[str] = []
    for panel in study.panels:
        tested = verdicts(panel, points)
        if tested:
            text += [
                f"**{panel.name}**",
                "",
                "| the paper's claim | here | points of AR | objects |",
                "|---|---|---:|---:|",
            ]
            text += [f"| {_claimed(v)} | {v.word} | {v.numbers} | {v.n_objects} |" for v in tested]
            text.append("")
    return text


def _claimed(verdict: ClaimVerdict) -> str:
    return f"{verdict.about} ({verdict.claim.reading})" if verdict.claim.reading else verdict.about


def _print_claims(study: Study, points: Points) -> None:
    for panel in study.panels:
        tested = verdicts(panel, points)
        if tested:
            say(f"{panel.name}: the paper's claims here")
        for verdict in tested:
            say(f"  {verdict}")


def names_of(files: Sequence[Path]) -> str:
    """Names of files: the first with its folder, the others without."""
    return ", ".join([*map(str, files[:1]), *(file.name for file in files[1:])])


def write_rows(path: Path, table: Sequence[Mapping[str, object]]) -> None:
    """A CSV file, numbers with six digits.

    Raises:
        InputError: it cannot be written.
    """
    with atomic(path) as part, part.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, fieldnames=list(table[0]) if table else [])
        writer.writeheader()
        writer.writerows([{k: f"{v:.6g}" if isinstance(v, float) else v for k, v in row.items()} for row in table])


def write_text(path: Path, text: Sequence[str]) -> None:
    """The lines, in UTF-8.

    Raises:
        InputError: they cannot be written.
    """
    with atomic(path) as part:
        part.write_text("\n".join(text).rstrip() + "\n", encoding="utf-8")
