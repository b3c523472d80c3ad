"""Where B of a comparison comes from: a run of the open frame with other settings, or a recording of it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from verefine_viz.core.errors import InputError
from verefine_viz.core.problem import Problem
from verefine_viz.core.settings import Session
from verefine_viz.session.variants import settings_between, variant
from verefine_viz.viewer.branch import Branch
from verefine_viz.viewer.changes import nested
from verefine_viz.viewer.command import Changes
from verefine_viz.viewer.tools import Tools
from verefine_viz.viewer.workspace import Workspace

if TYPE_CHECKING:
    from verefine_viz.recording.reader import Recorded

_CHEAP = {"method", "icp", "score", "physics"}
"""Sections that can change while everything else of the tools is shared."""


def branch_with(space: Workspace, changes: Changes) -> Branch:
    """A run of the open frame from its start, with the settings of the open run and ``changes``.

    Raises:
        VerefineError: there is no such setting, or it cannot be so.
    """
    base = space.branch
    session = variant(base.tools.session, changes)
    tools = _tools(space, base.tools, session)
    same_start = not {n.partition(".")[0] for n, _, _ in settings_between(base.tools.session, session)} & {
        "hypotheses", "dependency", "ppf", "pcs",
    }  # fmt: skip
    problem = base.run.problem if same_start else _matching(tools.problem(space.frame), base.run.problem)
    return space.new_branch(_named(changes), tools, problem)


def branch_read(space: Workspace, path: Path) -> Branch:
    """A recording of the open frame.

    Raises:
        VerefineError: it cannot be read, or is of another frame.
    """
    from verefine_viz.recording.reader import read_recording

    recorded = read_recording(path)
    check_same_frame(recorded, space.branch.tools.session, space.frame)
    tools = space.tools_of(recorded.session)
    return space.recorded_branch(recorded, tools, tools.problem(recorded.frame))


def _tools(space: Workspace, tools: Tools, session: Session) -> Tools:
    """Tools of ``session``; what it has in common with ``tools`` is shared where that is safe."""
    old = tools.session
    between = settings_between(old, session)
    if old.edits or old.changes or any(name.partition(".")[0] not in _CHEAP for name, _, _ in between):
        return space.tools_of(session)
    return tools.changed(nested(tuple((name, value) for name, _, value in between)))


def check_same_frame(recorded: Recorded, session: Session, frame: str) -> None:
    """Two runs can be compared only where they look at the same picture.

    Raises:
        InputError: the recording is of another frame.
    """
    theirs, ours = _place_of(recorded.session, recorded.frame), _place_of(session, frame)
    if theirs != ours:
        raise InputError(f"{recorded.path} shows {theirs}, A shows {ours}; two runs are compared on the same frame")


def _place_of(session: Session, frame: str) -> str:
    scene = session.scene
    where = f"{Path(scene.dataset).name} {scene.split}" if scene.source == "bop" else f"{scene.demo}, seed {scene.seed}"
    return f"frame {frame} of {where}"


def _matching(problem: Problem, like: Problem) -> Problem:
    """The instances that the other run solves too."""
    here = {i.instance_id for i in problem.instances}
    return problem.only([i.instance_id for i in like.instances if i.instance_id in here])


def _named(changes: Sequence[tuple[str, Any]]) -> str:
    short = [name.rpartition(".")[2] if name != "method.name" else "method" for name, _ in changes]
    what = ", ".join(f"{name} = {value}" for name, (_, value) in zip(short, changes, strict=True))
    return f"B: {what or 'same settings'}"
