"""Opens a frame, scene, session, recording, branch, or a run from its start with other settings; writes files."""

from __future__ import annotations

import os
from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from pathlib import Path

from verefine_viz.core.errors import InputError, SettingsError, unknown
from verefine_viz.core.paths import at_home
from verefine_viz.core.problem import Problem
from verefine_viz.core.settings import Session
from verefine_viz.run.session_file import load_session
from verefine_viz.scenes.hypothesis_pool import asked_estimators
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.snapshot.scene_state import labels_of
from verefine_viz.viewer.state.state import State

# New initial poses for one object of the open frame, and what the page says of them.

SOURCES = {"results": "the results files", "perturb": "the disturbed ground truth"}
"""What the page calls where initial poses come from; estimators have their names."""


def _estimate(state: State, command: c.Estimate) -> None:
    space, instance_id, estimator = state.workspace, command.instance_id, command.estimator
    labels = labels_of(space.work.problem)
    if instance_id not in labels:
        raise InputError(unknown("instance", instance_id, list(labels)))
    label, before, h = labels[instance_id], space.branch.name, space.branch.tools.session.hypotheses
    estimators, had_others = asked_estimators(h), bool(space.others)
    had = bool(space.work.problem.target(instance_id).instance.hypotheses)
    source = estimators.get((space.frame, instance_id), h.source)
    now = h.source if estimator == "session" else estimator
    if estimator == "session" and (space.frame, instance_id) not in estimators:
        raise InputError(
            f"{label} in frame {space.frame} already has the session's initial poses, {_of(now)}; to estimate others, "
            "choose ppf or pcs"
        )
    space.estimate(instance_id, estimator, f"{label} from {SOURCES.get(now, now)}")
    n = next(len(i.hypotheses) for i in space.work.problem.instances if i.instance_id == instance_id)
    instead = f", instead of those {_of(source)}" if source != now and had else ""
    restarts = ", but their runs start again" if had_others else ""
    state.message = (
        f"{label} in frame {space.frame} now has {n} initial pose{'s' if n != 1 else ''} {_of(now)}{instead}. "
        f"Other objects and frames keep theirs{restarts}. "
        f"The way back: the run before is still there as the branch “{before}”, in the table below."
    )
    state.options = replace(state.options.afresh(), focus=instance_id)


def _of(source: str) -> str:
    """As in: from the results files, by ppf."""
    return f"from {SOURCES[source]}" if source in SOURCES else f"by {source}"


def _restart(state: State, command: c.Restart) -> None:
    workspace = state.workspace
    before, saved = workspace.session, [path for path, saved in workspace.files.items() if saved.repeats]
    workspace.restart(command.changes)
    state.message = _not_repeated(before, workspace.session, saved[-1] if saved else None)
    state.options = state.options.afresh()


def _hulls(state: State, command: c.OpenFrame | c.OpenDemo | c.OpenSession) -> AbstractContextManager[None]:
    return state.workspace.with_hulls() if command.hulls else nullcontext()


def _open_frame(state: State, command: c.OpenFrame) -> None:
    with _hulls(state, command):
        state.workspace.open_frame(command.frame)
    state.options = state.options.afresh()


def _open_recording(state: State, command: c.OpenRecording) -> None:
    state.workspace.open_recording(at_home(command.path))
    state.options = state.options.afresh()


def _open_session(state: State, command: c.OpenSession) -> None:
    """A session file: by its path, or where there is none, a listed one by its name with or without its ending."""
    if not command.path.strip():
        raise InputError("no session file is named: type the path of one (.toml) beside “File”")
    file = at_home(command.path)
    is_there = os.path.exists(file)  # noqa: PTH110 (without an error where a name is too long)
    listed = () if is_there else map(Path, state.list_sessions())
    file = next((session for session in listed if command.path in (session.name, session.stem)), file)
    with _hulls(state, command):
        state.workspace.open(load_session(file), file)
    state.message = f"Opened {file}."
    state.options = state.options.afresh()


def _open_demo(state: State, command: c.OpenDemo) -> None:
    """A built-in scene: with the settings of the session file of its name, or else with the open ones."""
    name, workspace = command.name, state.workspace
    if name not in state.demos:
        raise SettingsError(unknown("built-in scene", name, state.demos))
    own = next((Path(p) for p in state.list_sessions() if Path(p).stem == name), None)
    session = load_session(own) if own is not None else None
    if session is not None and (session.scene.source, session.scene.demo) == ("demo", name):
        with _hulls(state, command):
            workspace.open(session, own)
        state.message = f"Opened {own} with its settings."
    else:
        old = workspace.tools.session
        scene = old.scene.model_copy(update={"source": "demo", "demo": name, "frames": (), "objects": ()})
        hypotheses = old.hypotheses.model_copy(update={"source": "perturb", "files": (), "estimate": ()})
        update = {"scene": scene, "hypotheses": hypotheses, "title": name, "edits": (), "changes": ()}
        with _hulls(state, command):
            workspace.open(old.model_copy(update=update), None)
    state.options = state.options.afresh()


# The order of the objects, changed as settings: a saved session then repeats it.

Clusters = tuple[tuple[int, ...], ...]


def _reorder(state: State, command: c.CutDependency | c.MoveInOrder | c.ResetOrder) -> None:
    problem = state.workspace.work.problem
    graph = problem.dependencies
    match command:
        case c.ResetOrder():
            changes = (("dependency.order", ()), ("dependency.order_file", ""))
        case _ if graph is None:
            raise InputError("how the objects of this frame depend on each other is unknown")
        case c.CutDependency(first, second, cut):
            pairs = {frozenset((e.first, e.second)) for e in graph.edges}
            if frozenset((first, second)) not in pairs:
                there = [f"#{min(pair)} and #{max(pair)}" for pair in sorted(pairs, key=sorted)]
                raise InputError(unknown("pair of instances", f"#{first} and #{second}", there))
            settings = state.workspace.branch.tools.session.dependency
            others = tuple(pair for pair in settings.cut if set(pair) != {first, second})
            changes = (("dependency.cut", (*others, (min(first, second), max(first, second))) if cut else others),)
        case c.MoveInOrder(instance_id, by):
            there = [i for cluster in graph.clusters for i in cluster]
            if instance_id not in there:
                raise InputError(unknown("instance", instance_id, there))
            if by not in (-1, 1):
                raise InputError(f"an object moves by one place at a time, -1 or 1, not {by}")
            clusters = moved(graph.clusters, instance_id, by)
            if clusters is None:
                raise InputError(f"instance {instance_id} is {'first' if by < 0 else 'last'} in the order already")
            changes = (("dependency.order", entries(problem, clusters)),)
    _restart(state, c.Restart(changes))


def _drop_unknown(state: State, command: c.DropUnknown) -> None:
    space = state.workspace
    support = space.work.problem.observation.support
    around = support.surroundings if support is not None else None
    numbers = [one.number for one in around.unknown] if around is not None else []
    if command.number not in numbers:
        raise InputError(unknown("unknown object", command.number, numbers))
    one = (space.frame, command.number)
    others = tuple(other for other in space.branch.tools.session.physics.dropped if other != one)
    _restart(state, c.Restart((("physics.dropped", (*others, one) if command.drop else others),)))


def entries(problem: Problem, clusters: Clusters) -> tuple[tuple[int | str, ...], ...]:
    """Clusters as a session file names them: by object, or by instance where an object is there twice."""
    obj_ids = {i.instance_id: i.obj_id for i in problem.instances}
    there = list(obj_ids.values())
    return tuple(
        tuple(obj_ids[i] if there.count(obj_ids[i]) == 1 else f"#{i}" for i in cluster) for cluster in clusters
    )


def moved(clusters: Clusters, instance_id: int, by: int) -> Clusters | None:
    """Clusters with an instance one place earlier or later; None where it stands at the end already."""
    k = next(k for k, cluster in enumerate(clusters) if instance_id in cluster)
    within = _swapped(clusters[k], clusters[k].index(instance_id), by)
    if within is not None:
        return (*clusters[:k], within, *clusters[k + 1 :])
    return _swapped(clusters, k, by)


def _swapped(items: Sequence, at: int, by: int) -> tuple | None:
    to = at + by
    if not 0 <= to < len(items):
        return None
    swapped = list(items)
    swapped[at], swapped[to] = swapped[to], swapped[at]
    return tuple(swapped)


# Branches


def _fork(state: State, command: c.Fork) -> None:
    at = state.run.cursor if command.cursor is None else command.cursor
    state.workspace.fork(at, command.changes)
    state.options = state.options.moved()
    state.running.goal = "end" if command.run else None
    if state.run.is_done and at == state.run.length:
        state.message = f"A new branch from iteration {at}, the last: nothing is left to run. Fork at an earlier one."
    elif not command.run and not state.run.is_done:
        state.message = f"A new branch from iteration {at}; Step or Run go on with it."


def _show_branch(state: State, command: c.ShowBranch) -> None:
    work = state.workspace.work
    if not 0 <= command.index < len(work.branches):
        raise InputError(f"there is no branch {command.index}; this frame has {len(work.branches)}")
    work.index = command.index
    state.options = state.options.moved()


def _write(state: State, command: c.SaveSession | c.Export) -> None:
    if state.write is None:
        raise InputError("nothing can be written here")
    state.written = (state.write(state, command), *state.written)[:4]
    state.sessions = state.list_sessions()
    state.message = f"Written: {state.written[0].words}"
    if isinstance(command, c.SaveSession) and len(state.workspace.work.branches) > 1:
        name = state.workspace.branch.name
        state.message += f"; it holds the shown branch, “{name}”; others are saved one by one"
    if isinstance(command, c.SaveSession) and state.options.is_moved:
        state.message += "; not the edited pose: press “Continue from here”, then save again"


def _not_repeated(before: Session, after: Session, path: Path | None) -> str:
    """What a restart leaves behind of a run, in words; "" = nothing.

    Args:
        before: what a session file would have had to say to repeat the run.
        after: what it has to say now; what was moved in other frames may still be there.
        path: a file of the open session that has poses moved or settings changed on the way; None = there is none.
    """
    words = []
    if any(change.after_iteration > 0 for change in before.changes):
        words.append("The settings changed on the way now hold from iteration 1 on.")
    n = sum(edit not in after.edits for edit in before.edits)
    if n:
        words.append(f"{n} edited pose{'s' if n > 1 else ''} {'are' if n > 1 else 'is'} not moved again.")
    if words and path is not None:
        words.append(f"To repeat them open {path}.")
    return " ".join(words)


HANDLERS = {
    c.Restart: _restart,
    c.CutDependency: _reorder,
    c.MoveInOrder: _reorder,
    c.ResetOrder: _reorder,
    c.DropUnknown: _drop_unknown,
    c.Estimate: _estimate,
    c.OpenFrame: _open_frame,
    c.OpenDemo: _open_demo,
    c.OpenSession: _open_session,
    c.OpenRecording: _open_recording,
    c.Fork: _fork,
    c.ShowBranch: _show_branch,
    c.SaveSession: _write,
    c.Export: _write,
}
