"""Compares two runs: computes B beside the page, and moves both along one timeline."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from verefine_viz.core.errors import InputError
from verefine_viz.core.paths import at_home
from verefine_viz.core.problem import Problem
from verefine_viz.core.settings import Session
from verefine_viz.session.variants import parsed, settings_between, variant
from verefine_viz.viewer import comparison_commands as s
from verefine_viz.viewer.commands import Changes
from verefine_viz.viewer.state.branch import Branch, ComparisonChoice, Tools, nested
from verefine_viz.viewer.state.state import State
from verefine_viz.viewer.state.workspace import Workspace

if TYPE_CHECKING:
    from verefine_viz.recording.reader import Recorded


# Where B of a comparison comes from: a run of the open frame with other settings, or a recording of it.

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


# The commands


def compare_run(state: State, command: s.CompareRun) -> None:
    """B is a new run of the same frame with changed settings."""
    _put_beside(state, branch_with(state.workspace, (*command.changes, *parsed(command.more))))
    state.comparison.goal = (state.workspace.work.branches[-1], None) if command.run else None


def compare_branch(state: State, command: s.CompareBranch) -> None:
    """B is another branch of the frame."""
    work, index = state.workspace.work, command.index
    if not 0 <= index < len(work.branches):
        raise InputError(f"there is no branch {index} to compare with; this frame has {len(work.branches)}")
    work.comparison = replace(work.comparison or ComparisonChoice(index), b=index, moment=None)


def compare_recording(state: State, command: s.CompareRecording) -> None:
    """B is a recording of the frame."""
    _put_beside(state, branch_read(state.workspace, at_home(command.path)))


def run_b(state: State, command: s.RunB) -> None:
    """Computes B on."""
    _choice(state)
    branch = state.comparison.branch_b()
    assert branch is not None
    state.comparison.goal = (branch, command.length)


def stop_comparing(state: State, command: s.StopComparing) -> None:
    """Shows the open run alone again."""
    _choice(state)
    state.workspace.work.comparison = None


def swap_sides(state: State, command: s.SwapSides) -> None:
    """B becomes the open run, at the same moment."""
    choice, work, comparison = _choice(state), state.workspace.work, state.comparison
    compared, place = comparison.compared(), comparison.place()
    assert compared is not None
    key = compared.timeline.moments[place - 1].key if place else None
    work.comparison, work.index = replace(choice, b=work.index), choice.b
    swapped = comparison.compared()
    assert swapped is not None
    _seek(state, swapped.timeline.place(key) or 0)


def step_moment(state: State, command: s.StepMoment) -> None:
    """Both runs some places further on their common timeline, or back."""
    _choice(state)
    _seek(state, state.comparison.place() + command.by)


def seek_difference(state: State, command: s.SeekDifference) -> None:
    """Both runs to where B first does something otherwise than A."""
    choice, compared = _choice(state), state.comparison.compared()
    assert compared is not None
    first = compared.differences.deed or compared.differences.score
    if first is None:
        made = min(len(compared.a.iterations), len(compared.b.iterations))
        state.message = f"No difference in the {made} iterations that both have made."
        return
    state.workspace.work.comparison = replace(choice, poses="kept")
    _seek(state, first.place)


def show_side(state: State, command: s.ShowSide) -> None:
    """The poses of A or of B in 3D on or off."""
    choice, side = _choice(state), command.side
    on = side not in choice.shown if command.visible is None else command.visible
    state.workspace.work.comparison = replace(choice, shown=choice.shown | {side} if on else choice.shown - {side})


def show_side_poses(state: State, command: s.ShowSidePoses) -> None:
    """Which poses of both are drawn."""
    state.workspace.work.comparison = replace(_choice(state), poses=command.which)


def tick_b(state: State) -> None:
    """One iteration of B."""
    if state.comparison.goal is None:
        return
    branch, length = state.comparison.goal
    run = branch.run
    if not run.is_done and (length is None or run.length < length):
        run.seek(run.length)
        run.step()
    if run.is_done or (length is not None and run.length >= length):
        state.pause_b()


def _choice(state: State) -> ComparisonChoice:
    if state.comparison.choice is None:
        raise InputError("nothing is compared yet; choose what B is in the A/B panel first")
    return state.comparison.choice


def _put_beside(state: State, branch: Branch) -> None:
    state.workspace.work.branches.append(branch)
    compare_branch(state, s.CompareBranch(len(state.workspace.work.branches) - 1))


def _seek(state: State, place: int) -> None:
    choice, compared = _choice(state), state.comparison.compared()
    assert compared is not None
    place = min(max(place, 0), len(compared.timeline))
    state.run.seek(compared.timeline.a_at(place))
    moment = compared.timeline.moments[place - 1] if place else None
    state.workspace.work.comparison = replace(choice, moment=moment.key if moment else None)
    state.options = state.options.moved()


HANDLERS = {
    s.CompareRun: compare_run,
    s.CompareBranch: compare_branch,
    s.CompareRecording: compare_recording,
    s.RunB: run_b,
    s.PauseB: lambda state, command: state.pause_b(),
    s.StopComparing: stop_comparing,
    s.SwapSides: swap_sides,
    s.SeekMoment: lambda state, command: _seek(state, command.place),
    s.StepMoment: step_moment,
    s.SeekDifference: seek_difference,
    s.ShowSide: show_side,
    s.ShowSidePoses: show_side_poses,
}
