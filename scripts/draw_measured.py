"""The figures and tables of docs/measured.md, from the numbers in docs/measured/*.csv (make measured).

A table stands between `<!-- table NAME -->` and `<!-- end -->`, with every column of NAME.csv, or with one value for
each row and column: `<!-- table NAME start,method by refiner: auc -->`.
"""

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
TABLE = re.compile(r"(<!-- table (\w+)(?: ([\w,]+) by (\w+): (\w+))? -->\n).*?(<!-- end -->)", re.DOTALL)
"""Where the page has a table of a CSV file."""
NUMBER = re.compile(r"(-?[\d.]+)?")
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

    def table(match: re.Match[str]) -> str:
        rows = rows_of(match[2])
        if match[3]:
            rows = crossed(rows, match[3].split(","), match[4], match[5])
        else:
            rows = [{titled(name): cell for name, cell in row.items()} for row in rows]
        return f"{match[1]}\n{markdown(rows)}\n{match[6]}"

    return TABLE.sub(table, page)


def titled(name: str) -> str:
    """Return the name of a column as a heading."""
    return name.replace("_pct", " %").replace("_mm", " mm").replace("_ms", " ms").replace("_", " ")


def crossed(rows: Sequence[Row], names: Sequence[str], column: str, value: str) -> list[Row]:
    """Return one row for each combination of names, with a column for each value of another."""
    lines = list(dict.fromkeys(tuple(row[name] for name in names) for row in rows))
    cells = {(*(row[name] for name in names), row[column]): row[value] for row in rows}
    heads = list(dict.fromkeys(row[column] for row in rows))
    return [dict(zip(names, line, strict=True)) | {h: cells.get((*line, h), "") for h in heads} for line in lines]


def markdown(rows: Sequence[Row]) -> str:
    """Return rows as a Markdown table."""
    rules = ["---:" if all(NUMBER.fullmatch(row[name]) for row in rows) else "---" for name in rows[0]]
    lines = [list(rows[0]), rules, *([value or " " for value in row.values()] for row in rows)]
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
    """One line for each name, a dot for each series, with its interval where it has one."""
    names = list(dict.fromkeys(row[name] for row in rows))
    for i, (label, color) in enumerate(colors.items()):
        own = [row for row in rows if row[series] == label]
        shifted = [names.index(row[name]) + 0.16 * (i - (len(colors) - 1) / 2) for row in own]
        axes.plot([float(row[value]) for row in own], shifted, "o", color=color, label=label)
        for y, row in zip(shifted, own, strict=True):
            if row.get("low"):
                axes.plot(
                    [float(row["low"]), float(row["high"])], [y, y], color=color, linewidth=1.2, solid_capstyle="round"
                )
    named(axes, names)
    for y in range(1, len(names)):
        axes.axhline(y - 0.5, color="#dddddd", linewidth=0.5)
    axes.set_xlabel(x_label)
    axes.figure.legend(loc="outside upper center", ncols=len(colors), frameon=False, handletextpad=0.1)


def methods(figure: Figure) -> None:
    """Every method from 30° and 30 mm."""
    rows, axes = rows_of("methods"), figure.subplots()
    for y, row in enumerate(rows):
        between(axes, y, row, "right_pct", "low", "high", BLUE if row["calls"] == "25" else GREY)
        axes.text(100, y, f"{row['mean_mm']} mm", va="center", ha="right", color="#444444")
    named(axes, [row["method"] for row in rows])
    axes.set(
        xlim=(68, 100.5), xlabel="right answers [%], 95 % interval where one was computed; at the right the mean error"
    )
    axes.text(68.5, 6.0, "25 calls, of 5 hypotheses", color=BLUE)
    axes.text(68.5, 7.0, "5 calls, of the first", color=GREY)


def refiners(figure: Figure) -> None:
    """ICP, the network and both, from near to far; bars that leave out ICP's line are clear of it."""
    rows = [row for row in rows_of("refiners") if "°" in row["start"]]
    for axes, method in zip(figure.subplots(1, 2, sharey=True), ("refine", "rir"), strict=True):
        for refiner, color in (("icp", GREY), ("depth_net", SKY), ("depth_net_icp", BLUE)):
            own = [row for row in rows if (row["method"], row["refiner"]) == (method, refiner)]
            x, y = [int(row["start"].split("°")[0]) for row in own], [float(row["auc"]) for row in own]
            axes.plot(x, y, "o-", color=color)
            name_at = ((x[-1], y[-1]), (5, -3 * (refiner == "icp")))
            axes.annotate(refiner, *name_at, textcoords="offset points", va="center", color=color)
            if refiner == "depth_net_icp":
                plain = {
                    row["start"]: float(row["auc"])
                    for row in rows
                    if (row["method"], row["refiner"]) == (method, "icp")
                }
                ends = [[plain[row["start"]] + float(row[end]) for row in own] for end in ("auc_low", "auc_high")]
                axes.vlines(x, *ends, color=color, linewidth=1.2)
        axes.set(title={"refine": "one hypothesis, 5 calls", "rir": "RIR: five hypotheses, 25 calls"}[method])
        axes.set(xlabel="start off by [°], and 10 to 40 mm", xlim=(8, 80), xticks=[10, 20, 30, 45, 60], ylim=(40, 90))
    figure.axes[0].set_ylabel("AUC of ADD(-S) to 20 mm [%]")
    figure.axes[0].text(9, 42, "bars: 95 % interval of the\ndifference to icp", color=BLUE)


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
    rows = [row for row in rows_of("terms") if row["what"].startswith("rir")]
    plain = {row["what"]: row["right_pct"] for row in rows if row["score"] == "paper's score"}
    own = gained(rows, "what", "score", "paper's score")
    for row in own:
        start = row["what"].removeprefix("rir, ")
        row["name"] = f"{start if 'depth_net' in start else f'icp, {start}'}: {plain[row['what']]} %"
    colors = {"colour": ORANGE, "colour and flips": BLUE, "all": GREY}
    dots(axes := figure.subplots(), own, "name", "score", "gain", colors, "")
    figure.supxlabel("gain over the right answers with the paper's score, at the left [points]", fontsize=8.5)
    axes.axvline(0, color="#444444", linewidth=0.8)


def observed_support(figure: Figure) -> None:
    """What the surroundings in the depth image gain over the plane."""
    gains(figure, "terms", "what", "score", "paper's score", {"observed support": ""})


def plausibility(figure: Figure) -> None:
    """What a third term of the score gains, by its weight."""
    gains(figure, "plausibility", "what", "w", "0", {"0.1": "w = 0.1", "0.3": "w = 0.3"})


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
        shift = {"expl": 0.25, "refine": -0.25}.get(row["c"], 0)
        axes.text(1.02, float(row["right_pct"]) + shift, row["c"], color=color, va="center")
    axes.set(xlabel="c, weight of exploration [score]", ylabel="right answers [%]", xlim=(0.05, 1.15), ylim=(76, 92))


def differences(axes: Axes, rows: Sequence[Row], value: str, names: Sequence[str], x_label: str) -> None:
    """Differences with intervals beside 0: those that leave it out in colour."""
    for y, row in enumerate(rows):
        is_clear = float(row["low"]) > 0 or float(row["high"]) < 0
        between(axes, y, row, value, "low", "high", BLUE if is_clear else GREY)
    axes.axvline(0, color="#444444", linewidth=0.8)
    named(axes, names)
    axes.set_xlabel(x_label)


def gained(rows: Sequence[Row], name: str, series: str, first: str) -> list[Row]:
    """Return the rows of the other series with what they gain in right answers over the first."""
    plain = {row[name]: float(row["right_pct"]) for row in rows if row[series] == first}
    others = [row for row in rows if row[series] != first]
    return [row | {"gain": str(float(row["right_pct"]) - plain[row[name]])} for row in others]


def gains(figure: Figure, file: str, name: str, series: str, first: str, titles: dict[str, str]) -> None:
    """Gains of some series in panels of their own."""
    rows = gained(rows_of(file), name, series, first)
    panels = figure.subplots(1, len(titles), sharex=True, sharey=True, squeeze=False)[0]
    for axes, (shown, title) in zip(panels, titles.items(), strict=True):
        own = [row for row in rows if row[series] == shown]
        differences(axes, own, "gain", [row[name] for row in own], "")
        axes.set_title(title)
    figure.supxlabel("gain in right answers [points], 95 % interval", fontsize=8.5)


def authors_parts(figure: Figure) -> None:
    """The authors' bodies and clouds, against none of them."""
    titles = {'physics.inertia = "box"': "bodies", 'scene.model_sampling = "even"': "clouds", "both": "both"}
    gains(figure, "authors_parts", "what", "with", "plain", titles)


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
            axes.plot(ar, y, "o", color=BLUE)
            axes.text(ar + 2.4, y, row["ar"], va="center", color="#333333")
        named(axes, [row["method"].replace(", roll-outs not counted", "*") for row in rows])
        axes.set(title=refiner, xlim=(60, 112), xticks=[60, 80, 100], xlabel="AR [%]")


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
        own = [row for row in rows if row["cause"] == cause]
        named_n, confirmed = (sum(int(row[k]) for row in own) for k in ("named", "confirmed"))
        held_out = sum(int(row["confirmed"]) for row in own if row["frames"] == HELD_OUT)
        axes.barh(y, named_n, color="#d8d8d8")
        axes.barh(y, confirmed, color=SKY)
        axes.barh(y, held_out, color=BLUE)
        beside = f", {held_out} held out" if held_out else ""
        axes.text(named_n + 0.3, y, f"{confirmed} of {named_n}{beside}", va="center")
    named(axes, causes)
    axes.set(xlabel="failures on real frames with this cause that brute force confirms; dark: held out", xlim=(0, 33))


def reliability(figure: Figure) -> None:
    """Errors of rotation by the widest turn that is stated of an answer."""
    axes, rows = figure.subplots(), rows_of("reliability")
    for y, row in enumerate(rows):
        low, high = float(row["stated_deg_from"]), float(row["stated_deg_to"])
        axes.barh(y, high - low, left=low, height=0.7, color="#d8d8d8")
        axes.plot([float(row["median_error_deg"])], [y], "o", color=BLUE)
        axes.plot([float(row["error_deg_95_pct"])], [y], "|", color=BLUE, markersize=11, markeredgewidth=2)
        axes.text(190, y, f"{row['error_within_pct']} % of {row['answers']}", va="center")
    named(axes, [f"{row['stated_deg_from']} to {row['stated_deg_to']}°" for row in rows])
    axes.set(
        xscale="symlog", xlim=(0, 400), ylabel="stated",
        xlabel="error of rotation [°]: median and 95 %; grey, what is stated; right, errors within it",
    )  # fmt: skip
    axes.set_xticks([0, 1, 2, 5, 10, 30, 90, 180], ["0", "1", "2", "5", "10", "30", "90", "180"])


HELD_OUT = "mug, seeds 30-33"
"""The only frames on which nothing was mended."""


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


def stages(figure: Figure) -> None:
    """Milliseconds of an iteration, by what they are spent on."""
    rows, axes = rows_of("stages"), figure.subplots()
    starts = [0.0] * len(rows)
    for part, color in (("simulation", SKY), ("refiner", ORANGE), ("score", BLUE), ("rest", GREY)):
        widths = [float(row[f"{part} ms"]) for row in rows]
        axes.barh(range(len(rows)), widths, left=starts, height=0.6, color=color, label=part)
        starts = [start + width for start, width in zip(starts, widths, strict=True)]
    named(axes, [f"{row['what']}, {row['state']}" for row in rows])
    axes.set(xlabel="milliseconds an iteration")
    axes.legend(ncols=4, frameon=False, loc="lower right", bbox_to_anchor=(1, 1))


FIGURES: dict[str, tuple[Callable[[Figure], None], float, str]] = {
    function.__name__: (function, height_in, file or function.__name__)
    for function, height_in, file in (
        (real_frames, 3.7, ""), (methods, 3.0, ""), (exploration, 2.6, ""), (refiners, 2.9, ""), (terms, 3.2, ""),
        (plausibility, 2.2, ""), (whole_scenes, 3.3, ""), (orders, 5.6, ""), (tables, 2.5, ""), (densefusion, 2.7, ""),
        (grasps, 2.5, ""), (grasp_errors, 2.6, ""), (verdicts, 2.1, ""), (reliability, 2.0, ""),
        (authors_parts, 2.6, ""),
        (observed_support, 2.7, "terms"), (time, 2.7, ""), (stages, 1.9, ""),
    )
}  # fmt: skip
"""Each figure with its height [in] and the file of its numbers."""


def fingerprint(name: str) -> str:
    """Return what tells the numbers of a figure from others; the figure holds it."""
    return f"sha256 {sha256((FOLDER / f'{FIGURES[name][2]}.csv').read_bytes()).hexdigest()[:16]}"


def draw(name: str) -> None:
    """Write a figure beside its numbers."""
    draw_it, height_in, _ = FIGURES[name]
    with mpl.rc_context(STYLE):
        figure = Figure((WIDTH_IN, height_in), layout="constrained", facecolor="white")
        draw_it(figure)
        figure.savefig(FOLDER / f"{name}.svg", metadata={"Date": None, "Description": fingerprint(name)})


if __name__ == "__main__":
    for each in FIGURES:
        draw(each)
    PAGE.write_text(filled(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
