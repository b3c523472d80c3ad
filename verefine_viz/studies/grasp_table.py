"""What a study of grasps comes to: Table IV beside the paper's, whether its order holds, and success over the error of
the pose.
"""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from rich.markup import escape
from rich.table import Table
from scipy.stats import binomtest

from verefine_viz.batch.terminal import Terminal
from verefine_viz.core.writing import atomic
from verefine_viz.studies.figure import COLORS, DPI, MARKERS, band, save
from verefine_viz.studies.grasping_study import PAPER, TABLE
from verefine_viz.studies.solve_unit import Outcome
from verefine_viz.studies.study_plan import Claim, Panel, Study

FILE_COLUMNS = 200
"""Width of the printed table where it goes to a file."""
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
        """As in the paper, the reverse of the paper, or too close to tell."""
        if self.p >= 0.05:
            return "too close to tell"
        return "as in the paper" if self.difference > 0 else "the reverse of the paper"

    def __str__(self) -> str:
        return (
            f"{self.claim.better} over {self.claim.worse}: {100 * self.difference:+.0f} % "
            f"({100 * self.low:+.0f} to {100 * self.high:+.0f}), {self.better_alone} trials against "
            f"{self.worse_alone}, p = {self.p:.2g}: {self.word}"
        )


def grasp_order(panel: Panel, outcomes: Sequence[Outcome]) -> list[GraspOrder]:
    """The paper's order of the table's rows, tested on pairs of the same trial."""
    by_curve: dict[str, dict[tuple[str, str, int, int], bool]] = {}
    for o in outcomes:
        if o.panel == panel.name:
            by_curve.setdefault(o.curve, {})[o.scene, o.frame, o.instance_id, o.seed] = o.grasp == "success"
    tested: list[GraspOrder] = []
    for claim in panel.claims:
        better, worse = by_curve.get(claim.better, {}), by_curve.get(claim.worse, {})
        gains = np.array([float(better[trial]) - float(worse[trial]) for trial in better if trial in worse])
        if gains.size:
            up, down = int((gains > 0).sum()), int((gains < 0).sum())
            p = float(binomtest(up, up + down).pvalue) if up + down else 1.0
            tested.append(GraspOrder(claim, gains.size, up, down, *band(gains), p))
    return tested


def grasp_rows(study: Study, outcomes: Sequence[Outcome]) -> list[dict[str, str | float]]:
    """A row per panel, curve, x and object, and one of all objects ("all")."""
    rows: list[dict[str, str | float]] = []
    for panel in study.panels:
        for curve in panel.curves:
            for x in panel.xs:
                mine = [o for o in outcomes if (o.panel, o.curve, o.x) == (panel.name, curve.label, x)]
                for name in (*sorted({o.name for o in mine}), "all"):
                    some = [o for o in mine if name in (o.name, "all")]
                    if some:
                        rows.append(_row(panel.name, curve.label, x, name, some))
    return rows


def _row(panel: str, curve: str, x: float, name: str, some: Sequence[Outcome]) -> dict[str, str | float]:
    success = np.array([float(o.grasp == "success") for o in some])
    low, high = band(success)
    paper = next((values for end, values in PAPER.items() if name == "all" and curve.endswith(end)), ("", ""))
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
        "paper_success_percent": paper[0],
        "paper_found_percent": paper[1],
    }


def report_grasps(study: Study, outcomes: Sequence[Outcome], out: Path, about: str) -> None:
    """Writes ``grasping.csv``, ``grasping_order.csv`` and the figure, and prints the table.

    Raises:
        InputError: they cannot be written.
    """
    rows = grasp_rows(study, outcomes)
    with atomic(out / "grasping.csv") as part, part.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, fieldnames=list(rows[0]) if rows else [])
        writer.writeheader()
        writer.writerows([{k: f"{v:.6g}" if isinstance(v, float) else v for k, v in r.items()} for r in rows])
    orders = [order for panel in study.panels for order in grasp_order(panel, outcomes)]
    with atomic(out / "grasping_order.csv") as part, part.open("w", newline="", encoding="utf-8") as file:
        sheet = csv.writer(file)
        sheet.writerow(["more", "less", "trials", "more_alone", "less_alone", "difference", "low", "high", "p"])
        for o in orders:
            numbers = (f"{v:.6g}" for v in (o.difference, o.low, o.high, o.p))
            sheet.writerow([o.claim.better, o.claim.worse, o.n, o.better_alone, o.worse_alone, *numbers])
    png, svg = save(draw_grasps(study, rows, about), out, "grasping")
    console = Terminal(highlight=False, soft_wrap=True)
    if not console.is_terminal:
        console = Terminal(highlight=False, soft_wrap=True, width=FILE_COLUMNS)
    console.print(_printed(study, rows))
    for order in orders:
        console.print(escape(str(order)))
    console.print(escape(f"Figures: {png}, {svg.name}; numbers: grasping.csv beside them"))


def _printed(study: Study, rows: Sequence[dict[str, str | float]]) -> Table:
    table = Table(title=study.title)
    mine = [r for r in rows if r["panel"] == TABLE]
    names = list(dict.fromkeys(str(r["object"]) for r in mine if r["object"] != "all"))
    for heading in ("", *names, "success % (95 %)", "paper", "found %", "paper", "calls/object"):
        table.add_column(heading, justify="right" if heading else "left", no_wrap=True)
    for curve in dict.fromkeys(str(r["curve"]) for r in mine):
        by_name = {str(r["object"]): r for r in mine if r["curve"] == curve}
        total = by_name["all"]
        low, high = 100 * float(total["success_low"]), 100 * float(total["success_high"])
        table.add_row(
            curve,
            *(f"{by_name[n]['successes']}/{by_name[n]['n']}" if n in by_name else "" for n in names),
            f"{100 * float(total['success']):.0f} ({low:.0f}-{high:.0f})",
            str(total["paper_success_percent"]),
            f"{100 * float(total['found']):.0f}",
            str(total["paper_found_percent"]),
            f"{float(total['refiner_calls_per_object']):.0f}",
        )
    return table


def draw_grasps(study: Study, rows: Sequence[dict[str, str | float]], about: str) -> Figure:
    """Bars of success and found per method, and success over the error per object."""
    figure = Figure(figsize=(17, 5.6), dpi=DPI)
    figure.suptitle(f"{study.title}\n{about}", fontsize=12)
    for k, panel in enumerate(study.panels, start=1):
        axes = figure.add_subplot(1, len(study.panels), k)
        mine = [r for r in rows if r["panel"] == panel.name]
        if panel.name == TABLE:
            total = [r for r in mine if r["object"] == "all"]
            ys, values = np.arange(len(total)), np.array([100 * float(r["success"]) for r in total])
            spread = np.array([[100 * float(r[end]) for r in total] for end in ("success_low", "success_high")])
            free = [100 * float(r["found"]) for r in total]
            axes.barh(ys, free, color="#d0d0d0", label="found")
            axes.barh(ys, values, xerr=np.abs(spread - values), color=COLORS[2], height=0.5, capsize=2, label="success")
            paper = [float(r["paper_success_percent"] or "nan") for r in total]
            axes.plot(paper, ys, "k|", ms=16, label="success in the paper")
            axes.set_yticks(ys, [str(r["curve"]) for r in total])
            axes.invert_yaxis()
            axes.set_xlabel("trials [%]")
            axes.legend(fontsize=8, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3, frameon=False)
        else:
            for c, name in enumerate(dict.fromkeys(str(r["object"]) for r in mine)):
                line = [r for r in mine if r["object"] == name]
                xs, ys = [float(r["x"]) for r in line], [100 * float(r["success"]) for r in line]
                color = "k" if name == "all" else COLORS[c % len(COLORS)]
                axes.plot(
                    xs, ys, color=color, marker=MARKERS[c % len(MARKERS)], lw=2.5 if name == "all" else 1, label=name
                )
            axes.set_xlabel(panel.x_label)
            axes.set_ylabel("success [%]")
            axes.set_ylim(-3, 103)
            axes.legend(fontsize=8)
        axes.grid(alpha=0.3)
    figure.tight_layout()
    return figure
