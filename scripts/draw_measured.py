"""The figures and tables of docs/measured.md, from the numbers in docs/measured/*.csv (make measured)."""

from __future__ import annotations

import csv
import re
from collections.abc import Callable, Sequence
from hashlib import sha256
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

ROOT = Path(__file__).resolve().parents[1]
FOLDER = ROOT / "docs" / "measured"
PAGE = ROOT / "docs" / "measured.md"
TABLE = re.compile(r"(<!-- table (\w+) -->\n).*?(<!-- end -->)", re.DOTALL)
"""Where the page has a table of a CSV file."""
GREY, ORANGE, SKY, BLUE, RED, GREEN = "#8a8a8a", "#e69f00", "#56b4e9", "#0072b2", "#d55e00", "#009e73"
"""After Okabe and Ito, safe for colour-blind readers."""
STYLE: dict[Any, Any] = {
    "font.size": 8.5, "axes.spines.top": False, "axes.spines.right": False, "axes.linewidth": 0.6,
    "axes.grid": True, "axes.axisbelow": True, "grid.linewidth": 0.4, "grid.alpha": 0.5, "svg.hashsalt": "verefine",
    "svg.fonttype": "none",
    "xtick.major.width": 0.6, "ytick.major.width": 0.6, "lines.markersize": 5.5, "lines.linewidth": 1.6,
}  # fmt: skip
WIDTH_IN = 7.0
Row = dict[str, str]


def rows_of(name: str) -> list[Row]:
    """Return the rows of a CSV file by column."""
    with (FOLDER / f"{name}.csv").open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def filled(page: str) -> str:
    """Return the page with its tables as the CSV files have them."""
    return TABLE.sub(lambda m: f"{m[1]}\n{markdown(rows_of(m[2]))}\n{m[3]}", page)


def markdown(rows: Sequence[Row]) -> str:
    """Return rows as a Markdown table."""
    heads = [
        name.replace("_pct", " %").replace("_mm", " mm").replace("_ms", " ms").replace("_", " ") for name in rows[0]
    ]
    lines = [heads, ["---"] * len(heads), *([value or " " for value in row.values()] for row in rows)]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines) + "\n"


def between(axes: Axes, y: float, row: Row, value: str, low: str, high: str, color: str, marker: str = "o") -> None:
    """Draw a number with its interval, where it has one."""
    if row.get(low):
        axes.plot([float(row[low]), float(row[high])], [y, y], color=color, linewidth=1.4, solid_capstyle="round")
    axes.plot(float(row[value]), y, marker, color=color)


def named(axes: Axes, names: Sequence[str], gap: float = 0.6) -> None:
    """Name the lines of a diagram, from the top."""
    axes.set_yticks(range(len(names)), names)
    axes.set_ylim(len(names) - 1 + gap, -gap)
    axes.tick_params(axis="y", length=0)
    axes.grid(visible=False, axis="y")


def dots(
    axes: Axes, rows: Sequence[Row], name: str, series: str, value: str, colors: dict[str, str], x_label: str
) -> None:
    """One line for each name, a dot for each series."""
    names = list(dict.fromkeys(row[name] for row in rows))
    for label, color in colors.items():
        points = [(float(row[value]), names.index(row[name])) for row in rows if row[series] == label]
        axes.plot(*zip(*points, strict=True), "o", color=color, label=label, alpha=0.9)
    named(axes, names)
    axes.set_xlabel(x_label)
    axes.figure.legend(loc="outside upper center", ncols=len(colors), frameon=False, handletextpad=0.1)


def methods(figure: Figure) -> None:
    """Every method from 30° and 30 mm."""
    rows, axes = rows_of("methods"), figure.subplots()
    for y, row in enumerate(rows):
        between(axes, y, row, "right_pct", "low", "high", BLUE if row["calls"] == "25" else GREY)
        axes.text(100, y, f"{row['mean_mm']} mm", va="center", ha="right", color="#444444")
    named(axes, [row["method"] for row in rows])
    axes.set(xlim=(68, 100.5), xlabel="right answers [%] with 95 % interval; at the right the mean error")
    axes.text(68.5, 6.0, "25 calls, of 5 hypotheses", color=BLUE)
    axes.text(68.5, 7.0, "5 calls, of the first", color=GREY)


def refiners(figure: Figure) -> None:
    """ICP, the network and both, from near to far."""
    rows = [row for row in rows_of("refiners") if "°" in row["start"]]
    for axes, method in zip(figure.subplots(1, 2, sharey=True), ("refine", "rir"), strict=True):
        for refiner, color in (("icp", GREY), ("depth_net", SKY), ("depth_net_icp", BLUE)):
            own = [row for row in rows if (row["method"], row["refiner"]) == (method, refiner)]
            x, y = [int(row["start"].split("°")[0]) for row in own], [float(row["auc"]) for row in own]
            axes.plot(x, y, "o-", color=color)
            axes.annotate(
                refiner,
                (x[-1], y[-1]),
                (5, -3 * (refiner == "icp")),
                textcoords="offset points",
                va="center",
                color=color,
            )
        axes.set(title={"refine": "one hypothesis, 5 calls", "rir": "RIR: five hypotheses, 25 calls"}[method])
        axes.set(xlabel="start off by [°], and 10 to 40 mm", xlim=(8, 80), xticks=[10, 20, 30, 45, 60], ylim=(40, 90))
    figure.axes[0].set_ylabel("AUC of ADD(-S) to 20 mm [%]")


def real_frames(figure: Figure) -> None:
    """Every method on estimators' poses."""
    rows = [row for row in rows_of("real_frames") if row["settings"] != "any"]
    colors = {"recommended": BLUE, "with icp": SKY, "paper": ORANGE, "published": GREY}
    dots(axes := figure.subplots(), rows, "what", "settings", "mean_mm", colors, "mean ADD(-S) of 9 objects [mm]")
    axes.axvline(13.7, color=RED, linewidth=1)
    axes.text(13.5, -0.45, "CosyPose alone", color=RED, ha="right", va="center")
    axes.set_xlim(0, 16)


def terms(figure: Figure) -> None:
    """What colour and flips gain, by refiner and start."""
    rows = rows_of("terms")
    shown = [row for row in rows if row["what"].startswith("rir") and row["score"] in TERMS]
    dots(axes := figure.subplots(), shown, "what", "score", "right_pct", TERMS, "right answers [%]")
    axes.set_xlim(75, 101)


TERMS = {"paper's score": GREY, "colour": ORANGE, "colour and flips": BLUE}


def whole_scenes(figure: Figure) -> None:
    """Methods by settings, on whole scenes."""
    rows = rows_of("whole_scenes")
    colors = {"recommended, ICP": BLUE, "recommended, trimmed ICP": SKY, "paper, ICP": ORANGE, "published, ICP": GREY}
    shown = [row for row in rows if row["settings"] in colors]
    dots(axes := figure.subplots(), shown, "method", "settings", "right_pct", colors, "right answers [%]")
    axes.axvline(82, color=GREEN, linewidth=1)
    axes.text(82.3, 0, "PHYSIM-MCTS", color=GREEN, va="center")
    axes.set_xlim(55, 100)


def exploration(figure: Figure) -> None:
    """The weight of exploration, and fixed policies beside it."""
    rows, axes = rows_of("exploration"), figure.subplots()
    curve = [row for row in rows if row["c"][0].isdigit()]
    axes.plot([float(row["c"]) for row in curve], [float(row["right_pct"]) for row in curve], "o-", color=BLUE)
    axes.annotate("RIR", (0.5, 87), (0, 6), textcoords="offset points", color=BLUE, ha="right")
    for row, color in zip([row for row in rows if row not in curve], (GREEN, ORANGE, GREY), strict=True):
        axes.plot([0.05, 1.0], 2 * [float(row["right_pct"])], color=color, linewidth=1, linestyle="--")
        axes.text(1.02, float(row["right_pct"]), row["c"], color=color, va="center")
    axes.set(xlabel="c, weight of exploration [score]", ylabel="right answers [%]", xlim=(0.05, 1.15), ylim=(76, 92))


def differences(axes: Axes, rows: Sequence[Row], value: str, names: Sequence[str], x_label: str) -> None:
    """Differences with intervals beside 0: those that leave it out in colour."""
    for y, row in enumerate(rows):
        is_clear = float(row["low"]) > 0 or float(row["high"]) < 0
        between(axes, y, row, value, "low", "high", BLUE if is_clear else GREY)
    axes.axvline(0, color="#444444", linewidth=0.8)
    named(axes, names)
    axes.set_xlabel(x_label)


def authors_parts(figure: Figure) -> None:
    """The authors' bodies and clouds, against none of them."""
    rows = rows_of("authors_parts")
    plain = {row["what"]: float(row["right_pct"]) for row in rows if row["with"] == "plain"}
    shown = [row | {"gain": str(float(row["right_pct"]) - plain[row["what"]])} for row in rows if row["low"]]
    names = [f"{row['what'].rsplit(',', 1)[0]}; {row['with'].split('.')[-1]}" for row in shown]
    differences(figure.subplots(), shown, "gain", names, "gain in right answers [points], 95 % interval")


def orders(figure: Figure) -> None:
    """The paper's claims on the built-in scenes."""
    rows = rows_of("orders")
    names = [f"{row['claim']}  ({row['error']})" for row in rows]
    differences(figure.subplots(), rows, "points", names, "difference in AR [points], 95 % interval")


def tables(figure: Figure) -> None:
    """Tables I to III on the built-in scenes."""
    for axes, refiner in zip(figure.subplots(1, 3), ("DF-R", "ICP", "TrICP"), strict=True):
        rows = [row for row in rows_of("tables") if row["refiner"] == refiner]
        for y, row in enumerate(rows):
            ar = float(row["ar"])
            axes.plot([60, ar], [y, y], color=BLUE, linewidth=5, alpha=0.35, solid_capstyle="butt")
            axes.text(ar + 0.5, y, row["ar"], va="center", color="#333333")
        named(axes, [row["method"].replace(", roll-outs not counted", "*") for row in rows])
        axes.set(title=refiner, xlim=(60, 108), xticks=[60, 80, 100], xlabel="AR [%]")


def grasps(figure: Figure) -> None:
    """How often a simulated gripper lifts the object, by method."""
    rows = rows_of("grasps")
    scenes = list(dict.fromkeys(row["scene"] for row in rows))
    for axes, scene in zip(figure.subplots(1, len(scenes), sharey=True, squeeze=False)[0], scenes, strict=True):
        own = [row for row in rows if row["scene"] == scene]
        for y, row in enumerate(own):
            between(axes, y, row, "success_pct", "low", "high", BLUE)
        named(axes, [row["method"] for row in own])
        axes.set(title=scene, xlabel="objects lifted [%], 95 % interval", xlim=(30, 100))


def grasp_errors(figure: Figure) -> None:
    """How often the object is lifted, over the error of its pose."""
    rows = rows_of("grasp_errors")
    for axes, (error, unit) in zip(
        figure.subplots(1, 2, sharey=True), (("translation", "mm"), ("rotation", "°")), strict=True
    ):
        for scene, color in zip(dict.fromkeys(row["scene"] for row in rows), (BLUE, ORANGE), strict=False):
            own = [row for row in rows if (row["scene"], row["error"]) == (scene, error)]
            x = [float(row["size"]) for row in own]
            axes.fill_between(
                x, [float(r["low"]) for r in own], [float(r["high"]) for r in own], color=color, alpha=0.15
            )
            axes.plot(x, [float(row["success_pct"]) for row in own], "o-", color=color, label=scene)
        axes.set(xlabel=f"{error} error of the pose [{unit}]", ylim=(0, 100))
    figure.axes[0].set_ylabel("objects lifted [%]")
    figure.axes[0].legend(frameon=False, loc="lower left")


def verdicts(figure: Figure) -> None:
    """Causes named on real frames, and how many brute force confirms."""
    axes, rows = figure.subplots(), rows_of("verdicts")
    causes = list(dict.fromkeys(row["cause"] for row in rows))
    for y, cause in enumerate(causes):
        confirmed, n = (sum(int(row[k]) for row in rows if row["cause"] == cause) for k in ("confirmed", "named"))
        axes.barh(y, n, color="#d8d8d8")
        axes.barh(y, confirmed, color=BLUE)
        axes.text(n + 0.3, y, f"{confirmed} of {n}", va="center")
    named(axes, causes)
    axes.set(xlabel="failures on real frames: named, and confirmed by brute force (blue)", xlim=(0, 30))


def densefusion(figure: Figure) -> None:
    """DF-R and the methods around it, here and in the paper."""
    rows, axes = rows_of("densefusion"), figure.subplots()
    series = {
        "ar_here": ("built-in scenes", BLUE),
        "ar_paper_lm": ("paper, LINEMOD", ORANGE),
        "ar_paper_ycbv": ("paper, YCB-V", GREY),
    }
    for column, (label, color) in series.items():
        own = [(y, float(row[column])) for y, row in enumerate(rows) if row[column]]
        axes.plot([value for _, value in own], [y for y, _ in own], "o", color=color, label=label)
    named(axes, [row["method"] for row in rows])
    axes.set(xlabel="AR [%]; data and weights differ, so compare the order", xlim=(60, 90))
    figure.legend(loc="outside upper center", ncols=3, frameon=False, handletextpad=0.1)


def time(figure: Figure) -> None:
    """Milliseconds beside those of peers."""
    rows, axes = rows_of("time"), figure.subplots()
    for y, row in enumerate(rows):
        for side, color, shift in (("ours", BLUE, 0.13), ("peer", GREY, -0.13)):
            low, high = float(row[f"{side}_ms_low"]), float(row[f"{side}_ms_high"])
            axes.plot([low, high], [y - shift, y - shift], color=color, linewidth=5, solid_capstyle="round")
        axes.text(float(row["peer_ms_high"]) * 1.35, y + 0.13, row["peer"], va="center", color="#666666")
    named(axes, [row["what"] for row in rows])
    axes.set(xscale="log", xlabel="milliseconds; blue, ours", xlim=(0.1, 3e7))


FIGURES: dict[str, tuple[Callable[[Figure], None], float]] = {
    "methods": (methods, 3.0), "refiners": (refiners, 2.9), "real_frames": (real_frames, 3.0), "terms": (terms, 2.6),
    "whole_scenes": (whole_scenes, 2.7), "exploration": (exploration, 2.6), "authors_parts": (authors_parts, 4.6),
    "orders": (orders, 4.4), "tables": (tables, 2.5), "grasps": (grasps, 2.5), "grasp_errors": (grasp_errors, 2.6),
    "verdicts": (verdicts, 2.1), "densefusion": (densefusion, 2.7), "time": (time, 2.7),
}  # fmt: skip
"""Each figure with its height [in]."""


def fingerprint(name: str) -> str:
    """Return what tells the numbers of a figure from others; the figure holds it."""
    return f"sha256 {sha256((FOLDER / f'{name}.csv').read_bytes()).hexdigest()[:16]}"


def draw(name: str) -> None:
    """Write a figure beside its numbers."""
    draw_it, height_in = FIGURES[name]
    with mpl.rc_context(STYLE):
        figure = Figure((WIDTH_IN, height_in), layout="constrained", facecolor="white")
        draw_it(figure)
        figure.savefig(FOLDER / f"{name}.svg", metadata={"Date": None, "Description": fingerprint(name)})


if __name__ == "__main__":
    for each in FIGURES:
        draw(each)
    PAGE.write_text(filled(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
