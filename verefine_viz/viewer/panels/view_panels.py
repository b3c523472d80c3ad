"""The View panel, what is drawn in 3D; and the Breakpoints panel, when a running method stops and waits."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import viser

from verefine_viz.core.palette import STAGE_COLORS
from verefine_viz.run.breakpoints import LABELS, UNITS, is_number, number_of
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.drawing.markup import sentence
from verefine_viz.viewer.panels.widgets import Block, Send, add_style, by_user
from verefine_viz.viewer.snapshot.snapshot import Snapshot
from verefine_viz.viewer.state.view_options import LAYERS, SHOWN_AT_FIRST, STAGES, stage_label
from verefine_viz.viewer.text.display_names import STAGE_MEANINGS
from verefine_viz.viewer.web.viser_internals import beside_the_box, compact, label_of, side_by_side

WITH_BOX = tuple(name for name in LAYERS if name not in ("path", "flipped", "edited", "runner-up"))
ROWS = tuple(
    zip((n for n in WITH_BOX if n in STAGES), (n for n in WITH_BOX if n not in STAGES), strict=True),
)
"""Poses on the left, all else on the right."""
HINTS = STAGE_MEANINGS | {
    "hypotheses": "where each hypothesis stands; click one for its history",
    "camera image": "the photo with a score map on it, before the sensor; click for a pixel's numbers",
}
LAYER_PX, LABEL_PX, RIGHT_FROM_PX = 20, 92, 124
"""Height of a row, width of a label, and where the right column begins."""


class ViewPanel:
    """A box per layer, whose labels carry the colours so that it is the legend as well, and the cloud's colours."""

    def __init__(self, gui: viser.GuiApi, send: Send) -> None:
        self.boxes: dict[str, viser.GuiCheckboxHandle] = {}
        self._words = Block(gui, "brief tight")
        self.cloud = gui.add_dropdown(
            "Cloud",
            ("colour", "residual", "class", "error"),
            hint="of B: observed − rendered depth; class of each pixel; distance to the posed model (C switches)",
        )
        self.cloud.on_update(by_user(lambda v: send(c.ColorCloud(v))))
        self.cut = gui.add_slider("Cut %", 0, 100, 1, 0, hint="cuts the object in focus open, on your side")
        # Only it says what is cut, so it is never behind.
        self.cut.on_update(by_user(lambda v: send(c.CutView(int(v)))))
        for name in (name for row in ROWS for name in row):
            label = "photo" if name == "camera image" else stage_label(name)
            box = gui.add_checkbox(label, name in SHOWN_AT_FIRST, hint=HINTS.get(name))
            box.on_update(by_user(lambda on, name=name: send(c.ShowLayer(name, on))))
            self.boxes[name] = box
        self._faint = Block(gui, "tight")
        rules = [_swatch_rule(name, box) for name, box in self.boxes.items()]
        for left, right in ROWS:
            rules.append(side_by_side(self.boxes[left], self.boxes[right], LAYER_PX, RIGHT_FROM_PX, LABEL_PX))
        add_style(gui, *rules)

    def show(self, snapshot: Snapshot) -> None:
        """Boxes as the view options have them."""
        self._words.show(sentence(view_words(snapshot)))
        self.cloud.value = snapshot.options.cloud
        for name, box in self.boxes.items():
            box.value = name in snapshot.options.layers
        faint = [box for name, box in self.boxes.items() if name in STAGES and name not in snapshot.poses]
        self._faint.show(f"<style>{''.join(f'{label_of(box)}{{opacity:.4}}' for box in faint)}</style>")


def _swatch_rule(name: str, box: viser.GuiCheckboxHandle) -> str:
    color = STAGE_COLORS.get(name)
    bar = f"border-left:9px solid {f'rgb{color}' if color else 'transparent'};padding-left:5px;white-space:nowrap"
    return f"{label_of(box)}{{{bar}}}{compact(box, LAYER_PX)}"


def view_words(snapshot: Snapshot) -> str:
    """What the boxes do not say: whose poses are drawn, and what the cloud's colours are of."""
    layers, of = snapshot.options.layers, snapshot.b.pose.label if snapshot.b is not None else "B"
    sentences = ["A solid, B as an outline."] if snapshot.comparison is not None else []
    if "cloud" in layers and snapshot.options.cloud != "colour":
        colors = {
            "residual": "observed − rendered depth",
            "class": "class of each pixel",
            "error": "distance to the model",
        }[snapshot.options.cloud]
        sentences.append(f"Cloud: {colors}, {of}.")
    return " ".join(sentences)


# Breakpoints.


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
    "arm_switched": ("switched", "the bandit chose another hypothesis than before"),
    "unstable": ("unstable", "after the simulation the object would tip: its centre of mass is outside its support"),
    "physics_worse": (
        "physics worse",
        "the simulated pose scores at least 0.2 less than the pose it began with; the timeline marks the first of each "
        "object",
    ),
    "empty_render": ("empty render", "a pose rendered to nothing, or its score was not a number"),
}
"""Field: (label that fits on one line, meaning)."""
BREAKPOINT_PX, NUMBER_FROM_PX = 25, 140
"""Height of a row, and where the numbers begin: behind the boxes, in the same rows."""


class BreakpointsPanel:
    """A box per reason to stop; with a number where it is a matter of how much."""

    def __init__(self, gui: viser.GuiApi, send: Send) -> None:
        self.boxes: dict[str, viser.GuiCheckboxHandle] = {}
        self.numbers: dict[str, viser.GuiNumberHandle[float]] = {}
        self._seen: dict[str, float] = {}
        self._typed: dict[str, list[float]] = {name: [] for name in THRESHOLDS}
        """Numbers that were sent and not yet seen in the settings, the oldest first."""
        self._send = send
        for name, threshold in THRESHOLDS.items():
            self._add_threshold(gui, name, threshold)
        for name, (label, meaning) in FLAGS.items():
            box = gui.add_checkbox(label, False, hint=f"a run stops when {meaning}")
            box.on_update(by_user(lambda on, name=name: self._set(name, on)))
            self.boxes[name] = box
        rules = [compact(row, BREAKPOINT_PX) for row in (*self.boxes.values(), *self.numbers.values())]
        rules += [beside_the_box(number, BREAKPOINT_PX, NUMBER_FROM_PX) for number in self.numbers.values()]
        add_style(gui, *rules)

    def show(self, snapshot: Snapshot) -> None:
        """Boxes and numbers as the breakpoints are set."""
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
        unit = f", in {UNITS[name].strip()}" if UNITS[name] else ""
        box = gui.add_checkbox("", False, hint=f"stop when {t.meaning} this{unit}")
        number = gui.add_number(f"threshold: {LABELS[name]}", t.at_first, step=t.step)
        number.precision = 6  # Numbers of a session file are shown as they are.
        self.boxes[name], self.numbers[name] = box, number
        self._label(name)
        box.on_update(by_user(lambda on: self._switched(name, on)))
        number.on_update(by_user(lambda value: self._typed_in(name, value)))

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
