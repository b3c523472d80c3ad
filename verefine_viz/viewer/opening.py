"""Carries out the commands that open something: a frame, a scene, a session, a recording, or a run from its start."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from verefine_viz.core.errors import InputError, SettingsError, unknown
from verefine_viz.core.places import at_home
from verefine_viz.core.settings import Session
from verefine_viz.session.files import load_session
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.command import Command
from verefine_viz.viewer.estimating import estimated
from verefine_viz.viewer.side_commands import OpenRecording

if TYPE_CHECKING:
    from verefine_viz.viewer.debugger import Debugger


class Opening:
    """What the debugger can open.

    Args:
        debugger: whose workspace it is opened in.
        sessions: lists the session files at hand.
    """

    def __init__(self, debugger: Debugger, sessions: Callable[[], tuple[str, ...]]) -> None:
        self._debugger, self._list_sessions = debugger, sessions

    def do(self, command: Command) -> bool:
        """Carries out a command that opens something; False where it does not."""
        debugger, workspace = self._debugger, self._debugger.workspace
        match command:
            case c.OpenAt(_, iteration):
                debugger.browsing.enter(command)
                run = workspace.run
                run.seek(min(max(iteration, 0), run.length))
                debugger.running.goal = iteration if iteration > run.length and not run.is_done else None
                debugger.look = debugger.browsing.look(debugger.look.afresh(), command)
                return True
            case c.Restart(changes):
                before, saved = workspace.session, [path for path, saved in workspace.files.items() if saved.repeats]
                workspace.restart(changes)
                debugger.message = not_repeated(before, workspace.session, saved[-1] if saved else None)
            case c.Estimate(instance_id, estimator):
                debugger.message = estimated(workspace, instance_id, estimator)
                debugger.look = replace(debugger.look.afresh(), focus=instance_id)
                return True
            case c.OpenFrame(frame):
                workspace.open_frame(frame)
            case c.OpenDemo(name):
                self._open_demo(name)
            case OpenRecording(path):
                workspace.open_recording(at_home(path))
            case c.OpenSession(path):
                self._open_session(path)
            case _:
                return False
        debugger.look = debugger.look.afresh()
        return True

    def _open_session(self, path: str) -> None:
        if not path.strip():
            raise InputError("no session file is named: type the path of one (.toml) beside “File”")
        file = self._found(path)
        self._debugger.workspace.open(load_session(file), file)
        self._debugger.message = f"Opened {file}."

    def _found(self, typed: str) -> Path:
        """The file of a path; where there is none, that of a listed session called so, with or without its ending."""
        path = at_home(typed)
        is_there = os.path.exists(path)  # noqa: PTH110 (without an error where a name is too long)
        listed = () if is_there else map(Path, self._list_sessions())
        return next((session for session in listed if typed in (session.name, session.stem)), path)

    def _open_demo(self, name: str) -> None:
        """A built-in scene: with the settings of the session file of its name, or else with the open ones."""
        demos, workspace = self._debugger.demos, self._debugger.workspace
        if name not in demos:
            raise SettingsError(unknown("built-in scene", name, demos))
        own = next((Path(p) for p in self._list_sessions() if Path(p).stem == name), None)
        if own is not None:
            session = load_session(own)
            if (session.scene.source, session.scene.demo) == ("demo", name):
                workspace.open(session, own)
                self._debugger.message = f"Opened {own} with its settings."
                return
        old = workspace.tools.session
        scene = old.scene.model_copy(update={"source": "demo", "demo": name, "frames": (), "objects": ()})
        hypotheses = old.hypotheses.model_copy(update={"source": "perturb", "files": (), "estimate": ()})
        update = {"scene": scene, "hypotheses": hypotheses, "title": name, "edits": (), "changes": ()}
        workspace.open(old.model_copy(update=update), None)


def not_repeated(before: Session, after: Session, path: Path | None) -> str:
    """What a restart leaves behind of a run, in words; "" = nothing.

    Args:
        before: what a session file would have had to say to repeat the run.
        after: what it has to say now; what was moved in other frames may still be there.
        path: a file of the open session that has poses moved or settings changed on the way; None = there is none.
    """
    said = []
    if any(change.after_iteration > 0 for change in before.changes):
        said.append("The settings changed on the way now hold from iteration 1 on.")
    n = sum(edit not in after.edits for edit in before.edits)
    if n:
        said.append(f"{n} pose{'s' if n > 1 else ''} moved by hand {'are' if n > 1 else 'is'} not moved again.")
    if said and path is not None:
        said.append(f"To repeat them open {path}.")
    return " ".join(said)
