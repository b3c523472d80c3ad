"""The plot of score over error of everything in a batch."""

from __future__ import annotations

import viser

from verefine_viz.viewer.gallery import Entry
from verefine_viz.viewer.markup import text
from verefine_viz.viewer.score_plot import ScorePlot, plot_of
from verefine_viz.viewer.view import View
from verefine_viz.viewer.widgets import Block


class ScoreErrorPanel:
    """A sentence and the plot; filtered by object, method and run, as the gallery is."""

    def __init__(self, gui: viser.GuiApi) -> None:
        self._block = Block(gui)
        self._plot: ScorePlot | None = None
        self._said = ""
        self._drawn: tuple[dict[str, str], Entry | None] | None = None

    def show(self, view: View) -> None:
        """Worked out again only if the filters changed, drawn again also if another object is open."""
        if view.batch is None:
            return
        only = dict(view.look.batch_only)
        if self._plot is None or self._drawn is None or self._drawn[0] != only:
            self._plot = plot_of(view.batch, only)
            words = text(self._plot.words())
            self._said = f'<p style="font-size:11px;line-height:1.25;margin-bottom:2px">{words}</p>'
        elif self._drawn[1] is view.entry:
            return
        self._drawn = only, view.entry
        self._block.show(self._said + self._plot.svg(view.entry))
