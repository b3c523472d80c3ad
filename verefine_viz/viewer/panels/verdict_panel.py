"""The verdict in one line."""

from __future__ import annotations

import viser

from verefine_viz.viewer.drawing.markup import sentence
from verefine_viz.viewer.panels.widgets import Block, Send
from verefine_viz.viewer.snapshot.snapshot import Snapshot
from verefine_viz.viewer.text.headline import headline


class VerdictPanel:
    """The first sentence of the headline."""

    def __init__(self, gui: viser.GuiApi, send: Send) -> None:
        self._block = Block(gui, "verdict")

    def show(self, snapshot: Snapshot) -> None:
        """The line."""
        self._block.show(sentence(headline(snapshot).split(". ")[0]))
