"""What the panels are built from: HTML blocks, groups of buttons and charts that change in place."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np
import viser
from viser import uplot

from verefine_viz.core.palette import RGB
from verefine_viz.viewer.commands import Command, Export, MoveCamera
from verefine_viz.viewer.drawing.markup import block

Send = Callable[[Command], None]


class Block:
    """An HTML widget; sends only what changed."""

    def __init__(self, gui: viser.GuiApi, css_class: str = "") -> None:
        self._class = css_class
        self._handle = gui.add_html(block("", css_class))

    def show(self, content: str) -> None:
        """Replaces the content."""
        self._handle.content = block(content, self._class)


def add_style(gui: viser.GuiApi, *rules: str) -> None:
    """Style rules, such as those of :mod:`verefine_viz.viewer.web.viser_internals`."""
    gui.add_html(f"<style>{''.join(rules)}</style>")


def by_user(handler: Callable[[Any], None]) -> Callable[[viser.GuiEvent[Any]], None]:
    """A callback that runs for the user's change only: viser also calls it for the program's own."""

    def on_update(event: viser.GuiEvent[Any]) -> None:
        if event.client is not None:
            handler(event.target.value)

    return on_update


def asked_by(client_id: int | None, command: Command) -> Command:
    """The command as it comes from one browser: exports and moves of the camera know which, else it is for all."""
    return replace(command, client=client_id) if isinstance(command, Export | MoveCamera) else command


def add_buttons(
    gui: viser.GuiApi,
    label: str,
    commands: Mapping[str, Command],
    send: Send,
    hint: str | None = None,
    visible: bool = True,
) -> viser.GuiButtonGroupHandle:
    """A row of buttons, each of which sends its command."""
    group = gui.add_button_group(label, list(commands), visible=visible, hint=hint)

    @group.on_click
    def _(event: viser.GuiEvent[Any]) -> None:
        if event.client is not None:
            send(asked_by(event.client_id, commands[event.target.value]))

    return group


@dataclass(frozen=True, eq=False)
class Line:
    """One curve."""

    label: str
    color: RGB
    values: Sequence[float]
    width: float = 2.0
    in_legend: bool = True
    dashed: bool = False


WHOLE_NUMBERS = cast(uplot.Axis, {"size": 26, "space": 36, "incrs": [n * 10**k for k in range(6) for n in (1, 2, 5)]})
"""An axis of iterations: no 2.5 between 2 and 3. The library's type does not know ``incrs``, the page does."""


class Chart:
    """Curves over the iterations; made again only when the set of curves changes."""

    def __init__(self, gui: viser.GuiApi, height: int, container: Any):
        self._gui, self._height, self._container = gui, height, container
        self._handle: viser.GuiUplotHandle | None = None
        self._shape: tuple[Any, ...] = ()

    def show(self, x: Sequence[float], lines: Sequence[Line]) -> None:
        """Draws the curves; an empty list hides the chart."""
        if not lines or len(x) == 0:
            if self._handle is not None:
                self._handle.visible = False
            return
        highest = max((abs(v) for line in lines for v in line.values), default=0.0)
        labels_px = 48 if highest < 10_000 else 66
        # The page would draw an axis up to 100 for curves that are all 0. Above 1 its number needs room.
        y_range = (0.0, 1.05) if highest == 0 else None
        shape = (labels_px, y_range, *((line.label, line.color, line.width) for line in lines))
        if shape != self._shape and self._handle is not None:
            self._handle.remove()
            self._handle = None
        self._shape = shape
        columns = [list(x), *(list(line.values) for line in lines)]
        if len(x) == 1:  # A line needs two points to be seen.
            columns = [[x[0], x[0] + 1], *([line.values[0]] * 2 for line in lines)]
        data = tuple(np.array(column, np.float64) for column in columns)
        if self._handle is None:
            self._handle = self._make(data, lines, labels_px, y_range)
        else:
            self._handle.data = data
            self._handle.visible = True

    def _make(
        self, data: tuple[np.ndarray, ...], lines: Sequence[Line], labels_px: int, y_range: tuple[float, float] | None
    ) -> viser.GuiUplotHandle:
        series = [uplot.Series(label="iteration")]
        series += [
            uplot.Series(
                label=line.label, stroke=f"rgb{line.color}", width=line.width, points={"show": False},
                dash=(7, 5) if line.dashed else (),
            )
            for line in lines
        ]  # fmt: skip
        scales = {"x": uplot.Scale(time=False)}
        if y_range is not None:
            scales["y"] = uplot.Scale(auto=False, range=y_range)
        with self._container:
            return self._gui.add_uplot(
                data, tuple(series), scales=scales, height=self._height, legend=uplot.Legend(show=False),
                axes=(WHOLE_NUMBERS, uplot.Axis(size=labels_px)), padding=(9, 14, 0, 0),
            )  # fmt: skip
