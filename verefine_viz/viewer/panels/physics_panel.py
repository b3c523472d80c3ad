"""The Physics panel: what the simulation did, whether the accepted pose is plausible, and editing a pose."""

from __future__ import annotations

from typing import Any, cast, get_args

import numpy as np
import viser

from verefine_viz.core.arrays import Float
from verefine_viz.core.surroundings import UnknownObject
from verefine_viz.diagnosis.data_doubts import plane_doubt
from verefine_viz.pictures.surroundings_meshes import DROPPED_COLOR, UNKNOWN_COLOR
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.drawing.markup import link, sentence, swatch, warning
from verefine_viz.viewer.drawing.plausibility_picture import plausibility_html
from verefine_viz.viewer.drawing.pose_tables import changes_table, contacts_table
from verefine_viz.viewer.panels.widgets import Block, Send, add_buttons, add_style, by_user
from verefine_viz.viewer.snapshot.snapshot import Snapshot, is_revealed
from verefine_viz.viewer.state.edited_pose import Axes, SentPoses, displaced, displacement
from verefine_viz.viewer.text.display_names import counted, method_name
from verefine_viz.viewer.text.plausibility_verdict import gravity_doubt
from verefine_viz.viewer.text.pose_words import beside_answer, edited_score, turn
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
        self.axes.on_update(by_user(lambda _: self._show_numbers()))
        # No hints: they would cover the numbers.
        self.shift = gui.add_vector3("Moved mm", _NOTHING, min=-FARTHEST_MM, max=FARTHEST_MM, step=1.0, visible=False)
        self.turn = gui.add_vector3("Turned °", _NOTHING, min=-MOST_DEG, max=MOST_DEG, step=1.0, visible=False)
        for field in (self.shift, self.turn):
            field.precision = DIGITS
            field.on_update(by_user(lambda _: self._typed()))
        add_style(gui, lettered(self.shift), lettered(self.turn))
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
    """Changes per stage, the simulated path with its contacts, plausibility, and editing a pose."""

    def __init__(self, gui: viser.GuiApi, send: Send) -> None:
        # No hint: it would cover the numbers below while the pointer rests on a button that was pressed.
        self.edit = add_buttons(gui, "Edit", {"Edit pose": c.EditPose()}, send)
        # In its place while a pose is edited: a button of a group cannot be greyed out.
        actions = {"Continue from here": c.ForkFromPose(), "Cancel": c.EditPose(False)}
        self.go_on = add_buttons(gui, "Edit", actions, send, visible=False)
        add_style(gui, unlabelled(self.edit), unlabelled(self.go_on))
        self.numbers = PoseNumbers(gui, send)
        self._words = Block(gui)  # Below: while a pose is edited it changes, and must not push the numbers away.
        self._plausibility = Block(gui)
        self._changes = Block(gui)
        self.path = gui.add_slider("Sim. pose", 0, 1, 1, 0, hint="0 = start, then one per step", visible=False)
        self.path.on_update(by_user(lambda v: send(c.ScrubPath(int(v)))))
        played = {"Play": c.PlayPath(), "Hide": c.ScrubPath(None)}
        self.play = add_buttons(gui, "Path", played, send, "the simulated path in 3D", visible=False)
        self._contacts = Block(gui)
        self._surroundings = Block(gui)

    def show(self, snapshot: Snapshot) -> None:
        """The iteration that is shown; tables only where there is something to show."""
        self.go_on.visible = snapshot.options.edited is not None
        self.edit.visible = not self.go_on.visible
        # While a pose is edited its numbers alone: words about the iteration would push them off the screen.
        self._words.show(sentence(edited_score(snapshot) or physics_words(snapshot)) + plane_warning(snapshot))
        if snapshot.has_plausibility:
            self._plausibility.show(plausibility_html(snapshot))
        self._changes.show(changes_table(snapshot))
        path = snapshot.shown.path if snapshot.shown and is_revealed(snapshot, "simulated") else None
        self.path.visible = self.play.visible = path is not None
        if path is not None:
            self.path.max = len(path.Ts_cam_obj) - 1
            pose = snapshot.options.path_pose
            self.path.value = int(self.path.max) if pose is None else min(pose, int(self.path.max))
        self._contacts.show(contacts_table(snapshot) if path is not None else "")
        self._surroundings.show(surroundings_html(snapshot))
        self.numbers.show(snapshot)


def surroundings_html(snapshot: Snapshot) -> str:
    """What supports and stops the objects, its unknown objects with links to drop or restore each, and the way to the
    other world.
    """
    support, physics = snapshot.problem.observation.support, snapshot.session.physics
    if support is None or not physics.enabled or snapshot.options.edited is not None:
        return ""
    around = support.surroundings
    if around is None:
        see = c.Restart((("physics.support", "observed"),))
        act = link("use what the depth image shows", see, "shelves, walls, things without a model; restarts the run")
        return f'<p class="dim">Supported by a plane alone: {act}</p>'
    n_solids = len(around.solids) - len(around.surfaces)
    n_surfaces = len(around.supporting) - around.catches
    what = f"{counted(n_surfaces, 'surface')} and {counted(n_solids, 'other solid')}"
    source = "The depth image" if around.source == "observed" else "The mesh"
    back = link("use the plane alone", c.Restart((("physics.support", "plane"),)), "restarts the run")
    rows = "".join(_unknown_object(one) for one in around.unknown)
    return f'<p class="dim">{source} shows {what}. {back}</p>{rows}'


def _unknown_object(one: UnknownObject) -> str:
    x, y, z = np.sort(np.ptp(one.model.vertices, axis=0) * 1e3)[::-1]
    act = (
        link("restore", c.DropUnknown(one.number, False), "let it stop objects again (restarts the run)")
        if one.is_dropped
        else link("drop", c.DropUnknown(one.number), "let it stop nothing (restarts the run)")
    )
    color = DROPPED_COLOR if one.is_dropped else UNKNOWN_COLOR
    state = ", dropped" if one.is_dropped else ""
    return f"<p>{swatch(color)}unknown object {one.number}, {x:.0f} × {y:.0f} × {z:.0f} mm{state} {act}</p>"


def physics_words(snapshot: Snapshot) -> str:
    """Why nothing was simulated; else what the table of changes does not say of the simulation."""
    shown, observation = snapshot.shown, snapshot.target.observation
    if observation.support is None:
        return f"No physics: {observation.support_note or 'no support plane was found'}"
    if not snapshot.session.physics.enabled:
        return "Physics is off in the settings."
    if shown is None:
        return "No simulation yet."
    simulated = shown.stage("simulated")
    if simulated is not None and not is_revealed(snapshot, "simulated"):
        return "Not simulated yet: next stage."
    if simulated is None or shown.path is None:
        return f"{method_name(snapshot.session.method.name)} did not simulate in iteration {shown.index}."
    refined = shown.stage("refined") if is_revealed(snapshot, "refined") else None
    words = beside_answer(snapshot)
    if refined is not None:
        start = shown.stages[0].T_cam_obj
        left_deg, turned_deg = turn(start, refined.T_cam_obj)[0], turn(start, simulated.T_cam_obj)[0]
        if turned_deg > 2 and left_deg < turned_deg / 2:
            words += f"The refiner left {left_deg:.1f}° of the simulation's turn."
    return words


def plane_warning(snapshot: Snapshot) -> str:
    """A box where the plane that everything rests on is doubtful."""
    support = snapshot.target.observation.support
    doubts = (plane_doubt(support), gravity_doubt(support)) if support is not None else ()
    return "".join(warning(doubt) for doubt in doubts if doubt)
