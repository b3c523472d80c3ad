"""Errors against ground truth: the Errors panel, and the plot of score over error of a batch."""

from __future__ import annotations

import viser

from verefine_viz.viewer import commands as c
from verefine_viz.viewer.drawing import score_error_plot as score_plot
from verefine_viz.viewer.drawing.markup import sentence, text
from verefine_viz.viewer.drawing.pose_tables import errors_table, one_scale_note, starts_table
from verefine_viz.viewer.panels.widgets import Block, Send, by_person
from verefine_viz.viewer.snapshot.score_plot import ScorePlot, plot_of
from verefine_viz.viewer.snapshot.snapshot import Snapshot
from verefine_viz.viewer.state.gallery import Entry
from verefine_viz.viewer.text.sentences import truth


class ErrorsPanel:
    """Errors per stage and of the initial poses; over time they are in the curves."""

    def __init__(self, gui: viser.GuiApi, send: Send) -> None:
        self._words = Block(gui)
        self.score_truth = gui.add_button(
            "Score the ground truth",
            hint="ground truth beside the best pose: does the score prefer a wrong pose?",
        )
        self.score_truth.on_click(by_person(lambda _: send(c.ScoreGroundTruth())))
        self._stages = Block(gui, "errors")
        self._starts = Block(gui)

    def show(self, snapshot: Snapshot) -> None:
        """All errors at the cursor; without ground truth only the sentence."""
        self._words.show(sentence(truth(snapshot)))
        self.score_truth.visible = snapshot.truth is not None
        self._stages.show(one_scale_note(snapshot) + errors_table(snapshot) if snapshot.truth else "")
        self._starts.show(starts_table(snapshot) if snapshot.truth else "")


# The plot of score over error of everything in a batch.


class ScoreErrorPanel:
    """A sentence and the plot; filtered by object, method and run, as the gallery is."""

    def __init__(self, gui: viser.GuiApi) -> None:
        self._block = Block(gui)
        self._plot: ScorePlot | None = None
        self._said = ""
        self._drawn: tuple[dict[str, str], Entry | None] | None = None

    def show(self, snapshot: Snapshot) -> None:
        """Worked out again only if the filters changed, drawn again also if another object is open."""
        if snapshot.batch is None:
            return
        only = dict(snapshot.options.batch_only)
        if self._plot is None or self._drawn is None or self._drawn[0] != only:
            self._plot = plot_of(snapshot.batch, only)
            words = text(score_plot.words(self._plot))
            self._said = f'<p style="font-size:11px;line-height:1.25;margin-bottom:2px">{words}</p>'
        elif self._drawn[1] is snapshot.entry:
            return
        self._drawn = only, snapshot.entry
        self._block.show(self._said + score_plot.svg(self._plot, snapshot.entry))
