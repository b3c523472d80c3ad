"""Opens a frame, a scene, a session, a recording, or a run from its start."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

from verefine_viz.core.errors import InputError, SettingsError, unknown
from verefine_viz.core.paths import at_home
from verefine_viz.core.settings import Session
from verefine_viz.scenes.hypothesis_pool import asked_estimators
from verefine_viz.session.files import load_session
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.comparison_commands import OpenRecording
from verefine_viz.viewer.handlers.reordering import as_restart
from verefine_viz.viewer.snapshot.scene_state import labels_of
from verefine_viz.viewer.state.state import State
from verefine_viz.viewer.state.workspace import Workspace

# New initial poses for one object of the open frame, and what the page says of them.

SOURCES = {"results": "the results files", "perturb": "the disturbed ground truth"}
"""What the page calls where initial poses come from; estimators have their names."""


def estimated(space: Workspace, instance_id: int, estimator: str) -> str:
    """Opens a branch whose initial poses of one object come from ``estimator``, and says in words what that changes.

    Args:
        space: what is open.
        instance_id: of the object.
        estimator: its name; "session" = back to where the session's other initial poses come from.

    Raises:
        VerefineError: the frame has no such instance, it has the session's poses already, or it cannot be read again;
            everything is as before.
        Cancelled: it is no longer wanted; everything is as before.
    """
    labels = labels_of(space.work.problem)
    if instance_id not in labels:
        raise InputError(unknown("instance", instance_id, list(labels)))
    label, before, source = labels[instance_id], space.branch.name, source_of(space, instance_id)
    had = bool(space.work.problem.target(instance_id).instance.hypotheses)
    others, h = space.has_other_frames, space.branch.tools.session.hypotheses
    now = h.source if estimator == "session" else estimator
    if estimator == "session" and (space.frame, instance_id) not in asked_estimators(h):
        raise InputError(
            f"{label} in frame {space.frame} already has the session's initial poses, {_of(now)}; to estimate others, "
            "choose ppf or pcs"
        )
    space.estimate(instance_id, estimator, f"{label} from {SOURCES.get(now, now)}")
    n = next(len(i.hypotheses) for i in space.work.problem.instances if i.instance_id == instance_id)
    said = f"{label} in frame {space.frame} now has {n} initial pose{'s' if n != 1 else ''} {_of(now)}"
    if source != now and had:
        said += f", instead of those {_of(source)}"
    restarts = ", but their runs start again" if others else ""
    return (
        f"{said}. Other objects and frames keep theirs{restarts}. "
        f"The way back: the run before is still there as the branch “{before}”, in the table below."
    )


def _of(source: str) -> str:
    """As in: from the results files, by ppf."""
    return f"from {SOURCES[source]}" if source in SOURCES else f"by {source}"


def source_of(space: Workspace, instance_id: int) -> str:
    """Where the initial poses of an object of the open branch come from."""
    h = space.branch.tools.session.hypotheses
    return asked_estimators(h).get((space.frame, instance_id), h.source)


def restart(state: State, command: c.Restart) -> None:
    """Back to before iteration 1, with changed settings if any are given."""
    workspace = state.workspace
    before, saved = workspace.session, [path for path, saved in workspace.files.items() if saved.repeats]
    workspace.restart(command.changes)
    state.message = not_repeated(before, workspace.session, saved[-1] if saved else None)
    state.options = state.options.afresh()


def reorder(state: State, command: c.CutDependency | c.MoveInOrder | c.ResetOrder) -> None:
    """Restarts with another order of the objects."""
    settings = state.workspace.branch.tools.session.dependency
    restart(state, as_restart(command, state.workspace.work.problem, settings))


def estimate(state: State, command: c.Estimate) -> None:
    """New initial poses for one object, as a new branch."""
    state.message = estimated(state.workspace, command.instance_id, command.estimator)
    state.options = replace(state.options.afresh(), focus=command.instance_id)


def open_frame(state: State, command: c.OpenFrame) -> None:
    """Another frame of the session."""
    state.workspace.open_frame(command.frame)
    state.options = state.options.afresh()


def open_recording(state: State, command: OpenRecording) -> None:
    """A recording as the open run."""
    state.workspace.open_recording(at_home(command.path))
    state.options = state.options.afresh()


def open_session(state: State, command: c.OpenSession) -> None:
    """A session file: by its path, or where there is none, a listed one by its name with or without its ending."""
    if not command.path.strip():
        raise InputError("no session file is named: type the path of one (.toml) beside “File”")
    file = at_home(command.path)
    is_there = os.path.exists(file)  # noqa: PTH110 (without an error where a name is too long)
    listed = () if is_there else map(Path, state.list_sessions())
    file = next((session for session in listed if command.path in (session.name, session.stem)), file)
    state.workspace.open(load_session(file), file)
    state.message = f"Opened {file}."
    state.options = state.options.afresh()


def open_demo(state: State, command: c.OpenDemo) -> None:
    """A built-in scene: with the settings of the session file of its name, or else with the open ones."""
    name, workspace = command.name, state.workspace
    if name not in state.demos:
        raise SettingsError(unknown("built-in scene", name, state.demos))
    own = next((Path(p) for p in state.list_sessions() if Path(p).stem == name), None)
    session = load_session(own) if own is not None else None
    if session is not None and (session.scene.source, session.scene.demo) == ("demo", name):
        workspace.open(session, own)
        state.message = f"Opened {own} with its settings."
    else:
        old = workspace.tools.session
        scene = old.scene.model_copy(update={"source": "demo", "demo": name, "frames": (), "objects": ()})
        hypotheses = old.hypotheses.model_copy(update={"source": "perturb", "files": (), "estimate": ()})
        update = {"scene": scene, "hypotheses": hypotheses, "title": name, "edits": (), "changes": ()}
        workspace.open(old.model_copy(update=update), None)
    state.options = state.options.afresh()


# Branches


def fork(state: State, command: c.Fork) -> None:
    """A new branch from an iteration on, run to its end at once if that is asked for."""
    at = state.run.cursor if command.cursor is None else command.cursor
    state.workspace.fork(at, command.changes)
    state.options = state.options.moved()
    state.running.goal = "end" if command.run else None
    if not command.run and not state.run.is_done:
        state.message = f"A new branch from iteration {at}; Step or Run go on with it."


def show_branch(state: State, command: c.ShowBranch) -> None:
    """Another branch of the frame."""
    work = state.workspace.work
    if not 0 <= command.index < len(work.branches):
        raise InputError(f"there is no branch {command.index}; this frame has {len(work.branches)}")
    work.index = command.index
    state.options = state.options.moved()


def write(state: State, command: c.SaveSession | c.Export) -> None:
    """Writes a session or an export, and says where it is."""
    if state.keep is None:
        raise InputError("nothing can be written here")
    state.written = (state.keep(state, command), *state.written)[:4]
    state.sessions = state.list_sessions()
    state.message = f"Written: {state.written[0].words}"
    if isinstance(command, c.SaveSession) and len(state.workspace.work.branches) > 1:
        name = state.workspace.branch.name
        state.message += f"; it holds the shown branch, “{name}”; others are saved one by one"
    if isinstance(command, c.SaveSession) and state.options.is_moved:
        state.message += "; not the edited pose: press “Continue from here”, then save again"


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


HANDLERS = {
    c.Restart: restart,
    c.CutDependency: reorder,
    c.MoveInOrder: reorder,
    c.ResetOrder: reorder,
    c.Estimate: estimate,
    c.OpenFrame: open_frame,
    c.OpenDemo: open_demo,
    c.OpenSession: open_session,
    OpenRecording: open_recording,
    c.Fork: fork,
    c.ShowBranch: show_branch,
    c.SaveSession: write,
    c.Export: write,
}
