"""The Errors panel: how far off each stage is, and whether the score knows."""

from __future__ import annotations

import viser

from verefine_viz.viewer import commands as c
from verefine_viz.viewer.markup import sentence
from verefine_viz.viewer.scales import one_scale_note
from verefine_viz.viewer.tables import errors_table, starts_table
from verefine_viz.viewer.view import View
from verefine_viz.viewer.widgets import Block, Send, by_person
from verefine_viz.viewer.words import truth


class ErrorsPanel:
    """Errors per stage and of the first poses; over time they are in the curves."""

    def __init__(self, gui: viser.GuiApi, send: Send) -> None:
        self._words = Block(gui)
        self.judge = gui.add_button(
            "Score the ground truth",
            hint="ground truth beside the best pose: does the score prefer a wrong pose?",
        )
        self.judge.on_click(by_person(lambda _: send(c.ScoreGroundTruth())))
        self._stages = Block(gui, "errors")
        self._starts = Block(gui)

    def show(self, view: View) -> None:
        """All errors at the cursor; without ground truth only the sentence."""
        self._words.show(sentence(truth(view)))
        self.judge.visible = view.truth is not None
        self._stages.show(one_scale_note(view) + errors_table(view) if view.truth else "")
        self._starts.show(starts_table(view) if view.truth else "")
