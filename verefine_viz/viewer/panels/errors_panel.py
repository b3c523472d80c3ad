"""Errors against ground truth: the Errors panel of one object, and the plot of score over error of a batch."""

from __future__ import annotations

import viser

from verefine_viz.batch.totals import misranked_share
from verefine_viz.evaluation.matched_estimates import CORRECT
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.drawing.markup import carries, sentence, text
from verefine_viz.viewer.drawing.plausibility_picture import LIGHTS
from verefine_viz.viewer.drawing.pose_tables import errors_table, one_scale_note, starts_table
from verefine_viz.viewer.panels.widgets import Block, Send, by_user
from verefine_viz.viewer.snapshot.snapshot import Snapshot
from verefine_viz.viewer.state.batch_gallery import (
    BOTTOM,
    HEIGHT,
    LEFT,
    RIGHT_PX,
    TOP,
    WIDTH,
    Entry,
    ScorePlot,
    plot_of,
    x_of,
)
from verefine_viz.viewer.text.display_names import in_focus
from verefine_viz.viewer.text.empty_tabs import NO_GROUND_TRUTH
from verefine_viz.viewer.text.pose_words import preference


class ErrorsPanel:
    """Errors per stage and of the initial poses; over time they are in the curves."""

    def __init__(self, gui: viser.GuiApi, send: Send) -> None:
        self._words = Block(gui)
        self.score_truth = gui.add_button(
            "Compare with ground truth",
            hint="ground truth beside the best pose: does the score prefer a wrong pose?",
        )
        self.score_truth.on_click(by_user(lambda _: send(c.ScoreGroundTruth())))
        self._stages = Block(gui, "errors")
        self._starts = Block(gui, "errors")

    def show(self, snapshot: Snapshot) -> None:
        """All errors at the cursor; without ground truth only the sentence."""
        is_known = snapshot.ground_truth is not None
        self._words.show(sentence(errors_words(snapshot)))
        self.score_truth.visible = is_known
        self._stages.show(one_scale_note(snapshot) + errors_table(snapshot) if is_known else "")
        self._starts.show(starts_table(snapshot) if is_known else "")


def errors_words(snapshot: Snapshot) -> str:
    """What the table of errors does not say: of which hypotheses its poses are, and what the score makes of them."""
    if snapshot.ground_truth is None:
        return NO_GROUND_TRUTH
    best = snapshot.poses.get("best")
    if best is None or best.errors is None or best.score is None or snapshot.ground_truth.score is None:
        return f"{snapshot.name} has no pose to measure."
    turn = snapshot.undeclared  # A score cannot tell such a pose from ground truth.
    sentences = [
        _never_refined(snapshot),
        preference(best, snapshot.ground_truth) if turn is None else turn.in_words(snapshot.name),
    ]
    if snapshot.state is not None and snapshot.state.best.arm != snapshot.arm:
        arms = f"hypothesis {snapshot.arm + 1} began; the answer is of hypothesis {snapshot.state.best.arm + 1}"
        sentences.insert(0, f"Initial is where {arms}.")
    return " ".join(filter(None, sentences))


def _never_refined(snapshot: Snapshot) -> str:
    """That the answer is an initial pose although iterations worked on the object; "" where it is none."""
    answer = in_focus(snapshot).answer if snapshot.is_answer else None
    best = answer or (snapshot.state.best if snapshot.state is not None else None)
    shown_to_its_end = snapshot.cursor - snapshot.is_partial
    if best is None or best.stage != "initial" or not any(i.index <= shown_to_its_end for i in snapshot.own_iterations):
        return ""
    return "The answer is an initial pose: no iteration has improved upon it."


# The plot of score over error of everything in a batch: what is wrong and yet scored high lies in the upper right.

_TICKS = (0.01, 0.03, 0.1, 0.3, 1.0)


class ScoreErrorPanel:
    """A sentence and the plot; filtered by object, method and run, as the gallery is."""

    def __init__(self, gui: viser.GuiApi) -> None:
        self._block = Block(gui)
        self._plot: ScorePlot | None = None
        self._sentence = ""
        self._drawn: tuple[dict[str, str], Entry | None] | None = None

    def show(self, snapshot: Snapshot) -> None:
        """Worked out again only if the filters changed, drawn again also if another object is open."""
        if snapshot.batch is None:
            return
        only = dict(snapshot.options.arrangement.only)
        if self._plot is None or self._drawn is None or self._drawn[0] != only:
            self._plot = plot_of(snapshot.batch, only)
            style = "font-size:11px;line-height:1.25;margin-bottom:2px"
            self._sentence = f'<p style="{style}">{text(trust_in_score(self._plot))}</p>'
        elif self._drawn[1] is snapshot.entry:
            return
        self._drawn = only, snapshot.entry
        self._block.show(self._sentence + plot_svg(self._plot, snapshot.entry))


def trust_in_score(plot: ScorePlot) -> str:
    """How far the score can be trusted, in a sentence."""
    share = misranked_share(entry.row for entry in plot.entries)
    if share is None:
        return "Score over error."
    return f"The score ranks a wrong answer above a right one in {share:.0%} of pairs."


def plot_svg(plot: ScorePlot, opened: Entry | None) -> str:
    """The drawing; a click opens the nearest point, and a ring marks the answer that is open."""
    points: dict[bool, list[str]] = {True: [], False: []}
    for entry in plot.entries:
        at = plot.place(entry)
        if at is not None:
            points[bool(entry.row.is_correct)].append(f"M{at[0]:.1f} {at[1]:.1f}h0")
    size = 5 if len(plot.entries) < 300 else 3.5
    drawn = "".join(
        f'<path d="{"".join(points[is_right])}" stroke="rgb{LIGHTS["green" if is_right else "red"]}" '
        f'stroke-width="{size}" stroke-linecap="round" opacity="0.75"/>'
        for is_right in (True, False)
    )
    at = plot.place(opened) if opened is not None else None
    if at is not None:
        ring = f'cx="{at[0]:.1f}" cy="{at[1]:.1f}" r="5.5" fill="none"'
        drawn += f'<circle {ring} stroke="black" stroke-width="4"/><circle {ring} stroke="white" stroke-width="2"/>'
    title = "A point per object: green is right, red is wrong, the ring is the one that is open. Click one to open it."
    box = f'width="{WIDTH}" height="{HEIGHT}"'
    return (
        f'<svg {box} viewBox="0 0 {WIDTH} {HEIGHT}" style="cursor:crosshair" {carries(c.OpenPoint(0, 0))} '
        f'data-crop="[0,0,{WIDTH},{HEIGHT}]" role="img" aria-label="score over error"><title>{text(title)}</title>'
        f'<rect {box} fill="transparent"/>{_axes(plot)}{drawn}</svg>'
    )


def _axes(plot: ScorePlot) -> str:
    low, high = HEIGHT - BOTTOM, TOP
    parts = [f'<path d="M{LEFT} {high}V{low}H{WIDTH - RIGHT_PX}" stroke="currentColor" opacity="0.5" fill="none"/>']
    for error in _TICKS:
        x = x_of(error)
        parts.append(f'<text x="{x:.1f}" y="{low + 11}" text-anchor="middle">{100 * error:g}%</text>')
        parts.append(f'<path d="M{x:.1f} {low}v3" stroke="currentColor" opacity="0.5"/>')
    for score in (plot.low, (plot.low + 1) / 2, 1.0):
        y = plot.y(score)
        parts.append(f'<text x="{LEFT - 4}" y="{y + 3:.1f}" text-anchor="end">{score:.3g}</text>')
        parts.append(f'<path d="M{LEFT} {y:.1f}H{WIDTH - RIGHT_PX}" stroke="currentColor" opacity="0.12"/>')
    x = x_of(CORRECT)
    parts.append(f'<path d="M{x:.1f} {high}V{low}" stroke="currentColor" stroke-dasharray="4 3" opacity="0.6"/>')
    parts.append(f'<text x="{(LEFT + WIDTH - RIGHT_PX) / 2}" y="{low + 22}" text-anchor="middle">')
    parts.append("score over ADD(-S) as a share of the diameter</text>")
    return f'<g font-size="9" fill="currentColor" stroke="none">{"".join(parts)}</g>'
