"""Breakpoints: when a running method stops and waits."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import viser

from verefine_viz.session.breakpoints import LABELS, UNITS, is_number, number_of
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.drawing.markup import sentence
from verefine_viz.viewer.panels.widgets import Block, Send, by_person
from verefine_viz.viewer.snapshot.snapshot import Snapshot
from verefine_viz.viewer.text.sentences import breakpoint_words
from verefine_viz.viewer.web.viser_internals import beside_the_box, compact


@dataclass(frozen=True)
class Threshold:
    """A breakpoint with a number."""

    at_first: float
    """The number that is offered where the session has none."""
    step: float
    """Of the arrows beside the number."""
    meaning: str


THRESHOLDS = {
    "score_falls_by": Threshold(0.02, 0.01, "the accepted pose scores lower than the one before by more than"),
    "jump_mm": Threshold(10.0, 1.0, "the accepted pose lies further from the one before than"),
    "jump_deg": Threshold(10.0, 1.0, "the accepted pose is turned against the one before by more than"),
    "error_grows_by_mm": Threshold(2.0, 1.0, "ADD(-S) against ground truth grew by more than"),
}
FLAGS = {
    "simulated_rejected": (
        "sim. rejected",
        "the refined pose was accepted, not the simulated one, by however little: the usual case; see physics worse",
    ),
    "refined_rejected": ("ref. rejected", "the simulated pose was accepted instead of the refined one"),
    "arm_switched": ("arm switched", "the bandit chose another hypothesis than before"),
    "unstable": ("unstable", "after the simulation the object would tip: its centre of mass is outside its support"),
    "physics_worse": (
        "physics worse",
        "the simulated pose scores at least 0.2 less than the pose it began with; the timeline marks the first of each "
        "object",
    ),
    "empty_render": ("empty render", "a pose rendered to nothing, or its score was not a number"),
}
"""Field: (label that fits on one line, meaning)."""
ROW_PX = 25
NUMBER_FROM_PX = 140
"""Where the numbers begin: behind the boxes, in the same rows."""


class BreakpointsPanel:
    """A box per reason to stop; with a number where it is a matter of how much."""

    def __init__(self, gui: viser.GuiApi, send: Send) -> None:
        self._words = Block(gui, "brief tight")
        self.boxes: dict[str, viser.GuiCheckboxHandle] = {}
        self.numbers: dict[str, viser.GuiNumberHandle[float]] = {}
        self._seen: dict[str, float] = {}
        self._typed: dict[str, list[float]] = {name: [] for name in THRESHOLDS}
        """Numbers that were sent and not yet seen in the settings, the oldest first."""
        self._send = send
        for name, threshold in THRESHOLDS.items():
            self._add_threshold(gui, name, threshold)
        for name, (label, meaning) in FLAGS.items():
            box = gui.add_checkbox(label, False, hint=f"stop when {meaning}")
            box.on_update(by_person(lambda on, name=name: self._set(name, on)))
            self.boxes[name] = box
        rows = "".join(compact(row, ROW_PX) for row in (*self.boxes.values(), *self.numbers.values()))
        rows += "".join(beside_the_box(number, ROW_PX, NUMBER_FROM_PX) for number in self.numbers.values())
        gui.add_html(f"<style>{rows}</style>")

    def show(self, snapshot: Snapshot) -> None:
        """Boxes and numbers as the breakpoints are set."""
        self._words.show(sentence(breakpoint_words(snapshot.session.breakpoints)))
        for name, box in self.boxes.items():
            box.value = getattr(snapshot.session.breakpoints, name) not in (None, False)
        for name, threshold in THRESHOLDS.items():
            held = number_of(snapshot.session.breakpoints, name)
            value = threshold.at_first if held is None else held
            if value != self._seen.get(name):
                self._seen[name] = value
                self._show_number(name, value)
            elif self._typed[name][-1:] == [value]:  # Back at what it was: nothing more is on its way.
                self._typed[name].clear()

    def _add_threshold(self, gui: viser.GuiApi, name: str, t: Threshold) -> None:
        box = gui.add_checkbox("", False, hint=f"stop when {t.meaning} this{_in_words(name)}")
        number = gui.add_number(f"threshold: {LABELS[name]}", t.at_first, step=t.step)
        number.precision = 6  # Numbers of a session file are shown as they are.
        self.boxes[name], self.numbers[name] = box, number
        self._label(name)
        box.on_update(by_person(lambda on: self._switched(name, on)))
        number.on_update(by_person(lambda value: self._typed_in(name, value)))

    def _switched(self, name: str, on: bool) -> None:
        number = self.numbers[name].value
        if on:
            self._typed[name].append(number)
        self._set(name, number if on else None)

    def _typed_in(self, name: str, value: float) -> None:
        """Sets the threshold; where it is off, the number that waits for it."""
        if is_number(name, value):
            self._typed[name].append(value)
        else:  # It will be refused with a word; the number goes back to what holds.
            self.numbers[name].value = self._seen.get(name, THRESHOLDS[name].at_first)
        self._set(name if self.boxes[name].value else f"waiting.{name}", value)

    def _show_number(self, name: str, value: float) -> None:
        typed = self._typed[name]
        if value in typed:  # Another one may be typed already, which must not be overwritten.
            del typed[: typed.index(value) + 1]
        else:
            typed.clear()
            self.numbers[name].value = value
        self._label(name)

    def _label(self, name: str) -> None:
        label = LABELS[name] if LABELS[name].endswith(("+", "−")) else f"{LABELS[name]} "
        self.boxes[name].label = f"{label}{self.numbers[name].value:g}{UNITS[name]}"

    def _set(self, name: str, value: Any) -> None:
        self._send(c.SetBreakpoints(((name, value),)))


def _in_words(name: str) -> str:
    return f", in {UNITS[name].strip()}" if UNITS[name] else ""
