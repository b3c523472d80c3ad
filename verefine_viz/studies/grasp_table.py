"""What a study of grasps comes to: Table IV beside the paper's, whether its order holds, and success over the error of
the pose.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.stats import binomtest

from verefine_viz.core.arrays import Float
from verefine_viz.core.console import PrintedTable, print_table
from verefine_viz.core.text_format import say
from verefine_viz.studies.claims import PanelLine
from verefine_viz.studies.figure import Diagram, draw_curves, draw_tables, save
from verefine_viz.studies.grasping_study import TABLE
from verefine_viz.studies.printed_table import latex, markdown
from verefine_viz.studies.solve_unit import UnitAnswer
from verefine_viz.studies.study_plan import Claim, Panel, Study
from verefine_viz.studies.study_report import About, names_of, write_rows, write_text

RESAMPLES = 2000
"""Draws of the bootstrap."""
ALL = "all"
"""Name of all objects together."""
NONE_FREE = ("no collision-free grasp", "no answer")


@dataclass(frozen=True)
class GraspOrder:
    """Two rows of the table, compared trial by trial."""

    claim: Claim
    n: int
    """Trials that both rows have: the same object, scene and initial poses."""
    better_alone: int
    """Trials in which the row that lifts more in the paper succeeds and the other does not."""
    worse_alone: int
    low: float
    high: float
    """95 % interval of the difference of the shares of success (bootstrap over the trials)."""
    p: float
    """Exact McNemar test, two-sided: how likely trials that differ part so unevenly by chance."""

    @property
    def difference(self) -> float:
        return (self.better_alone - self.worse_alone) / self.n

    @property
    def word(self) -> str:
        """Verdict: as in the paper, the reverse of the paper, or too close to tell."""
        if self.p >= 0.05:
            return "too close to tell"
        return "as in the paper" if self.difference > 0 else "the reverse of the paper"

    def __str__(self) -> str:
        return (
            f"{self.claim.better} over {self.claim.worse}: {100 * self.difference:+.0f} % "
            f"({100 * self.low:+.0f} to {100 * self.high:+.0f}), {self.better_alone} trials won and "
            f"{self.worse_alone} lost, p = {self.p:.2g}: {self.word}"
        )


def grasp_order(panel: Panel, outcomes: Sequence[UnitAnswer]) -> list[GraspOrder]:
    """The paper's order of the table's rows, tested on pairs of the same trial."""
    by_curve: dict[str, dict[tuple[str, str, int | None, int | None], bool]] = {}
    for o in outcomes:
        if o.panel == panel.name:
            by_curve.setdefault(o.curve, {})[o.scene, o.answer.frame, o.answer.instance_id, o.answer.seed] = (
                o.grasp == "success"
            )
    tested: list[GraspOrder] = []
    for claim in panel.claims:
        better, worse = by_curve.get(claim.better, {}), by_curve.get(claim.worse, {})
        gains = np.array([float(better[trial]) - float(worse[trial]) for trial in better if trial in worse])
        if gains.size:
            up, down = int((gains > 0).sum()), int((gains < 0).sum())
            p = float(binomtest(up, up + down).pvalue) if up + down else 1.0
            tested.append(GraspOrder(claim, gains.size, up, down, *band(gains), p))
    return tested


def band(values: Float) -> tuple[float, float]:
    """95 % interval of the mean of N trials (N,), the same at each call."""
    drawn = np.random.default_rng(0).integers(values.size, size=(RESAMPLES, values.size))
    low, high = np.percentile(values[drawn].mean(axis=1), [2.5, 97.5])
    return float(low), float(high)


def grasp_rows(study: Study, outcomes: Sequence[UnitAnswer]) -> list[dict[str, str | float]]:
    """A row per panel, curve, x and object, and one of all objects."""
    rows: list[dict[str, str | float]] = []
    for panel in study.panels:
        for curve in panel.curves:
            for x in panel.xs:
                mine = [o for o in outcomes if (o.panel, o.curve, o.x) == (panel.name, curve.label, x)]
                for name in (*sorted({o.answer.name for o in mine}), ALL):
                    some = [o for o in mine if name in (o.answer.name, ALL)]
                    if some:
                        rows.append(_row(panel.name, curve.label, x, name, some))
    return rows


def _row(panel: str, curve: str, x: float, name: str, some: Sequence[UnitAnswer]) -> dict[str, str | float]:
    success = np.array([float(o.grasp == "success") for o in some])
    low, high = band(success)
    return {
        "panel": panel,
        "curve": curve,
        "x": x,
        "object": name,
        "n": len(some),
        "successes": int(success.sum()),
        "success": float(success.mean()),
        "success_low": low,
        "success_high": high,
        "found": float(np.mean([o.grasp not in NONE_FREE for o in some])),
        "collided": float(np.mean([o.grasp.startswith("collided") for o in some])),
        "no_contact": float(np.mean([o.grasp == "no contact" for o in some])),
        "slipped": float(np.mean([o.grasp == "slipped" for o in some])),
        "refiner_calls_per_object": float(np.mean([o.refiner_calls for o in some])),
    }


def report_grasps(study: Study, outcomes: Sequence[UnitAnswer], out: Path, about: About) -> None:
    """Writes numbers, the table, the curves and what differs from the paper into a folder, and prints the table.

    Raises:
        InputError: they cannot be written.
    """
    rows = grasp_rows(study, outcomes)
    write_rows(out / "grasping.csv", rows)
    orders = [order for panel in study.panels for order in grasp_order(panel, outcomes)]
    write_rows(out / "grasping_order.csv", [_order_row(order) for order in orders])
    table = _printed(study, rows)
    tables = save(draw_tables([table], about.mark), out, "grasping_table")
    write_text(out / "grasping.tex", ["% needs \\usepackage{booktabs}", latex(table)])
    diagrams = _diagrams(study, rows)
    curves = save(draw_curves(diagrams, about.mark), out, "grasping") if diagrams else ()
    text = [f"# {study.title}", "", f"{about.data}.", "", *([f"{about.mark}.", ""] if about.mark else [])]
    text += [markdown(table), "", *(f"- {order}" for order in orders), ""]
    text += [f"![{study.title}](grasping.png)", ""] if diagrams else []
    text += [*PAPER_TABLE, "", *_differences(sorted({o.answer.name for o in outcomes}))]
    write_text(out / "grasping.md", text)
    print_table(table)
    for order in orders:
        say(order)
    say(f"Table: {names_of(tables)}, grasping.tex, grasping.md")
    say(f"Curves: {names_of(curves) or 'none yet'}; numbers: grasping.csv")


def _order_row(o: GraspOrder) -> dict[str, object]:
    pair = {"more": o.claim.better, "less": o.claim.worse, "trials": o.n}
    alone = {"more_alone": o.better_alone, "less_alone": o.worse_alone}
    return {**pair, **alone, "difference": o.difference, "low": o.low, "high": o.high, "p": o.p}


def _printed(study: Study, rows: Sequence[dict[str, str | float]]) -> PrintedTable:
    mine = [r for r in rows if r["panel"] == TABLE]
    names = list(dict.fromkeys(str(r["object"]) for r in mine if r["object"] != ALL))
    cells: list[tuple[str, ...]] = []
    for curve in dict.fromkeys(str(r["curve"]) for r in mine):
        by_name = {str(r["object"]): r for r in mine if r["curve"] == curve}
        total = by_name[ALL]
        low, high = 100 * float(total["success_low"]), 100 * float(total["success_high"])
        cells.append(
            (
                curve,
                *(f"{by_name[n]['successes']}/{by_name[n]['n']}" if n in by_name else "" for n in names),
                f"{100 * float(total['success']):.0f} ({low:.0f}-{high:.0f})",
                f"{100 * float(total['found']):.0f}",
                f"{float(total['refiner_calls_per_object']):.0f}",
            )
        )
    headings = ("", *names, "success %", "found %", "#ref")
    note = "Successes per object; all: % with its 95 % interval over the trials; #ref: refiner calls per object."
    return PrintedTable(study.title, headings, tuple(cells), note=note)


def _diagrams(study: Study, rows: Sequence[dict[str, str | float]]) -> list[Diagram]:
    """Success over the error, a line per object, and one of all with its interval."""
    diagrams: list[Diagram] = []
    for panel in study.panels:
        mine = [r for r in rows if r["panel"] == panel.name]
        lines: list[PanelLine] = []
        for name in dict.fromkeys(str(r["object"]) for r in mine):
            ends = ("success_low", "success_high") if name == ALL else ("success", "success")
            of_name = [r for r in mine if r["object"] == name]
            lines.append(PanelLine(name, *(np.array([float(r[c]) for r in of_name]) for c in ("x", "success", *ends))))
        if panel.name != TABLE:
            diagrams.append(Diagram(panel.name, panel.x_label, "success [%]", lines, ALL))
    return diagrams


PAPER_TABLE = (
    "## The paper's Table IV (Toyota HSR, DenseFusion)",
    "",
    "| | mustard | spam | foam | jello | banana | success % | found % | #ref |",
    "|---|---:|---:|---:|---:|---:|---:|---:|---:|",
    "| DF-R | 10 | 3 | 1 | 7 | 0 | 42 | 46 | 2 |",
    "| SIR | 9 | 7 | 2 | 7 | 0 | 50 | 70 | 2 |",
    "| DF-R | 10 | 6 | 5 | 9 | 1 | 62 | 70 | 10 |",
    "| PHYSIM-MCTS | 9 | 10 | 2 | 6 | 0 | 54 | 78 | 10 |",
    "| RIR | 10 | 10 | 9 | 10 | 4 | 86 | 90 | 10 |",
)
"""The paper's Table IV, of ten grasps each. Never beside our rows: a robot is other data than a simulated gripper."""


DIFFERENCES = (
    (
        "trials",
        "10 per object: 5 as placed, 5 turned to a symmetric pose",
        "a seed of the initial poses each, half of them with turned objects where the scene is rendered",
    ),
    ("image", "the robot's camera, masks of Mask R-CNN", "rendered or recorded, true masks"),
    ("arm", "Toyota HSR, trajectories of MoveIt", "none: the gripper moves freely"),
    ("grasps", "annotated by hand", "annotated by hand (`grasp.folder`), else sampled on the mesh"),
    (
        "approach",
        "a planned trajectory to a grasp that is free in the octomap",
        "straight along the grasp, its last 10 cm",
    ),
    (
        "found",
        "at least one collision-free grasp has a plan",
        "at least one straight approach meets no voxel of the observed depth and not the plane",
    ),
    (
        "success",
        "the plan is executed, the object is grasped and stays stable in the gripper",
        "simulated: lifted, shaken and held, pressed by both pads, still, risen by half of the lift at least",
    ),
)
"""The paper's experiment beside this one (Sec. V-D)."""


def _differences(names: Sequence[str]) -> list[str]:
    rows = (
        ("objects", "mustard, spam, foam, jello, banana (YCB-V, GRASPA layout)", ", ".join(names)),
        *DIFFERENCES,
    )
    return ["## What differs", "", "| | paper | here |", "|---|---|---|", *(f"| {' | '.join(row)} |" for row in rows)]
