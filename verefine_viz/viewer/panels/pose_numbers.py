"""The pose under the hand as numbers: how far it was moved and turned, to read and to type."""

from __future__ import annotations

from typing import Any, cast, get_args

import numpy as np
import viser

from verefine_viz.core.arrays import Float
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.displacement import Axes, displaced, displacement
from verefine_viz.viewer.sent_poses import SentPoses
from verefine_viz.viewer.view import View
from verefine_viz.viewer.widgets import Send, by_person

DIGITS = 2
"""Decimals that are shown; what is not typed keeps all of its own."""
FARTHEST_MM, MOST_DEG = np.full(3, 10_000.0), np.full(3, 180.0)
_NOTHING = (0.0, 0.0, 0.0)


class PoseNumbers:
    """Six numbers from where the editing began; they and the arrows in 3D follow each other."""

    def __init__(self, gui: viser.GuiApi, send: Send) -> None:
        self._send = send
        self.axes = gui.add_dropdown(
            "Axes of", get_args(Axes), visible=False,
            hint="camera: x to the right, y down, z away from it. object: those of its model, as it was",
        )  # fmt: skip
        self.axes.on_update(by_person(lambda _: self._show_numbers()))
        # No hints: they would cover the numbers.
        self.shift = gui.add_vector3("Moved mm", _NOTHING, min=-FARTHEST_MM, max=FARTHEST_MM, step=1.0, visible=False)
        self.turn = gui.add_vector3("Turned °", _NOTHING, min=-MOST_DEG, max=MOST_DEG, step=1.0, visible=False)
        for field in (self.shift, self.turn):
            field.precision = DIGITS
            field.on_update(by_person(lambda _: self._typed()))
        gui.add_html(f"<style>{_lettered(self.shift)}{_lettered(self.turn)}</style>")
        self._sent = SentPoses()
        self._from: Float | None = None
        self._to: Float | None = None

    def show(self, view: View) -> None:
        """The pose under the hand; nothing where none is."""
        look = view.look
        for widget in (self.axes, self.shift, self.turn):
            widget.visible = look.edited is not None
        self._from, self._to = look.T_cam_obj_edited_from, look.T_cam_obj_edited
        if look.edited is None:
            self._sent.clear()
        elif self._sent.is_news(look.edited):
            self._show_numbers()

    @property
    def _axes(self) -> Axes:
        return cast(Axes, self.axes.value)

    def _show_numbers(self) -> None:
        if self._from is None or self._to is None:
            return
        shift_mm, turn_deg = displacement(self._from, self._to, self._axes)
        self.shift.value, self.turn.value = _rounded(shift_mm), _rounded(turn_deg)

    def _typed(self) -> None:
        """Sends the pose that the numbers say; those that are as they were shown keep their hidden decimals."""
        if self._from is None or self._to is None:
            return
        exact = displacement(self._from, self._to, self._axes)
        shift_mm, turn_deg = (
            np.where(np.array(typed) == _rounded(before), before, typed)
            for typed, before in zip((self.shift.value, self.turn.value), exact, strict=True)
        )
        T = displaced(self._from, shift_mm, turn_deg, self._axes)
        self._to = T
        pose = tuple(float(x) for x in T.ravel())
        self._sent.add(pose)
        self._send(c.DragPose(pose))


def _lettered(handle: Any) -> str:
    """A style that writes x, y and z into the three boxes of a widget."""
    boxes = f'.mantine-Flex-root:has(label[for="{handle._impl.uuid}"]) .mantine-NumberInput-root'
    letters = "".join(f'{boxes}:nth-child({k})::before{{content:"{axis}"}}' for k, axis in enumerate("xyz", 1))
    return (
        f"{boxes}{{position:relative}}{boxes} input{{padding-left:14px!important}}"
        f"{boxes}::before{{position:absolute;z-index:1;left:5px;top:3px;font-size:11px;opacity:.65}}{letters}"
    )


def _rounded(numbers: Any) -> tuple[float, float, float]:
    x, y, z = (round(float(number), DIGITS) + 0.0 for number in numbers)
    return x, y, z
