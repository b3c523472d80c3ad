"""Breakpoints: when a running method stops and waits."""

from __future__ import annotations

from typing import Any

import viser

from verefine_viz.core.settings import BreakpointSettings
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.view import View
from verefine_viz.viewer.widgets import Send, by_person

BREAK_IF: dict[str, tuple[str, Any, str]] = {
    "score_falls_by": ("fell by 0.02", 0.02, "the kept pose scores lower than before by more than this"),
    "simulated_rejected": (
        "sim. rejected",
        True,
        "the refined pose was kept instead of the simulated one: the usual case",
    ),
    "refined_rejected": ("ref. rejected", True, "the simulated pose was kept instead of the refined one"),
    "jump_mm": ("moved 10 mm", 10.0, "the kept pose moved further than this [mm]"),
    "jump_deg": ("turned 10°", 10.0, "the kept pose turned further than this [°]"),
    "arm_switched": ("arm switched", True, "the bandit chose another hypothesis than before"),
    "unstable": ("unstable", True, "the simulation turned the object by more than 10°"),
    "empty_render": ("empty render", True, "a pose rendered to nothing, or its score was not a number"),
    "error_grows_by_mm": ("error +2 mm", 2.0, "ADD(-S) against ground truth grew by more than this [mm]"),
}
"""Field: (label that fits on one line, value when it is switched on, meaning)."""


class BreakpointsPanel:
    """A box per reason to stop."""

    def __init__(self, gui: viser.GuiApi, send: Send) -> None:
        self._boxes: dict[str, viser.GuiCheckboxHandle] = {}
        for name, (label, _, meaning) in BREAK_IF.items():
            box = gui.add_checkbox(label, False, hint=f"stop when {meaning}")
            box.on_update(by_person(lambda on, name=name: send(c.SetBreakpoints(((name, _value(name, on)),)))))
            self._boxes[name] = box

    def show(self, view: View) -> None:
        """Boxes as the breakpoints are set."""
        for name, box in self._boxes.items():
            box.value = getattr(view.session.breakpoints, name) not in (None, False)


def _value(name: str, on: bool) -> Any:
    return BREAK_IF[name][1] if on else BreakpointSettings.model_fields[name].default
