"""Compares two runs: computes B beside the page, and moves both along their iterations."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from verefine_viz.core.errors import InputError
from verefine_viz.core.paths import at_home
from verefine_viz.core.settings import SURROUNDINGS, Session
from verefine_viz.run.record import session_of
from verefine_viz.run.variants import parsed, settings_between, variant
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.commands import Changes
from verefine_viz.viewer.state.branch import Branch, ComparisonChoice, nested
from verefine_viz.viewer.state.state import State
from verefine_viz.viewer.state.workspace import Workspace

if TYPE_CHECKING:
    from verefine_viz.run.toolbox import Toolbox


# Where B of a comparison comes from: a run of the open frame with other settings, or a recording of it.

_CHEAP = {"method", "icp", "score", "physics"}
"""Sections that can change while everything else of the tools is shared."""
_WORLD = frozenset(f"physics.{name}" for name in SURROUNDINGS)
"""Settings that make another world of the same frame."""


def _branch_with(space: Workspace, changes: Changes) -> Branch:
    """A run of the open frame from its start, with the settings of the open run and ``changes``."""
    base = space.branch
    session = variant(base.tools.session, changes)
    tools = _tools(space, base.tools, session)
    same_start = not {n.partition(".")[0] for n, _, _ in settings_between(base.tools.session, session)} & {
        "hypotheses", "dependency", "ppf", "pcs", "densefusion",
    }  # fmt: skip
    problem = base.run.problem
    if any(name in _WORLD for name, _, _ in settings_between(base.tools.session, session)):
        problem = tools.surrounded(problem)
    if not same_start:  # Read again, with the instances that the open run solves too.
        ids = {i.instance_id for i in problem.instances}
        problem = tools.problem(space.frame)
        problem = problem.only([i.instance_id for i in problem.instances if i.instance_id in ids])
    short = [name.rpartition(".")[2] if name != "method.name" else "method" for name, _ in changes]
    what = ", ".join(f"{name} = {value}" for name, (_, value) in zip(short, changes, strict=True))
    return space.new_branch(f"B: {what or 'same settings'}", tools, problem)


def _recorded_branch(space: Workspace, path: Path) -> Branch:
    from verefine_viz.recording.reader import read_recording

    record = read_recording(path)
    session, frame = session_of(record.header), record.header.frame
    check_same_frame(path, (session, frame), (space.branch.tools.session, space.frame))
    tools = space.make_tools(session)
    return space.recorded_branch(path, record, tools, tools.problem(frame))


def _tools(space: Workspace, tools: Toolbox, session: Session) -> Toolbox:
    """Tools of ``session``; what they have in common with ``tools`` is shared where that is safe."""
    old = tools.session
    between = settings_between(old, session)
    is_cheap = all(name.partition(".")[0] in _CHEAP and name not in _WORLD for name, _, _ in between)
    if old.edits or old.changes or not is_cheap:
        return space.make_tools(session)
    return tools.changed(nested(tuple((name, value) for name, _, value in between)))


def check_same_frame(path: Path, theirs: tuple[Session, str], ours: tuple[Session, str]) -> None:
    """Two runs can be compared only where they look at the same picture: session and frame.

    Raises:
        InputError: the recording at ``path`` is of another frame.
    """
    if _place_of(*theirs) != _place_of(*ours):
        raise InputError(
            f"{path} shows {_place_of(*theirs)}, A shows {_place_of(*ours)}; two runs are compared on the same frame"
        )


def _place_of(session: Session, frame: str) -> str:
    scene = session.scene
    name = Path(scene.dataset).name
    of_kind = {"bop": f"{name} {scene.split}", "demo": f"{scene.demo}, seed {scene.seed}"}
    where = of_kind.get(scene.source, name)
    return f"frame {frame} of {where}"


# The commands


def _compare_run(state: State, command: c.CompareRun) -> None:
    _put_beside(state, _branch_with(state.workspace, (*command.changes, *parsed(command.more))))
    state.comparison.goal = (state.workspace.work.branches[-1], None) if command.run else None


def _compare_branch(state: State, command: c.CompareBranch) -> None:
    work, index = state.workspace.work, command.index
    if not 0 <= index < len(work.branches):
        raise InputError(f"there is no branch {index} to compare with; this frame has {len(work.branches)}")
    work.comparison = replace(work.comparison or ComparisonChoice(index), b=index, moment=None)


def _compare_recording(state: State, command: c.CompareRecording) -> None:
    _put_beside(state, _recorded_branch(state.workspace, at_home(command.path)))


def _run_b(state: State, command: c.RunB) -> None:
    _choice(state)
    branch = state.comparison.branch_b()
    assert branch is not None
    state.comparison.goal = (branch, command.length)


def _stop_comparing(state: State, command: c.StopComparing) -> None:
    _choice(state)
    state.workspace.work.comparison = None


def _swap_sides(state: State, command: c.SwapSides) -> None:
    choice, work, comparison = _choice(state), state.workspace.work, state.comparison
    compared, place = comparison.compared(), comparison.place()
    assert compared is not None
    moment = compared.pairs[place - 1][:2] if place else None
    work.comparison, work.index = replace(choice, b=work.index), choice.b
    swapped = comparison.compared()
    assert swapped is not None
    _seek(state, swapped.place(moment) or 0)


def _step_moment(state: State, command: c.StepMoment) -> None:
    _choice(state)
    _seek(state, state.comparison.place() + command.by)


def _seek_difference(state: State, command: c.SeekDifference) -> None:
    choice, compared = _choice(state), state.comparison.compared()
    assert compared is not None
    first = compared.departures.deed or compared.departures.score
    if first is None:
        made = min(compared.a.length, compared.b.length)
        state.message = f"No difference in the {made} iterations that both have made."
        return
    state.workspace.work.comparison = replace(choice, poses="kept")
    _seek(state, first.place)


def _show_side(state: State, command: c.ShowSide) -> None:
    choice, side = _choice(state), command.side
    on = side not in choice.shown if command.visible is None else command.visible
    state.workspace.work.comparison = replace(choice, shown=choice.shown | {side} if on else choice.shown - {side})


def _show_side_poses(state: State, command: c.ShowSidePoses) -> None:
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
    _compare_branch(state, c.CompareBranch(len(state.workspace.work.branches) - 1))


def _seek(state: State, place: int) -> None:
    choice, compared = _choice(state), state.comparison.compared()
    assert compared is not None
    place = min(max(place, 0), len(compared.pairs))
    state.run.seek(compared.a_at(place))
    state.workspace.work.comparison = replace(choice, moment=compared.pairs[place - 1][:2] if place else None)
    state.options = state.options.moved()


HANDLERS = {
    c.CompareRun: _compare_run,
    c.CompareBranch: _compare_branch,
    c.CompareRecording: _compare_recording,
    c.RunB: _run_b,
    c.PauseB: lambda state, command: state.pause_b(),
    c.StopComparing: _stop_comparing,
    c.SwapSides: _swap_sides,
    c.SeekMoment: lambda state, command: _seek(state, command.place),
    c.StepMoment: _step_moment,
    c.SeekDifference: _seek_difference,
    c.ShowSide: _show_side,
    c.ShowSidePoses: _show_side_poses,
}
