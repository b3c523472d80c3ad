"""The Session panel: what is open, and how to keep it."""

from __future__ import annotations

from collections.abc import Callable

import viser

from verefine_viz.viewer import commands as c
from verefine_viz.viewer.drawing.markup import sentence, text
from verefine_viz.viewer.panels.widgets import Block, Send, asked_by, by_person
from verefine_viz.viewer.snapshot.snapshot import Snapshot
from verefine_viz.viewer.state.workspace import WrittenFile

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
        self.save.on_click(by_person(lambda _: send(c.SaveSession(self.name.value, waiting=waiting()))))
        self._listed: tuple[str, ...] = ()
        self.at_hand = gui.add_dropdown("Open", [CHOOSE], hint="session files in sessions/; choose one to open it")
        self.at_hand.on_update(by_person(lambda v: send(c.OpenSession(v)) if v in self._listed else None))
        self.path = gui.add_text("File", "", hint="path of a session file (.toml), or the name of one in the list")
        self.load = gui.add_button("Open session file")
        self.load.on_click(by_person(lambda _: send(c.OpenSession(self.path.value))))
        self.exports = gui.add_button_group(
            "Export", list(EXPORTS),
            hint="Downloaded by your browser too. Recording: for rerun. 3D scene: one HTML file that opens offline.",
        )  # fmt: skip

        @self.exports.on_click
        def _(event: viser.GuiEvent[viser.GuiButtonGroupHandle]) -> None:
            if event.client is not None:
                send(asked_by(event.client_id, EXPORTS[event.target.value]))

        self._kept = Block(gui)

    def show(self, snapshot: Snapshot) -> None:
        """What is open, and what was written."""
        self._words.show(sentence(opened(snapshot)))
        self._listed = snapshot.sessions
        # A browser sends nothing where the entry is chosen that the list shows, so that is never a session itself.
        options = (open_now(snapshot), *snapshot.sessions)
        if tuple(self.at_hand.options) != options:
            self.at_hand.options = options
        self.at_hand.value = options[0]
        self._kept.show("".join(written(kept, snapshot.refused) for kept in snapshot.written))


def open_now(snapshot: Snapshot) -> str:
    """What the list of sessions shows: the file that was read or written last, as in: mug.toml is open."""
    return CHOOSE if snapshot.session_file is None else f"{snapshot.session_file.name} is open"


def written(kept: WrittenFile, before: bool = False) -> str:
    """Where a file is, and what else became of it; ``before``: something was refused since, which may be another."""
    note = f'; <span class="dim">{text(kept.note)}</span>' if kept.note else ""
    return f"<p>Written{' before' if before else ''}: <code>{text(kept.path)}</code>{note}</p>"


def opened(snapshot: Snapshot) -> str:
    """What is open, and what happens on the way that no other panel shows."""
    title = snapshot.session.title or "untitled"
    built_in = f", built-in scene “{snapshot.session.scene.demo}”" if snapshot.session.scene.source == "demo" else ""
    file = f", from {snapshot.session_path}" if snapshot.session_path else f"{built_in}, not from a file"
    file = f", read from the recording {snapshot.recording}" if snapshot.recording else file
    # One of the two is as it was typed.
    if snapshot.session_file and (
        snapshot.session_path is None or snapshot.session_file != snapshot.session_path.resolve()
    ):
        file += f", written to {snapshot.session_file}"
    moved = len(snapshot.edits)
    n, n_frames = len(snapshot.problem.instances), len(snapshot.frames)
    among = f", one of {n_frames}," if n_frames > 1 else ""
    said = f"Session “{title}”{file}: frame {snapshot.frame}{among} with {n} object{'s' if n != 1 else ''}."
    if moved:
        said += f" {moved} pose{'s' if moved != 1 else ''} moved by hand."
    for change in snapshot.session.changes:
        values = (f"{section}.{key} = {v}" for section, keys in change.settings.items() for key, v in keys.items())
        said += f" After iteration {change.after_iteration}: {', '.join(values)}."
    return said
