"""The Session panel: what is open, how to save and export it."""

from __future__ import annotations

from collections.abc import Callable

import viser

from verefine_viz.viewer import commands as c
from verefine_viz.viewer.drawing.markup import sentence, text
from verefine_viz.viewer.panels.widgets import Block, Send, add_buttons, by_user
from verefine_viz.viewer.snapshot.snapshot import Snapshot
from verefine_viz.viewer.state.workspace import WrittenFile
from verefine_viz.viewer.text.display_names import counted

EXPORTS: dict[str, c.Command] = {
    "Recording": c.Export("recording"),
    "3D scene": c.Export("scene"),
    "Results CSV": c.Export("results"),
    "Maps PNG": c.Export("maps"),
    "Command log": c.Export("commands"),
}
CHOOSE = "choose a session"
"""What the list shows where the open session is in no file."""


class SessionPanel:
    """Save, load, export.

    Args:
        gui: where it is.
        send: takes what was asked for.
        waiting: what was typed as settings and is not in use, in words.
    """

    def __init__(self, gui: viser.GuiApi, send: Send, waiting: Callable[[], tuple[str, ...]]) -> None:
        self._words = Block(gui)
        self.name = gui.add_text("Name", "my_session", hint="written to sessions/NAME.toml")
        self.save = gui.add_button("Save session", hint="settings, breakpoints, changes and edited poses")
        self.save.on_click(by_user(lambda _: send(c.SaveSession(self.name.value, waiting=waiting()))))
        self._listed: tuple[str, ...] = ()
        self.at_hand = gui.add_dropdown("Open", [CHOOSE], hint="session files in sessions/; choose one to open it")
        self.at_hand.on_update(by_user(lambda v: send(c.OpenSession(v)) if v in self._listed else None))
        self.path = gui.add_text("File", "", hint="path of a session file (.toml), or the name of one in the list")
        self.load = gui.add_button("Open session file")
        self.load.on_click(by_user(lambda _: send(c.OpenSession(self.path.value))))
        hint = "Downloaded by your browser too. Recording: for rerun. 3D scene: one HTML file that opens offline."
        self.exports = add_buttons(gui, "Export", EXPORTS, send, hint)
        self._written = Block(gui)

    def show(self, snapshot: Snapshot) -> None:
        """What is open, and what was written."""
        self._words.show(sentence(opened(snapshot)))
        self._listed = snapshot.sessions
        # A browser sends nothing where the entry is chosen that the list shows, so that is never a session itself.
        options = (open_now(snapshot), *snapshot.sessions)
        if tuple(self.at_hand.options) != options:
            self.at_hand.options = options
        self.at_hand.value = options[0]
        self._written.show("".join(written(file, snapshot.refused) for file in snapshot.written))


def open_now(snapshot: Snapshot) -> str:
    """What the list of sessions shows: the file that was read or written last, as in: mug.toml is open."""
    return CHOOSE if snapshot.session_file is None else f"{snapshot.session_file.name} is open"


def written(file: WrittenFile, before: bool = False) -> str:
    """Where a file is, and what else became of it; ``before``: something was refused since, which may be another."""
    note = f'; <span class="dim">{text(file.note)}</span>' if file.note else ""
    return f"<p>Written{' before' if before else ''}: <code>{text(file.path)}</code>{note}</p>"


def opened(snapshot: Snapshot) -> str:
    """What is open, and what happens on the way that no other panel shows."""
    session, path, file = snapshot.session, snapshot.session_path, snapshot.session_file
    if snapshot.recording:
        origin = f", read from the recording {snapshot.recording}"
    elif path:
        origin = f", from {path}"
    else:
        built_in = f", built-in scene “{session.scene.demo}”" if session.scene.source == "demo" else ""
        origin = f"{built_in}, not from a file"
    if file and (path is None or file != path.resolve()):  # One of the two is as it was typed.
        origin += f", written to {file}"
    among = f", one of {len(snapshot.frames)}," if len(snapshot.frames) > 1 else ""
    objects = counted(len(snapshot.problem.instances), "object")
    words = f"Session “{session.title or 'untitled'}”{origin}: frame {snapshot.frame}{among} with {objects}."
    if snapshot.edits:
        words += f" {counted(len(snapshot.edits), 'edited pose')}."
    for change in session.changes:
        values = (f"{section}.{key} = {v}" for section, keys in change.settings.items() for key, v in keys.items())
        words += f" After iteration {change.after_iteration}: {', '.join(values)}."
    return words
