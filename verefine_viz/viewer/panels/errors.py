"""Errors against ground truth: the Errors panel, and the plot of score over error of a batch."""

from __future__ import annotations

import viser

from verefine_viz.viewer import commands as c
from verefine_viz.viewer.drawing import score_plot
from verefine_viz.viewer.drawing.markup import sentence, text
from verefine_viz.viewer.drawing.tables import errors_table, one_scale_note, starts_table
from verefine_viz.viewer.panels.widgets import Block, Send, by_person
from verefine_viz.viewer.snapshot.snapshot import Snapshot
from verefine_viz.viewer.state.batch_gallery import Entry, ScorePlot, plot_of
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

    def show(self, view: Snapshot) -> None:
        """All errors at the cursor; without ground truth only the sentence."""
        self._words.show(sentence(truth(view)))
        self.score_truth.visible = view.ground_truth is not None
        self._stages.show(one_scale_note(view) + errors_table(view) if view.ground_truth else "")
        self._starts.show(starts_table(view) if view.ground_truth else "")


# The plot of score over error of everything in a batch.


class ScoreErrorPanel:
    """A sentence and the plot; filtered by object, method and run, as the gallery is."""

    def __init__(self, gui: viser.GuiApi) -> None:
        self._block = Block(gui)
        self._plot: ScorePlot | None = None
        self._said = ""
        self._drawn: tuple[dict[str, str], Entry | None] | None = None

    def show(self, view: Snapshot) -> None:
        """Worked out again only if the filters changed, drawn again also if another object is open."""
        if view.batch is None:
            return
        only = dict(view.options.batch_only)
        if self._plot is None or self._drawn is None or self._drawn[0] != only:
            self._plot = plot_of(view.batch, only)
            words = text(score_plot.words(self._plot))
            self._said = f'<p style="font-size:11px;line-height:1.25;margin-bottom:2px">{words}</p>'
        elif self._drawn[1] is view.entry:
            return
        self._drawn = only, view.entry
        self._block.show(self._said + score_plot.svg(self._plot, view.entry))
