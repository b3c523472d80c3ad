"""Compares two runs: computes B beside the page, and moves both along one timeline."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from verefine_viz.core.errors import InputError
from verefine_viz.core.places import at_home
from verefine_viz.core.problem import Problem
from verefine_viz.core.settings import Session
from verefine_viz.session.alignment import Timeline, aligned
from verefine_viz.session.comparison import Differences, differences
from verefine_viz.session.engine import Run
from verefine_viz.session.trace import Trace, trace_of
from verefine_viz.session.variants import parsed, settings_between, variant
from verefine_viz.viewer import commands as c
from verefine_viz.viewer import comparison_commands as s
from verefine_viz.viewer.commands import Changes, Command
from verefine_viz.viewer.state.branch import Branch, ComparisonChoice, FrameWork, Tools, nested
from verefine_viz.viewer.state.view_options import ViewOptions
from verefine_viz.viewer.state.workspace import Workspace

if TYPE_CHECKING:
    from verefine_viz.recording.reader import Recorded
    from verefine_viz.viewer.debugger import Debugger


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


_B_GOES_ON = (
    c.Step | c.StepStage | c.Back | c.Seek | c.SeekStage | c.SeekEnd | c.SeekEvent | c.RunUntil | c.RunTo | c.Focus
    | c.SelectArm | c.Compare | c.ShowMap | c.ProbePixel | c.ColorCloud | c.ShowLayer | c.ScrubPath | c.PlayPath
    | c.Animate | c.SortBatch | c.FilterBatch | c.TurnPage | c.ScoreGroundTruth | c.SetBreakpoints | c.Export
    | s.SeekMoment | s.StepMoment | s.SeekDifference | s.ShowSide | s.ShowSidePoses
)  # fmt: skip
"""What does not disturb B while it is computed."""


@dataclass(frozen=True, eq=False)
class Compared:
    """Two runs, as far as they are computed."""

    a: Trace
    b: Trace
    timeline: Timeline
    differences: Differences


class Comparing:
    """What the debugger does with two runs."""

    def __init__(self, debugger: Debugger) -> None:
        self._debugger = debugger
        self._goal: tuple[Branch, int | None] | None = None
        self._noted: tuple[Run, int] | None = None
        self._known: tuple[Run, int, Run, int, Compared] | None = None

    # Computing B

    @property
    def is_running(self) -> bool:
        """Whether B is being computed."""
        return self._goal is not None

    def tick(self) -> None:
        """One iteration of B."""
        if self._goal is None:
            return
        branch, length = self._goal
        run = branch.run
        if not run.is_done and (length is None or run.length < length):
            run.seek(run.length)
            run.step()
        if run.is_done or (length is not None and run.length >= length):
            self.pause()

    def pause(self) -> None:
        """Stops computing B after the iteration at hand."""
        if self._goal is not None:
            self._debugger.log.extend(self.progress())
            self._goal = None

    def progress(self) -> tuple[Command, ...]:
        """What the log has to say before the next command, since it may depend on how far B is."""
        if self._goal is None:
            return ()
        run, noted = self._goal[0].run, self._noted
        if run.length == 0 or (noted is not None and noted[0] is run and noted[1] == run.length):
            return ()
        self._noted = (run, run.length)
        return (s.RunB(run.length),)

    def before(self, command: Command) -> None:
        """Notes how far B is, and stops it for what may take it away or turn it into A."""
        self._debugger.log.extend(self.progress())
        if not isinstance(command, _B_GOES_ON):
            self.pause()

    # What is compared

    def look(self, look: ViewOptions) -> ViewOptions:
        """``look`` without what would hide the two runs."""
        return look if self.sides is None else replace(look, layers=look.layers - self.sides.hidden)

    @property
    def sides(self) -> ComparisonChoice | None:
        return self._work.sides

    def branch_b(self) -> Branch | None:
        """The branch beside the open one."""
        sides, branches = self.sides, self._work.branches
        return branches[sides.b] if sides is not None and sides.b < len(branches) else None

    def compared(self) -> Compared | None:
        """Both runs against each other; None while only one is looked at."""
        other = self.branch_b()
        if other is None:
            return None
        a, b = self._work.branch.run, other.run
        known = self._known
        if known is not None and known[0] is a and known[2] is b and known[1] == a.length and known[3] == b.length:
            return known[4]
        one, two = trace_of(a), trace_of(b)
        timeline = aligned(one, two)
        found = Compared(one, two, timeline, differences(one, two, timeline))
        self._known = (a, a.length, b, b.length, found)
        return found

    def place(self) -> int:
        """Where both are on their timeline; 0 before the first moment."""
        found, sides, cursor = self.compared(), self.sides, self._work.branch.run.cursor
        assert found is not None
        assert sides is not None
        place = found.timeline.place(sides.moment)
        if place is not None and found.timeline.a_at(place) == cursor:
            return place
        if cursor == len(found.a.iterations) and found.a.is_done:
            return len(found.timeline)
        return found.timeline.of_a(cursor)

    # Commands

    def do(self, command: Command) -> bool:
        """Carries out a command about a comparison; False where it is about something else."""
        match command:
            case s.CompareRun(changes, more, run):
                self._put_beside(branch_with(self._debugger.workspace, (*changes, *parsed(more))))
                self._goal = (self._work.branches[-1], None) if run else None
            case s.CompareBranch(index):
                self._compare_branch(index)
            case s.CompareRecording(path):
                self._put_beside(branch_read(self._debugger.workspace, at_home(path)))
            case s.RunB(length):
                self._need()
                branch = self.branch_b()
                assert branch is not None
                self._goal = (branch, length)
            case s.PauseB():
                self.pause()
            case s.StopComparing():
                self._need()
                self._work.sides = None
            case s.SwapSides():
                self._swap()
            case s.SeekMoment(place):
                self._seek(place)
            case s.StepMoment(by):
                self._need()
                self._seek(self.place() + by)
            case s.SeekDifference():
                self._seek_difference()
            case s.ShowSide(side, visible):
                sides = self._need()
                on = side not in sides.shown if visible is None else visible
                self._work.sides = replace(sides, shown=sides.shown | {side} if on else sides.shown - {side})
            case s.ShowSidePoses(which):
                self._work.sides = replace(self._need(), poses=which)
            case c.ShowLayer(name, visible) if (
                self.sides is not None and name in self.sides.hidden and visible is not False
            ):
                self._work.sides = replace(self.sides, hidden=self.sides.hidden - {name})
                look = self._debugger.look
                self._debugger.look = replace(look, layers=look.layers | {name})
            case _:
                return False
        return True

    @property
    def _work(self) -> FrameWork:
        return self._debugger.workspace.work

    def _need(self) -> ComparisonChoice:
        if self.sides is None:
            raise InputError("nothing is compared yet; choose what B is in the A/B panel first")
        return self.sides

    def _put_beside(self, branch: Branch) -> None:
        self._work.branches.append(branch)
        self._compare_branch(len(self._work.branches) - 1)

    def _compare_branch(self, index: int) -> None:
        work = self._work
        if not 0 <= index < len(work.branches):
            raise InputError(f"there is no branch {index} to compare with; this frame has {len(work.branches)}")
        work.sides = replace(work.sides or ComparisonChoice(index), b=index, moment=None)

    def _swap(self) -> None:
        sides, work = self._need(), self._work
        found, place = self.compared(), self.place()
        assert found is not None
        key = found.timeline.moments[place - 1].key if place else None
        work.sides, work.index = replace(sides, b=work.index), sides.b
        swapped = self.compared()
        assert swapped is not None
        self._seek(swapped.timeline.place(key) or 0)

    def _seek(self, place: int) -> None:
        sides, found = self._need(), self.compared()
        assert found is not None
        place = min(max(place, 0), len(found.timeline))
        run = self._work.branch.run
        run.seek(found.timeline.a_at(place))
        moment = found.timeline.moments[place - 1] if place else None
        self._work.sides = replace(sides, moment=moment.key if moment else None)
        self._debugger.look = self._debugger.look.moved()

    def _seek_difference(self) -> None:
        sides, found = self._need(), self.compared()
        assert found is not None
        first = found.differences.deed or found.differences.score
        if first is None:
            made = min(len(found.a.iterations), len(found.b.iterations))
            self._debugger.message = f"No difference in the {made} iterations that both have made."
            return
        self._work.sides = replace(sides, poses="kept")
        self._seek(first.place)


def as_done(command: Command) -> tuple[Command, ...]:
    """What the log says of a command: how far B was computed is noted when it stops."""
    if isinstance(command, s.CompareRun):
        return (replace(command, run=False),)
    return () if isinstance(command, s.RunB | s.PauseB) else (command,)
