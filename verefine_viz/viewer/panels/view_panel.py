"""The View panel: what is drawn in 3D. Its labels carry the colours, so it is the legend as well."""

from __future__ import annotations

import viser

from verefine_viz.core.palette import STAGE_COLORS
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.drawing.markup import sentence
from verefine_viz.viewer.panels.widgets import Block, Send, by_person
from verefine_viz.viewer.snapshot.snapshot import Snapshot
from verefine_viz.viewer.state.view_options import LAYERS, SHOWN_AT_FIRST, STAGES
from verefine_viz.viewer.text.sentences import HINTS, LABELS, view_words
from verefine_viz.viewer.web.viser_internals import compact, label_of, side_by_side

WITH_BOX = tuple(name for name in LAYERS if name not in ("path", "edited"))
ROWS = tuple(
    zip((n for n in WITH_BOX if n in STAGES), (n for n in WITH_BOX if n not in STAGES), strict=True),
)
"""Poses on the left, all else on the right."""
ROW_PX = 20
LABEL_PX = 92
RIGHT_FROM_PX = 124
"""Where the right column begins."""


class ViewPanel:
    """What is drawn in words, a box per layer, and the cloud's colours."""

    def __init__(self, gui: viser.GuiApi, send: Send) -> None:
        self.boxes: dict[str, viser.GuiCheckboxHandle] = {}
        self._words = Block(gui, "brief tight")
        self.cloud = gui.add_dropdown(
            "Cloud", ("colour", "residual", "class"), hint="residual: observed − rendered depth of B (C switches)"
        )
        self.cloud.on_update(by_person(lambda v: send(c.ColorCloud(v))))
        for name in (name for row in ROWS for name in row):
            box = gui.add_checkbox(LABELS.get(name, name), name in SHOWN_AT_FIRST, hint=HINTS.get(name))
            box.on_update(by_person(lambda on, name=name: send(c.ShowLayer(name, on))))
            self.boxes[name] = box
        rules = [_swatch_rule(name, box) for name, box in self.boxes.items()]
        rules += [side_by_side(self.boxes[a], self.boxes[b], ROW_PX, RIGHT_FROM_PX, LABEL_PX) for a, b in ROWS]
        gui.add_html(f"<style>{''.join(rules)}</style>")

    def show(self, snapshot: Snapshot) -> None:
        """Boxes as the view options have them."""
        self._words.show(sentence(view_words(snapshot, WITH_BOX)))
        self.cloud.value = snapshot.options.cloud
        for name, box in self.boxes.items():
            box.value = name in snapshot.options.layers


def _swatch_rule(name: str, box: viser.GuiCheckboxHandle) -> str:
    color = STAGE_COLORS.get(name)
    shown = f"border-left:9px solid {f'rgb{color}' if color else 'transparent'};padding-left:5px"
    return f"{label_of(box)}{{{shown}}}{compact(box, ROW_PX)}"
