"""The Physics panel: what the simulation did, and whether the kept pose could stand like that."""

from __future__ import annotations

import viser

from verefine_viz.viewer import commands as c
from verefine_viz.viewer.edited_words import edited_score
from verefine_viz.viewer.markup import sentence, warning
from verefine_viz.viewer.panels.pose_numbers import PoseNumbers
from verefine_viz.viewer.plane import doubt
from verefine_viz.viewer.revealing import is_revealed
from verefine_viz.viewer.standing import standing_html
from verefine_viz.viewer.tables import changes_table, contacts_table
from verefine_viz.viewer.view import View
from verefine_viz.viewer.widgets import Block, Send, by_person, unlabelled
from verefine_viz.viewer.words import physics


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

    def show(self, view: View) -> None:
        """The iteration that is shown; tables only where there is something to tell."""
        self.go_on.visible = view.look.edited is not None
        self.edit.visible = not self.go_on.visible
        # Who moves a pose looks at what becomes of it: the words about the iteration would push that off the screen.
        self._words.show(sentence(edited_score(view) or physics(view)) + plane_warning(view))
        if view.has_judged_standing:
            self._standing.show(standing_html(view))
        self._changes.show(changes_table(view))
        path = view.shown.path if view.shown and is_revealed(view, "simulated") else None
        self.path.visible = self.play.visible = path is not None
        if path is not None:
            self.path.max = len(path.Ts_cam_obj) - 1
            pose = view.look.path_pose
            self.path.value = int(self.path.max) if pose is None else min(pose, int(self.path.max))
        self._contacts.show(contacts_table(view) if path is not None else "")
        self.numbers.show(view)


def plane_warning(view: View) -> str:
    """A box where the plane that everything rests on is doubtful."""
    support = view.target.observation.support
    said = doubt(support) if support is not None else ""
    return warning(said) if said else ""
