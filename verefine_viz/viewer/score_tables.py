"""The tables of a score: its parts pose by pose, and what one pixel adds to it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from verefine_viz.core.palette import CLASS_COLORS
from verefine_viz.core.scores import PIXEL_CLASSES, PoseScore
from verefine_viz.viewer.maps import Probe
from verefine_viz.viewer.markup import Row, swatch, table, text
from verefine_viz.viewer.pair_words import score_digits
from verefine_viz.viewer.tables import NONE, number
from verefine_viz.viewer.view import Judged

CLASS_MEANING = {
    "explained": "rendered and observed depth agree within τ",
    "missed": "the object's mask was measured here, but the pose leaves it empty or puts it behind what was measured",
    "protruding": "the pose puts surface where the sensor saw through, or outside the mask onto another surface",
    "hidden": "something nearer stands in front, outside the mask or known from a placed object; does not count",
    "unknown": "rendered, but nothing was measured there; does not count",
}


def score_table(poses: Sequence[Judged | None], short: bool = False) -> str:
    """The parts of the score of some poses, a column each; ``short``: the pixels as bars only."""
    known = [p for p in poses if p is not None]
    head = [("", ""), *((p.label, f"the {p.label} pose") for p in known)]
    scores = [p.score for p in known]

    def row(label: str, tip: str, cells: Iterable[str], marked: bool = False) -> Row:
        return Row([f'<span title="{text(tip)}">{label}</span>', *cells], marked=marked)

    def part(pick: Any, digits: int) -> list[str]:
        return [NONE if s is None else f"{pick(s):.{digits}f}" for s in scores]

    rows = [
        row("score f̄", "mean of depth fit and normal fit: (f_d + f_n) / 2",
            part(lambda s: s.score, score_digits(scores)), marked=True),
        row("depth fit f_d", "mean over the counted pixels; 1 = same depth, 0 = off by τ or more",
            part(lambda s: s.depth_fit, 3)),
        row("normal fit f_n", "mean over the counted pixels; 1 = same direction", part(lambda s: s.normal_fit, 3)),
    ]  # fmt: skip
    if not short:
        rows.append(row("pixels N", "how many pixels count", part(lambda s: s.n_pixels, 0)))
    for name in () if short else PIXEL_CLASSES:
        cells = [NONE if s is None else f"{s.shares[name]:.1%}" for s in scores]
        rows.append(row(f"{swatch(CLASS_COLORS[name])}{name}", CLASS_MEANING[name], cells))
    return table(head, rows) + "".join(_shares_bar(p.label, p.score) for p in known if p.score)


def _shares_bar(name: str, score: PoseScore) -> str:
    parts = "".join(
        f'<i class="bar" style="width:{share * 96:.1f}%;background:rgb{CLASS_COLORS[k]}" '
        f'title="{text(name)}: {share:.1%} {k}"></i>'
        for k, share in score.shares.items()
        if share > 0.004
    )
    return f'<div style="white-space:nowrap;font-size:0" title="{text(name)}">{parts}</div>'


def probe_table(a: tuple[str, Probe | None], b: tuple[str, Probe | None]) -> str:
    """One pixel in numbers, for both stages."""
    sides = [(name, p) for name, p in (a, b) if p is not None]
    if not sides:
        return ""
    first = sides[0][1]

    def row(label: str, tip: str, pick: Any) -> Row:
        return Row([f'<span title="{text(tip)}">{label}</span>', *(text(pick(p)) for _, p in sides)])

    rows = [
        row("observed", "depth that the sensor measured", lambda p: number(p.observed_m, 4, " m")),
        row("rendered", "depth of the model", lambda p: number(p.rendered_m, 4, " m")),
        row("Δ depth, angle", "observed − rendered; between the normals",
            lambda p: f"{number(p.difference_mm, 1, ' mm')}, {number(p.angle_deg, 1, '°')}"),
        row("f_d, f_n", "depth and normal fit", lambda p: f"{p.f_d:.2f}, {p.f_n:.2f}"),
        row("class", "why it counts as it does", lambda p: p.pixel_class),
        row("adds", "what this pixel adds to the score", lambda p: f"{p.contribution:.5f}"),
    ]  # fmt: skip
    head = [(f"pixel {first.u}, {first.v}", "column u, row v"), *((name, "") for name, _ in sides)]
    return table(head, rows)
