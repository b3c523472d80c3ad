"""The plot of score over error of everything in a batch."""

from __future__ import annotations

import viser

from verefine_viz.viewer.markup import text
from verefine_viz.viewer.score_plot import plot_of
from verefine_viz.viewer.view import View
from verefine_viz.viewer.widgets import Block


class ScoreErrorPanel:
    """A sentence and the plot; filtered by object, method and run, as the gallery is."""

    def __init__(self, gui: viser.GuiApi) -> None:
        self._plot = Block(gui)
        self._drawn: tuple[object, ...] = ()

    def show(self, view: View) -> None:
        """Drawn again only if the filters or the open object changed."""
        if view.batch is None:
            return
        asked = dict(view.look.batch_only), view.entry
        if asked != self._drawn:
            self._drawn = asked
            plot = plot_of(view.batch, view.look.batch_only)
            said = f'<p style="font-size:11px;line-height:1.25;margin-bottom:2px">{text(plot.words())}</p>'
            self._plot.show(said + plot.svg(view.entry))
