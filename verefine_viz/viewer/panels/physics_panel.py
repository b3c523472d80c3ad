"""The Physics panel: what the simulation did, whether the accepted pose is plausible, and editing a pose."""

from __future__ import annotations

from typing import Any, cast, get_args

import numpy as np
import viser

from verefine_viz.core.arrays import Float
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.drawing.markup import sentence, warning
from verefine_viz.viewer.drawing.plausibility_picture import plausibility_html
from verefine_viz.viewer.drawing.pose_tables import changes_table, contacts_table
from verefine_viz.viewer.panels.widgets import Block, Send, by_person
from verefine_viz.viewer.snapshot.snapshot import Snapshot, is_revealed
from verefine_viz.viewer.state.edited_pose import Axes, SentPoses, displaced, displacement
from verefine_viz.viewer.text.plausibility_verdict import plane_doubt
from verefine_viz.viewer.text.pose_words import edited_score
from verefine_viz.viewer.text.sentences import physics
from verefine_viz.viewer.web.viser_internals import lettered, unlabelled

# The edited pose as numbers: how far it was moved and turned, to read and to type.

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
        gui.add_html(f"<style>{lettered(self.shift)}{lettered(self.turn)}</style>")
        self._sent = SentPoses()
        self._from: Float | None = None
        self._to: Float | None = None

    def show(self, snapshot: Snapshot) -> None:
        """The edited pose; nothing where none is."""
        options = snapshot.options
        for widget in (self.axes, self.shift, self.turn):
            widget.visible = options.edited is not None
        self._from, self._to = options.T_cam_obj_edited_from, options.T_cam_obj_edited
        if options.edited is None:
            self._sent.clear()
        elif self._sent.is_news(options.edited):
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


def _rounded(numbers: Any) -> tuple[float, float, float]:
    x, y, z = (round(float(number), DIGITS) + 0.0 for number in numbers)
    return x, y, z


class PhysicsPanel:
    """Changes per stage, the simulated path with its contacts, plausibility, and moving a pose by hand."""

    def __init__(self, gui: viser.GuiApi, send: Send) -> None:
        # No hint: it would cover the numbers below while the pointer rests on a button that was pressed.
        self.edit = gui.add_button_group("By hand", ["Edit pose"])
        self.edit.on_click(by_person(lambda _: send(c.EditPose())))
        # In its place while a pose is edited: a button of a group cannot be greyed out.
        self.go_on = gui.add_button_group("By hand", ["Continue from here", "Cancel"], visible=False)
        actions = {"Continue from here": c.ForkFromPose(), "Cancel": c.EditPose(False)}
        self.go_on.on_click(by_person(lambda v: send(actions[v])))
        gui.add_html(f"<style>{unlabelled(self.edit)}{unlabelled(self.go_on)}</style>")
        self.numbers = PoseNumbers(gui, send)
        self._words = Block(gui)  # Below: while a pose is moved it changes, and must not push what moves it.
        self._standing = Block(gui)
        self._changes = Block(gui)
        self.path = gui.add_slider("Sim. pose", 0, 1, 1, 0, hint="0 = start, then one per step", visible=False)
        self.path.on_update(by_person(lambda v: send(c.ScrubPath(int(v)))))
        self.play = gui.add_button_group("Path", ["Play", "Hide"], visible=False, hint="the simulated path in 3D")
        self.play.on_click(by_person(lambda v: send(c.PlayPath() if v == "Play" else c.ScrubPath(None))))
        self._contacts = Block(gui)

    def show(self, snapshot: Snapshot) -> None:
        """The iteration that is shown; tables only where there is something to tell."""
        self.go_on.visible = snapshot.options.edited is not None
        self.edit.visible = not self.go_on.visible
        # Who moves a pose looks at what becomes of it: the words about the iteration would push that off the screen.
        self._words.show(sentence(edited_score(snapshot) or physics(snapshot)) + plane_warning(snapshot))
        if snapshot.has_plausibility:
            self._standing.show(plausibility_html(snapshot))
        self._changes.show(changes_table(snapshot))
        path = snapshot.shown.path if snapshot.shown and is_revealed(snapshot, "simulated") else None
        self.path.visible = self.play.visible = path is not None
        if path is not None:
            self.path.max = len(path.Ts_cam_obj) - 1
            pose = snapshot.options.path_pose
            self.path.value = int(self.path.max) if pose is None else min(pose, int(self.path.max))
        self._contacts.show(contacts_table(snapshot) if path is not None else "")
        self.numbers.show(snapshot)


def plane_warning(snapshot: Snapshot) -> str:
    """A box where the plane that everything rests on is doubtful."""
    support = snapshot.target.observation.support
    said = plane_doubt(support) if support is not None else ""
    return warning(said) if said else ""
